"""Files of motion capture, whose headers have several lines: the same points whoever wrote them."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibtool.errors import InputError
from calibtool.measurement.importing import JointFile, Stated, read_table
from calibtool.measurement.importing.column_map import ColumnMap
from calibtool.measurement.measurements import Measurements
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array

ARM = load_robot("ur5")
ROWS = 12
NONE = Stated(None, None)


def truth() -> tuple[Array, Array, Array]:
    """Joints in deg (N, 6), three points (N, 3, 3) in mm and poses (N, 4, 4) in m."""
    rng = np.random.default_rng(3)
    q = np.round(np.rad2deg(ARM.anywhere(ROWS, rng)), 3)
    T = ARM.mechanism.forward(np.deg2rad(q))
    points = np.einsum("nij,kj->nki", T[:, :3, :3], ARM.targets) + T[:, None, :3, 3]
    return q, np.round(points * 1e3, 4), T


Q, POINTS, POSES = truth()
JOINTS = "\n".join(
    [",".join(f"j{k}_deg" for k in range(1, 7)), *(",".join(map(str, q)) for q in Q)]
)


def lines(*header: str, rows: Sequence[Sequence[object]], sign: str = ",") -> str:
    cells = [sign.join(str(cell) for cell in row) for row in rows]
    return "\n".join([*(line.replace(",", sign) for line in header), *cells])


def read(text: str, stated: Stated = NONE) -> Measurements:
    return read_table(
        text, "t.csv", ARM, joints=JointFile(JOINTS, "j.csv"), stated=stated
    ).measurements


def frames(k: int, *values: object) -> list[object]:
    return [k, f"{k / 120:.6f}", *values]


MOTIVE = "Format Version,1.23,Take Name,a,Export Frame Rate,120.0,Rotation Type,{},Length Units,{}"
AXES = ",".join(["X,Y,Z"] * 3)


def spread(names: Sequence[str]) -> str:
    return ",," + ",".join(name for name in names for _ in range(3))


def markers(kind: str) -> str:
    flat = POINTS.reshape(ROWS, 9)
    if kind == "motive":
        names = spread([f"Tool:Marker{k}" for k in (1, 2, 3)])
        numbers = spread(['"1012"', '"1013"', '"1014"'])
        head = [MOTIVE.format("Quaternion", "Millimeters"), "", spread(["Marker"] * 3), names]
        head += [numbers, spread(["Position"] * 3), f"Frame,Time (Seconds),{AXES}"]
        return lines(*head, rows=[frames(k, *row) for k, row in enumerate(flat)])
    if kind == "vicon":
        names = ",,Tool:M1,,,Tool:M2,,,Tool:M3,,"
        units = ",," + ",".join(["mm"] * 9)
        head = ["Trajectories", "100", names, f"Frame,Sub Frame,{AXES}", units]
        return lines(*head, rows=[[k + 1, 0, *row] for k, row in enumerate(flat)])
    head = ["NO_OF_FRAMES,12", "FREQUENCY,100", "DATA_INCLUDED,3D", "MARKER_NAMES,T1,T2,T3"]
    if kind == "qualisys":
        return lines(*head, "TRAJECTORY_TYPES" + ",Measured" * 3, rows=flat.tolist(), sign="\t")
    named = "Frame,Time," + ",".join(f"T{k} {a}" for k in (1, 2, 3) for a in "XYZ")
    return lines(*head, named, rows=[frames(k, *row) for k, row in enumerate(flat)], sign="\t")


@pytest.mark.parametrize("kind", ["motive", "vicon", "qualisys", "qualisys named"])
def test_three_markers_are_three_targets_in_the_unit_of_the_file(kind: str) -> None:
    found = read(markers(kind))
    assert found.kind == "points"
    np.testing.assert_allclose(found.points * 1e3, POINTS, atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(found.q), Q, atol=1e-9)


def body(rotation: str, length: str, scale: float, angles: Array, count: int) -> str:
    axes = "X,Y,Z,W" if count == 4 else "X,Y,Z"
    turn = ",".join(["Rotation"] * count)
    head = [MOTIVE.format(rotation, length), ""]
    head += [",," + ",".join([word] * (count + 4)) for word in ("Rigid Body", "Tool", '"1"')]
    head += [f",,{turn},Position,Position,Position,Mean Marker Error"]
    head += [f"Frame,Time (Seconds),{axes},X,Y,Z,"]
    places = POSES[:, :3, 3] * scale
    rows = [
        frames(k, *turned, *place, 1e-4)
        for k, (turned, place) in enumerate(zip(angles, places, strict=True))
    ]
    return lines(*head, rows=rows)


def test_a_rigid_body_is_a_pose() -> None:
    """With its quaternion, scalar last, or three angles in degrees, which need a convention."""
    turns = Rotation.from_matrix(POSES[:, :3, :3])
    found = read(body("Quaternion", "Meters", 1.0, turns.as_quat(), 4))
    assert found.kind == "pose"
    np.testing.assert_allclose(found.points[:, 0], POSES[:, :3, 3], atol=1e-9)
    assert found.rotations is not None
    np.testing.assert_allclose(found.rotations, POSES[:, :3, :3], atol=1e-9)
    text = body("XYZ", "Millimeters", 1e3, turns.as_euler("XYZ", degrees=True), 3)
    with pytest.raises(InputError, match="convention"):
        read(text)
    angles = read(text, Stated(None, None, "intrinsic-xyz"))
    assert angles.rotations is not None
    np.testing.assert_allclose(angles.rotations, POSES[:, :3, :3], atol=1e-9)
    with pytest.raises(InputError, match="in cm"):
        read(text.replace("Millimeters", "Centimeters"))


def test_two_bodies_are_told_apart_by_their_names() -> None:
    text = markers("vicon").replace("Tool:M1,,,Tool:M2,,,Tool:M3,,", "Base:A,,,Hand:B,,,Cart:C,,")
    mapped = {"measured": [f"Hand:B {axis} [mm]" for axis in "XYZ"], "unit": "mm"}
    found = read_table(
        text,
        "t.csv",
        ARM,
        ColumnMap.model_validate({"targets": [mapped]}),
        joints=JointFile(JOINTS, "j.csv"),
    ).measurements
    np.testing.assert_allclose(found.points[:, 0] * 1e3, POINTS[:, 1], atol=1e-9)


def test_names_that_stay_repeated_are_refused() -> None:
    text = markers("vicon").replace("Tool:M2", "Tool:M1")
    with pytest.raises(InputError, match="appears more than once"):
        read(text)


def test_a_quaternion_from_zero_to_z_is_no_joint() -> None:
    """NDI writes Q0 Qx Qy Qz beside Tx Ty Tz."""
    quaternions = Rotation.from_matrix(POSES[:, :3, :3]).as_quat(scalar_first=True)
    places = POSES[:, :3, 3] * 1e3
    rows = [
        ["1", k, "OK", *turn, *place, 0.1]
        for k, (turn, place) in enumerate(zip(quaternions, places, strict=True))
    ]
    text = lines("Tools,Frame,State,Q0,Qx,Qy,Qz,Tx,Ty,Tz,Error", rows=rows)
    found = read(text, Stated("mm", None))
    assert found.rotations is not None
    np.testing.assert_allclose(found.rotations, POSES[:, :3, :3], atol=1e-9)


@pytest.mark.parametrize("kind", ["points", "pose"])
def test_frames_in_which_nothing_was_seen_are_left_out(kind: str) -> None:
    """With their joints, and said with their lines; a cell alone that is empty is an error."""
    turns = Rotation.from_matrix(POSES[:, :3, :3]).as_quat()
    points = kind == "points"
    text = markers("motive") if points else body("Quaternion", "Meters", 1.0, turns, 4)
    first = len(text.split("\n")) - ROWS
    rows = text.split("\n")
    for k in (2, 7):
        cells = rows[first + k].split(",")
        rows[first + k] = ",".join([*cells[:2], *[""] * (len(cells) - 2)])
    found = read_table("\n".join(rows), "t.csv", ARM, joints=JointFile(JOINTS, "j.csv"))
    kept = [k for k in range(ROWS) if k not in (2, 7)]
    np.testing.assert_allclose(np.rad2deg(found.measurements.q), Q[kept], atol=1e-9)
    expected = POINTS[kept] * 1e-3 if points else POSES[kept][:, None, :3, 3]
    np.testing.assert_allclose(found.measurements.points, expected, atol=1e-9)
    lines = f"line {first + 3}, {first + 8}"
    said = f"t.csv: 2 rows in which nothing was measured left out: {lines}"
    assert said in [*found.understood.remarks, *found.warnings]
    cells = rows[first].split(",")
    rows[first] = ",".join([*cells[:2], "", *cells[3:]])
    with pytest.raises(InputError, match=f"t.csv:{first + 1}: .* is empty"):
        read("\n".join(rows))


def test_a_file_without_any_measurement_is_refused() -> None:
    rows = [",".join(cells.split(",")[:2]) + "," * 9 for cells in markers("motive").split("\n")]
    head = markers("motive").split("\n")[:-ROWS]
    with pytest.raises(InputError):
        read("\n".join([*head, *rows[-ROWS:]]))
