"""AuxiliaryReadings: read-only, of one length, NaN where a table says nothing; what import finds
beside the measurements.
"""

import numpy as np
import pytest

from calibtool.errors import InputError
from calibtool.measurement.auxiliary import AuxiliaryReadings
from calibtool.measurement.importing import parse_column_map, read_table
from calibtool.robot.catalogue import load_robot

ARM = load_robot("planar-3r")
HEADER = "j1_deg,j2_deg,j3_deg,x_mm,y_mm,z_mm"


def test_arrays_are_read_only_and_of_one_length() -> None:
    auxiliary = AuxiliaryReadings(q_read=np.zeros((4, 3)), time_s=np.arange(4.0))
    assert auxiliary.q_read is not None
    with pytest.raises(ValueError):
        auxiliary.q_read[0, 0] = 1.0
    with pytest.raises(InputError, match=r"\[3, 4\] rows"):
        AuxiliaryReadings(q_read=np.zeros((4, 3)), time_s=np.arange(3.0))
    with pytest.raises(InputError, match="reference_points has shape"):
        AuxiliaryReadings(reference_points=np.zeros((4, 2)))


def test_rows_go_along_with_the_measurements() -> None:
    auxiliary = AuxiliaryReadings(time_s=np.arange(5.0), temperature_c=np.arange(5.0) + 20)
    part = auxiliary.rows(np.array([3, 1]))
    assert part.time_s is not None
    assert part.temperature_c is not None
    assert part.time_s.tolist() == [3, 1]
    assert part.temperature_c.tolist() == [23, 21]
    assert part.q_read is None


def test_columns_by_name() -> None:
    header = (
        f"{HEADER},j1_read_deg,j2_read_deg,j3_read_deg,time_ms,temperature_k,"
        "ref1_x_mm,ref1_y_mm,ref1_z_mm"
    )
    text = (
        f"{header}\n1,2,3,4,5,6,1.1,2.1,3.1,1500,293.15,7,8,9\n2,3,4,5,6,7,2.1,3.1,4.1,2500,,,,\n"
    )
    found = read_table(text, "t.csv", ARM).auxiliary
    assert np.allclose(np.rad2deg(found.q_commanded), [[1, 2, 3], [2, 3, 4]])
    assert np.allclose(np.rad2deg(found.q_read), [[1.1, 2.1, 3.1], [2.1, 3.1, 4.1]])
    assert found.time_s is not None
    assert found.time_s.tolist() == [1.5, 2.5]
    assert np.allclose(found.temperature_c, [20, np.nan], equal_nan=True)
    expected = [[[0.007, 0.008, 0.009]], [[np.nan] * 3]]
    assert np.allclose(found.reference_points, expected, equal_nan=True)


@pytest.mark.parametrize(
    ("column", "value", "says"),
    [
        ("temperature_c", "293.15", "holds 293.1 °C, in which no arm works; state its unit"),
        ("temperature_k", "21", "holds -252.1 °C"),
        ("payload_kg", "12500", "holds 12500 kg, more than any arm carries; state its unit"),
        ("payload_g", "-1", "negative mass"),
    ],
)
def test_conditions_in_which_no_arm_works_are_of_another_unit(
    column: str, value: str, says: str
) -> None:
    usual = {"temperature_c": "21", "temperature_k": "293", "payload_kg": "5", "payload_g": "1000"}
    text = f"{HEADER},{column}\n1,2,3,4,5,6,{usual[column]}\n2,3,4,5,6,7,"
    read_table(f"{text}{usual[column]}\n", "t.csv", ARM)
    with pytest.raises(InputError, match=says) as refusal:
        read_table(f"{text}{value}\n", "t.csv", ARM)
    assert str(refusal.value).startswith(f"t.csv:3: column '{column}' holds ")


def test_columns_by_a_map() -> None:
    text = "a,b,c,ra,rb,rc,x,y,z,T,bx,by,bz\n1,2,3,1,2,3,4,5,6,21,1,2,3\n"
    toml = """
    joints = { columns = ["a", "b", "c"], unit = "deg" }
    joints_read = { columns = ["ra", "rb", "rc"], unit = "rad" }
    targets = [{ measured = ["x", "y", "z"], unit = "m" }]
    references = [{ measured = ["bx", "by", "bz"], unit = "in" }]
    temperature = { column = "T", unit = "C" }
    """
    found = read_table(text, "t.csv", ARM, parse_column_map(toml, "map.toml")).auxiliary
    assert np.allclose(found.q_read, [[1, 2, 3]])
    assert np.allclose(found.reference_points, [[[0.0254, 0.0508, 0.0762]]])
    assert found.temperature_c is not None
    assert found.temperature_c.tolist() == [21]
    assert found.time_s is None


def test_a_table_of_joints_and_points_alone_has_commanded_joints_alone() -> None:
    found = read_table(f"{HEADER}\n1,2,3,4,5,6\n", "t.csv", ARM).auxiliary
    assert found.q_commanded is not None
    assert (found.q_read, found.time_s, found.temperature_c, found.reference_points) == (
        None,
        None,
        None,
        None,
    )


def test_read_joints_are_complete_or_refused() -> None:
    with pytest.raises(InputError, match="read joint values of 1 joints, planar-3r has 3"):
        read_table(f"{HEADER},j1_read_deg\n1,2,3,4,5,6,1\n", "t.csv", ARM)
