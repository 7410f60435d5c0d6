"""Headers of exports, ten and more of each maker: the measured point or pose, and nothing else."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibtool.errors import InputError
from calibtool.measurement.importing import Imported, Stated, read_table
from calibtool.robot.catalogue import load_robot

ARM = load_robot("ur10")
URDF = list(ARM.chain.model.names)[1:]
ROWS = 4
RNG = np.random.default_rng(3)
Q = RNG.uniform(-90, 90, (ROWS, 6))
P = RNG.uniform(-900, 900, (ROWS, 3))
TURNS = Rotation.random(ROWS, random_state=RNG)
CELLS = {
    **{axis: P[:, k] for k, axis in enumerate("xyz")},
    **{f"q{axis}": TURNS.as_quat()[:, k] for k, axis in enumerate("xyzw")},
    **{f"a{k}": TURNS.as_euler("ZYX", degrees=True)[:, k] for k in range(3)},
    "other": RNG.normal(size=ROWS),
    "temperature": RNG.uniform(20, 22, ROWS),
}
JOINTS = [f"J{k} [deg]" for k in range(1, 7)]
ZYX = {"convention": "zyx"}


def read(fields: str, joints: list[str] = JOINTS, **stated: str) -> Imported:
    """A table of `name=what` fields, `-` for text that says nothing, beside the joints in deg."""
    pairs = [field.split("=") for field in fields.split("|")]
    lines = [";".join([*(name for name, _ in pairs), *joints])]
    for k in range(ROWS):
        cells = [f"P{k}" if what == "-" else f"{CELLS[what][k]:.9f}" for _, what in pairs]
        lines.append(";".join([*cells, *(f"{value:.9f}" for value in Q[k])]))
    return read_table(
        "\n".join(lines), "t.csv", ARM, stated=Stated(**{"angle_unit": "deg", **stated})
    )


POINTS = [
    "Collection=-|Group=-|Name=-|X=x|Y=y|Z=z",
    "Point=-|X (mm)=x|Y (mm)=y|Z (mm)=z|Ux=other|Uy=other|Uz=other",
    "Name=-|X=x|Y=y|Z=z|Mag=other|dX=other|dY=other|dZ=other|dMag=other",
    "Target=-|Measured X=x|Measured Y=y|Measured Z=z|Nominal X=other|Nominal Y=other|"
    "Nominal Z=other",
    "Instrument=-|Pt=-|x=x|y=y|z=z|R=other|Theta=other|Phi=other",
    "PointID=-|East=x|North=y|Height=z",
    "Point Id=-|Easting [mm]=x|Northing [mm]=y|Elevation [mm]=z",
    "Punkt=-|Rechtswert=x|Hochwert=y|Höhe=z",
    "Pt.=-|X=x|Y=y|Z=z|Std X=other|Std Y=other|Std Z=other|Std Total=other",
    "ID=-|Hz=other|V=other|D=other|X=x|Y=y|Z=z",
    "Target ID=-|X [mm]=x|Y [mm]=y|Z [mm]=z|u(X)=other|u(Y)=other|u(Z)=other",
    "Feature=-|X=x|Y=y|Z=z|I=other|J=other|K=other",
    "Name=-|X Actual=x|Y Actual=y|Z Actual=z|X Nominal=other|Y Nominal=other|Z Nominal=other",
    "Nr.=-|X-Wert=x|Y-Wert=y|Z-Wert=z",
    "Mittelpunkt X=x|Mittelpunkt Y=y|Mittelpunkt Z=z|Durchmesser=other",
    "Azimuth=other|Elevation=other|Distance=other|X=x|Y=y|Z=z",
    "Point_ID=-|X_Coord=x|Y_Coord=y|Z_Coord=z|RMS_Error=other",
    "Object Name=-|Nom X=other|Nom Y=other|Nom Z=other|Meas X=x|Meas Y=y|Meas Z=z",
    "Primitive=-|Mes. X=x|Mes. Y=y|Mes. Z=z|Ecart X=other|Ecart Y=other|Ecart Z=other",
    "Punkt=-|X Mess=x|Y Mess=y|Z Mess=z|X Soll=other|Y Soll=other|Z Soll=other"
    "|X Abw.=other|Y Abw.=other|Z Abw.=other",
    "Name=-|X Mess=x|Y Mess=y|Z Mess=z|Nennmaß X=other|Nennmaß Y=other|Nennmaß Z=other",
    "SMR X=x|SMR Y=y|SMR Z=z|TCP qx=qx|TCP qy=qy|TCP qz=qz|TCP qw=qw",
    "EE:Marker1:X=x|EE:Marker1:Y=y|EE:Marker1:Z=z",
]


@pytest.mark.parametrize("fields", POINTS)
def test_an_export_of_points_is_one_point(fields: str) -> None:
    found = read(fields, unit="mm")
    assert found.measurements.kind == "points"
    np.testing.assert_allclose(found.measurements.points * 1e3, P[:, None], atol=1e-6)
    used = {name for name, what in (f.split("=") for f in fields.split("|")) if what in set("xyz")}
    every = {field.split("=")[0] for field in fields.split("|")}
    assert set(found.understood.ignored["t.csv"]) == every - used


@pytest.mark.parametrize(
    ("fields", "stated"),
    [
        ("Frame=-|X=x|Y=y|Z=z|Rx from Y (deg)=a0|Ry from Z (deg)=a1|Rz from X (deg)=a2", ZYX),
        ("X=x|Y=y|Z=z|Quaternion 0=qw|Quaternion 1=qx|Quaternion 2=qy|Quaternion 3=qz", {}),
        ("t-mac X=x|t-mac Y=y|t-mac Z=z|t-mac q0=qw|t-mac qx=qx|t-mac qy=qy|t-mac qz=qz", {}),
        ("STS X=x|STS Y=y|STS Z=z|STS Roll=a0|STS Pitch=a1|STS Yaw=a2", ZYX),
        (
            "Frame=-|Body 1 Rotation X=qx|Body 1 Rotation Y=qy|Body 1 Rotation Z=qz"
            "|Body 1 Rotation W=qw|Body 1 Position X=x|Body 1 Position Y=y|Body 1 Position Z=z",
            {},
        ),
        ("Tool:RX (deg)=a0|Tool:RY (deg)=a1|Tool:RZ (deg)=a2|Tool:TX=x|Tool:TY=y|Tool:TZ=z", ZYX),
        ("RB X=x|RB Y=y|RB Z=z|RB QX=qx|RB QY=qy|RB QZ=qz|RB QW=qw", {}),
        ("Tx=x|Ty=y|Tz=z|Q0=qw|Q1=qx|Q2=qy|Q3=qz", {}),
        (
            "SMR X=x|SMR Y=y|SMR Z=z|SMR qx=qx|SMR qy=qy|SMR qz=qz|SMR qw=qw"
            "|TCP qx=other|TCP qy=other|TCP qz=other|TCP qw=other",
            {},
        ),
    ],
)
def test_an_orientation_belongs_to_the_point_of_its_name(
    fields: str, stated: dict[str, str]
) -> None:
    found = read(fields, unit="mm", **stated).measurements
    assert found.kind == "pose"
    np.testing.assert_allclose(found.points * 1e3, P[:, None], atol=1e-6)
    np.testing.assert_allclose(found.rotations, TURNS.as_matrix(), atol=1e-7)


@pytest.mark.parametrize(
    "joint",
    [
        "jointtarget.robax.rax_{}",
        "Axis {} Position",
        "AxisAct[{}]",
        "E6AXIS.A{}",
        "AIPos.A{}",
        "J{} Actual Pos (deg)",
        "CUR_JPOS[{}]",
        "JPOS{}",
        "herej.j{}",
        "joint_states.position[{}]",
    ],
)
@pytest.mark.parametrize("first", [0, 1])
def test_joints_of_logs(joint: str, first: int) -> None:
    found = read("x=x|y=y|z=z", [joint.format(k + first) for k in range(6)], unit="mm")
    np.testing.assert_allclose(np.rad2deg(found.measurements.q), Q, atol=1e-7)


def test_joints_of_rtde_asked_for_and_read_back_with_their_stated_unit() -> None:
    """Speeds and currents beside them are no joints."""
    read_back = "|".join(f"actual_q_{k}=temperature" for k in range(6))
    more = "|".join(f"{name}_{k}=other" for name in ("actual_qd", "current") for k in range(6))
    asked = [f"target_q_{k}" for k in range(6)]
    found = read(f"x=x|y=y|z=z|{read_back}|{more}", asked, unit="mm")
    np.testing.assert_allclose(np.rad2deg(found.measurements.q), Q, atol=1e-7)
    assert found.auxiliary.q_read is not None
    expected = np.repeat(CELLS["temperature"][:, None], 6, axis=1)
    np.testing.assert_allclose(np.rad2deg(found.auxiliary.q_read), expected, atol=1e-7)
    assert len(found.understood.ignored["t.csv"]) == 12


def test_polar_coordinates_are_no_wire() -> None:
    with pytest.raises(InputError, match=r"polar coordinates \('Hz'\) are not read; export x, y"):
        read("Point=-|Hz=other|V=other|Distance=x", unit="mm")
