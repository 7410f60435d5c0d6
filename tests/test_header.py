"""Units, frames and conventions: taken from the header or stated, never guessed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibtool.errors import InputError
from calibtool.measurement.importing import Imported, Stated, parse_column_map, read_table
from calibtool.robot.catalogue import load_robot

ARM = load_robot("planar-3r")
JOINTS = "j1_deg,j2_deg,j3_deg"
ROW = "10,20,30,1,2,3"


def read(header: str, *rows: str, **stated: str) -> Imported:
    return read_table("\n".join([header, *(rows or (ROW,))]), "t.csv", ARM, stated=Stated(**stated))


@pytest.mark.parametrize(("unit", "metres"), [("mm", 1e-3), ("m", 1.0), ("in", 0.0254)])
@pytest.mark.parametrize("names", ["x{},y{},z{}", "t1_x{},t1_y{},t1_z{}"])
def test_a_length_has_the_unit_of_its_header_or_the_stated_one(
    names: str, unit: str, metres: float
) -> None:
    expected = np.array([1.0, 2.0, 3.0]) * metres
    by_name = read(f"{JOINTS},{names.replace('{}', f'_{unit}')}").measurements
    by_option = read(f"{JOINTS},{names.replace('{}', '')}", unit=unit).measurements
    assert np.allclose(by_name.points[0, 0], expected, rtol=1e-15)
    assert np.allclose(by_option.points[0, 0], expected, rtol=1e-15)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (f"{JOINTS},x,y,z", "the unit of column 'x' is not stated; name it x_mm .*--unit mm|m|in"),
        (f"{JOINTS},t1_x,t1_y,t1_z", "the unit of column 't1_x' is not stated"),
        (
            "j1,j2,j3,x_mm,y_mm,z_mm",
            "the unit of column 'j1' is not stated; name it j1_deg …, or give --angle-unit",
        ),
        (
            f"{JOINTS},t1_x_mm,t1_y_m,t1_z_mm",
            "columns 't1_x_mm' and 't1_y_m' of one point have different units",
        ),
    ],
)
def test_a_unit_that_is_not_stated_is_asked_for(header: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"^t\.csv: {message}"):
        read(header)


def test_a_stated_unit_does_not_overrule_the_header() -> None:
    with pytest.raises(InputError, match="the measured columns are in mm, but --unit says m"):
        read(f"{JOINTS},x_mm,y_mm,z_mm", unit="m")


def test_joints_without_a_unit_take_the_stated_one() -> None:
    found = read("j1,j2,j3,x_mm,y_mm,z_mm", angle_unit="deg").measurements
    assert np.allclose(found.q, np.deg2rad([[10, 20, 30]]))


ANGLES = "10,20,30,1,2,3,40,-25,115"
R = {
    axis: lambda angle, axis=axis: Rotation.from_euler(axis, angle, degrees=True).as_matrix()
    for axis in "xyz"
}
X, Y, Z = R["x"], R["y"], R["z"]


@pytest.mark.parametrize(
    ("convention", "rotation"),
    [
        ("intrinsic-xyz", X(40) @ Y(-25) @ Z(115)),
        ("extrinsic-xyz", Z(115) @ Y(-25) @ X(40)),
        ("fixed-xyz", Z(115) @ Y(-25) @ X(40)),
        ("intrinsic-zyx", Z(40) @ Y(-25) @ X(115)),
        ("zyx", Z(40) @ Y(-25) @ X(115)),
        ("extrinsic-zxz", Z(115) @ X(-25) @ Z(40)),
        ("rotation-vector", Rotation.from_rotvec([40, -25, 115], degrees=True).as_matrix()),
    ],
)
@pytest.mark.parametrize("names", ["rx_deg,ry_deg,rz_deg", "a_deg,b_deg,c_deg"])
def test_three_angles_by_their_stated_convention(
    names: str, convention: str, rotation: np.ndarray
) -> None:
    found = read(f"{JOINTS},x_mm,y_mm,z_mm,{names}", ANGLES, convention=convention).measurements
    assert found.rotations is not None
    assert np.abs(found.rotations[0] - rotation).max() < 1e-14


def test_three_angles_without_a_convention_or_a_unit_are_not_a_single_point() -> None:
    with pytest.raises(
        InputError, match="the convention of the orientation rx_deg ry_deg rz_deg is not stated"
    ):
        read(f"{JOINTS},x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg", ANGLES)
    with pytest.raises(
        InputError, match="the unit of the orientation rx ry rz is not stated; give --angle-unit"
    ):
        read(f"{JOINTS},x_mm,y_mm,z_mm,rx,ry,rz", ANGLES, convention="zyx")


@pytest.mark.parametrize(
    "convention", ["xyz", "intrinsic-xxy", "euler", "intrinsic-XYZ", "intrinsic-xy", "zyz"]
)
def test_an_unknown_convention_is_refused(convention: str) -> None:
    with pytest.raises(
        InputError, match=f"--convention: unknown convention '{convention}'; known: intrinsic-xyz"
    ):
        read(f"{JOINTS},x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg", ANGLES, convention=convention)


def test_a_convention_without_an_orientation_is_not_passed_over() -> None:
    with pytest.raises(InputError, match="--convention zyx, but the columns hold no orientation"):
        read(f"{JOINTS},x_mm,y_mm,z_mm", convention="zyx")


def test_degrees_stated_as_radians_are_noticed() -> None:
    with pytest.raises(
        InputError, match=r"^t\.csv:2: column 'rx' holds 40 rad, which looks like degrees"
    ):
        read(f"{JOINTS},x_mm,y_mm,z_mm,rx,ry,rz", ANGLES, convention="zyx", angle_unit="rad")


def test_a_map_may_leave_to_the_header_what_the_header_says() -> None:
    toml = 'joints = { columns = ["a", "b", "c"], unit = "rad" }'
    found = read_table(
        "a,b,c,x_mm,y_mm,z_mm\n1,2,3,4,5,6\n", "t.csv", ARM, parse_column_map(toml, "map.toml")
    )
    assert found.measurements.q.tolist() == [[1, 2, 3]]
    assert np.allclose(found.measurements.points * 1e3, [[[4, 5, 6]]])


def test_euler_angles_of_a_map_need_their_unit() -> None:
    toml = (
        'pose = { position = ["x", "y", "z"], unit = "mm", orientation = ["a", "b", "c"], '
        'convention = "zyx" }'
    )
    with pytest.raises(InputError, match=r"^map\.toml: pose: zyx needs orientation_unit"):
        parse_column_map(toml, "map.toml")
