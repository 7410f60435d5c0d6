"""Headers of controllers and instruments: what they call a column is understood, or refused, and
never guessed.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibtool.errors import InputError
from calibtool.measurement.importing import Imported, Stated, read_table
from calibtool.measurement.importing.long_form import one_row_each
from calibtool.measurement.importing.spelling import split_unit
from calibtool.robot.catalogue import load_robot
from calibtool.tables import parse_table

ARM = load_robot("ur10")
URDF = list(ARM.chain.model.names)[1:]
Q = [10.0, -80.0, 95.0, -110.0, -85.0, 20.0]
P = [1500.0, -250.0, 700.0]
ANGLES = [25.0, -40.0, 115.0]
MM = {"unit": "mm"}
DEG = {"angle_unit": "deg"}
BOTH = {**MM, **DEG}


def read(header: str, values: list[float], separator: str = ";", **stated: str) -> Imported:
    row = separator.join(f"{value:g}" for value in values)
    return read_table(
        f"{header}\n{row}\n",
        "t.csv",
        ARM,
        stated=Stated(**stated),
    )


def list_of(pattern: str, count: int = 6, start: int = 1) -> str:
    return ";".join(pattern.format(k) for k in range(start, start + count))


HEADERS = {
    "abb": [
        (list_of("rax_{}"), "x;y;z", BOTH),
        (list_of("robax_{} [deg]"), "X [mm];Y [mm];Z [mm]", {}),
        (list_of("Axis {} (deg)"), "trans.x;trans.y;trans.z", BOTH),
        (list_of("J{}"), "pos_x;pos_y;pos_z", BOTH),
        (list_of("Axis{}_deg"), "X_mm;Y_mm;Z_mm", {}),
        (list_of("AXIS {}"), "X;Y;Z", BOTH),
        (list_of("Axe {} (°)"), "X (mm);Y (mm);Z (mm)", {}),
        (list_of("axis_{}"), "tcp_x;tcp_y;tcp_z", BOTH),
        (list_of("Joint {} [°]"), "SMR X [mm];SMR Y [mm];SMR Z [mm]", {}),
        (list_of("Eje {} [grad]"), "x_mm;y_mm;z_mm", {}),
        (list_of("Eje {} [grados]"), "X [mm];Y [mm];Z [mm]", {}),
        (list_of("Asse {} (gradi)"), "X [mm];Y [mm];Z [mm]", {}),
        (list_of("关节{}(度)"), "X(毫米);Y(毫米);Z(毫米)", {}),
    ],
    "kuka": [
        (list_of("A{}"), "X;Y;Z", BOTH),
        (list_of("Achse {} [°]"), "X [mm];Y [mm];Z [mm]", {}),
        (list_of("$AXIS_ACT.A{}"), "$POS_ACT.X;$POS_ACT.Y;$POS_ACT.Z", BOTH),
        (list_of("A{} [deg]"), "Mess X [mm];Mess Y [mm];Mess Z [mm]", {}),
        (list_of("A{}_ist [°]"), "x ist [mm];y ist [mm];z ist [mm]", {}),
        (list_of("Ist A{} (Grad)"), "Punkt X (mm);Punkt Y (mm);Punkt Z (mm)", {}),
        (list_of("a{}"), "t1_x;t1_y;t1_z", BOTH),
        (list_of("Gelenk {}"), "X1;Y1;Z1", BOTH),
        (list_of("A {}"), "Koordinate X;Koordinate Y;Koordinate Z", BOTH),
        (list_of("A{}_deg"), "SMR1 X [mm];SMR1 Y [mm];SMR1 Z [mm]", {}),
    ],
    "fanuc": [
        (list_of("J{}"), "X;Y;Z", BOTH),
        (list_of("J{}(deg)"), "X(mm);Y(mm);Z(mm)", {}),
        (list_of("J{} deg"), "X mm;Y mm;Z mm", {}),
        (list_of("JOINT{}"), "T1_X;T1_Y;T1_Z", BOTH),
        (list_of("joint[{}] [deg]"), "P1 x [mm];P1 y [mm];P1 z [mm]", {}),
        (list_of("Joint_{}_deg"), "POINT_X_mm;POINT_Y_mm;POINT_Z_mm", {}),
        (list_of("j{}"), "meas_x;meas_y;meas_z", BOTH),
        (list_of("J{}_cmd [deg]"), "Actual X [mm];Actual Y [mm];Actual Z [mm]", {}),
        (list_of("Jnt {}"), "Tracker X;Tracker Y;Tracker Z", BOTH),
        (list_of("JT{}"), "Target1 X;Target1 Y;Target1 Z", BOTH),
    ],
    "ur": [
        (";".join(URDF), "x;y;z", BOTH),
        (list_of("actual_q_{}", start=0), "x_mm;y_mm;z_mm", DEG),
        ("Base;Shoulder;Elbow;Wrist 1;Wrist 2;Wrist 3", "X;Y;Z", BOTH),
        ("base [°];shoulder [°];elbow [°];wrist1 [°];wrist2 [°];wrist3 [°]", "x_mm;y_mm;z_mm", {}),
        (list_of("q{}", start=0), "x_mm;y_mm;z_mm", DEG),
        (list_of("q{}"), "x_mm;y_mm;z_mm", DEG),
        (";".join(f"/joint_states/{name}/position" for name in URDF), "x;y;z", BOTH),
        (";".join(name.upper() for name in URDF), "X;Y;Z", BOTH),
        (list_of("target_q_{}", start=0), "point.x;point.y;point.z", BOTH),
        (";".join(f"{name}.pos" for name in URDF), "position.x;position.y;position.z", BOTH),
    ],
    "yaskawa": [
        ("S;L;U;R;B;T", "X;Y;Z", BOTH),
        ("S [deg];L [deg];U [deg];R [deg];B [deg];T [deg]", "X [mm];Y [mm];Z [mm]", {}),
        ("S_deg;L_deg;U_deg;R_deg;B_deg;T_deg", "x_mm;y_mm;z_mm", {}),
        ("s;l;u;r;b;t", "x;y;z", BOTH),
        ("S (°);L (°);U (°);R (°);B (°);T (°)", "Pt X (mm);Pt Y (mm);Pt Z (mm)", {}),
        ("S°;L°;U°;R°;B°;T°", "posX;posY;posZ", MM),
        (list_of("theta{}"), "Prism X;Prism Y;Prism Z", BOTH),
        (list_of("θ{} [°]"), "TX;TY;TZ", MM),
        (list_of("joint {} angle [deg]"), "px;py;pz", MM),
        (list_of("th{}"), "Laser X;Laser Y;Laser Z", BOTH),
    ],
}
CASES = [(maker, *case) for maker, cases in HEADERS.items() for case in cases]


@pytest.mark.parametrize(("maker", "joints", "points", "stated"), CASES)
def test_what_a_maker_calls_joints_and_points(
    maker: str, joints: str, points: str, stated: dict[str, str]
) -> None:
    found = read(f"{joints};{points}", [*Q, *P], **stated).measurements
    assert np.allclose(np.rad2deg(found.q[0]), Q, atol=1e-12)
    assert np.allclose(found.points[0] * 1e3, [P], atol=1e-9)


J = list_of("j{}_deg")


@pytest.mark.parametrize(
    ("angles", "convention", "axes"),
    [
        ("A;B;C", "zyx", "ZYX"),
        ("A [deg];B [deg];C [deg]", "zyx", "ZYX"),
        ("W;P;R", "extrinsic-xyz", "xyz"),
        ("w_deg;p_deg;r_deg", "extrinsic-xyz", "xyz"),
        ("O;A;T", "intrinsic-zyz", "ZYZ"),
        ("RX (°);RY (°);RZ (°)", "intrinsic-xyz", "XYZ"),
        ("A;E;R", "intrinsic-zyz", "ZYZ"),
        ("Rot X;Rot Y;Rot Z", "extrinsic-xyz", "xyz"),
    ],
)
def test_a_maker_s_angles_by_the_stated_convention(angles: str, convention: str, axes: str) -> None:
    header = f"{J};X;Y;Z;{angles}"
    found = read(header, [*Q, *P, *ANGLES], convention=convention, **BOTH).measurements
    expected = Rotation.from_euler(axes, ANGLES, degrees=True).as_matrix()
    assert found.rotations is not None
    assert np.abs(found.rotations[0] - expected).max() < 1e-14
    with pytest.raises(InputError, match=r"the convention of the orientation .* is not stated"):
        read(header, [*Q, *P, *ANGLES], **BOTH)


@pytest.mark.parametrize(
    "names",
    ["q1;q2;q3;q4", "Q1;Q2;Q3;Q4", "q0;q1;q2;q3", "qw;qx;qy;qz", "quat_w;quat_x;quat_y;quat_z"],
)
@pytest.mark.parametrize("joints", [J, list_of("rax_{} [deg]")])
def test_four_numbers_of_a_quaternion(names: str, joints: str) -> None:
    quaternion = Rotation.from_euler("xyz", ANGLES, degrees=True)
    wxyz = quaternion.as_quat(scalar_first=True)
    found = read(f"{joints};x_mm;y_mm;z_mm;{names}", [*Q, *P, *wxyz]).measurements
    assert found.rotations is not None
    assert np.abs(found.rotations[0] - quaternion.as_matrix()).max() < 1e-5


def test_a_quaternion_with_the_scalar_last_by_its_letters() -> None:
    quaternion = Rotation.from_euler("xyz", ANGLES, degrees=True)
    header = f"{J};x_mm;y_mm;z_mm;orientation.x;orientation.y;orientation.z;orientation.w"
    found = read(header, [*Q, *P, *quaternion.as_quat()]).measurements
    assert found.rotations is not None
    assert np.abs(found.rotations[0] - quaternion.as_matrix()).max() < 1e-5


@pytest.mark.parametrize(
    ("header", "values", "message"),
    [
        (f"{J};J3_deg;x_mm;y_mm;z_mm", [*Q, 1, *P], "'j3_deg' and 'J3_deg' both mean j3_deg"),
        (f"{list_of('A{} [°]')};Achse 2 [°];x_mm;y_mm;z_mm", [*Q, 1, *P], "both mean j2_deg"),
        (f"{J};x_mm;y_mm;z_mm;X [mm]", [*Q, *P, 1], "'x_mm' and 'X .mm.' mean the same"),
        (f"{J};T1 X;T1 Y;T1 Z;X;Y;Z", [*Q, *P, *P], "more than one set of columns"),
        (f"{J};Left X;Left Y;Left Z;T1 X;T1 Y;T1 Z", [*Q, *P, *P], "more than one set of columns"),
        (f"{J};X [furlong];Y [furlong];Z [furlong]", [*Q, *P], "no measured points"),
    ],
)
def test_what_can_be_read_in_two_ways_is_refused(
    header: str, values: list[float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read(header, values, **MM)


def test_targets_by_their_names_and_what_is_no_measured_point() -> None:
    header = (
        f"{J};Ball A X [mm];Ball A Y [mm];Ball A Z [mm];Ball B X [mm];Ball B Y [mm];Ball B Z [mm]"
    )
    more = ";Soll X [mm];Soll Y [mm];Soll Z [mm];dX [mm];dY [mm];dZ [mm];TCP X;TCP Y;TCP Z"
    other = [v + 40 for v in P]
    found = read(header + more, [*Q, *P, *other, *[0.0] * 9])
    assert np.allclose(found.measurements.points[0] * 1e3, [P, other])
    unused = found.understood.ignored["t.csv"]
    assert unused == more.removeprefix(";").split(";")
    assert found.understood.remarks == [f"t.csv: not used: {', '.join(unused)}"]


def test_joints_asked_for_and_read_back() -> None:
    header = f"{list_of('J{} cmd [deg]')};{list_of('J{} act [deg]')};x_mm;y_mm;z_mm"
    found = read(header, [*Q, *[v + 0.1 for v in Q], *P])
    assert np.allclose(np.rad2deg(found.measurements.q[0]), Q)
    assert found.auxiliary.q_read is not None
    assert np.allclose(np.rad2deg(found.auxiliary.q_read[0]), np.add(Q, 0.1))


@pytest.mark.parametrize("part", ["{a=", "_", "a1_", "[ ", "°"])
def test_a_name_of_any_length_is_split_at_its_end(part: str) -> None:
    """Such names come from damaged files, and once took minutes."""
    name = "x" + part * 20_000 + "x"
    assert split_unit(name + " [mm]") == (name, "mm")
    assert split_unit(name + "!") == (name + "!", None)


def test_names_of_points_of_any_length_are_no_list() -> None:
    rows = "".join(f"{'_' * 20_000}!,{k},0,0\n" for k in range(3))
    table = parse_table("name,x_mm,y_mm,z_mm\n" + rows, "t.csv")
    assert one_row_each(table, None, ()) == (table, None)


@pytest.mark.parametrize(
    ("position", "orientation"),
    [
        ("pose.position.{}", "pose.orientation.{}"),
        ("field.pose.pose.position.{}", "field.pose.pose.orientation.{}"),
        ("transform.translation.{}", "transform.rotation.{}"),
        ("Position {}", "Rotation {}"),
        ("{}", "quat {}"),
    ],
)
def test_a_quaternion_under_the_names_of_ros_and_of_cameras(
    position: str, orientation: str
) -> None:
    w, *xyz = Rotation.from_euler("xyz", ANGLES, degrees=True).as_quat(scalar_first=True)
    header = ";".join(
        [list_of("j{}_deg"), *map(position.format, "xyz"), *map(orientation.format, "xyzw")]
    )
    read_in = read(header, [*Q, *P, *xyz, w], unit="mm").measurements
    assert read_in.points.shape == (1, 1, 3)
    expected = Rotation.from_euler("xyz", ANGLES, degrees=True).as_matrix()
    np.testing.assert_allclose(read_in.rotations[0], expected, atol=1e-5)


@pytest.mark.parametrize("name", ["{}_cm", "{} [cm]", "T1 {} (µm)", "{}_ft", "pos_{} um"])
def test_lengths_in_units_that_are_not_read_are_refused(name: str) -> None:
    header = ";".join([list_of("j{}_deg"), *map(name.format, "xyz")])
    with pytest.raises(InputError, match=r"t.csv:1: column .* is in (?:cm|µm|ft|um); lengths are"):
        read(header, [*Q, *P], unit="mm")
