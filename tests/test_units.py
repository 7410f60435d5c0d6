"""Units at the borders: headers carry them, values come out in metres and radians."""

import math

import pytest
from cases import examples
from hypothesis import given
from hypothesis import strategies as st

from calibtool.errors import InputError
from calibtool.units import TO_SI, joint_and_factor, joint_column, joint_values

laws = examples(40)


def test_factors_are_those_of_the_si() -> None:
    assert 180 * TO_SI["deg"] == pytest.approx(math.pi, rel=1e-15)
    assert 1000 * TO_SI["mm"] == pytest.approx(TO_SI["m"], rel=1e-15) == 1.0
    assert 1000 * TO_SI["mrad"] == pytest.approx(TO_SI["rad"], rel=1e-15) == 1.0


@laws
@given(st.integers(1, 99), st.sampled_from(["deg", "rad", "mm", "m"]))
def test_a_joint_header_names_its_joint_and_unit(number: int, unit: str) -> None:
    assert joint_column(f"j{number}_{unit}") == (number - 1, unit)
    assert joint_column(f"  j{number}_{unit} ") == (number - 1, unit)


@pytest.mark.parametrize(
    "header",
    [
        "",
        "j0_deg",
        "j01_deg",
        "j_deg",
        "j1",
        "1_deg",
        "j1_",
        "xj1_deg",
        "j1 deg",
        "x_mm",
        "j-1_deg",
    ],
)
def test_other_headers_are_no_joints(header: str) -> None:
    assert joint_column(header) is None


@laws
@given(
    st.lists(st.tuples(st.booleans(), st.floats(-100, 100), st.booleans()), min_size=1, max_size=8),
    st.randoms(),
)
def test_values_come_out_in_si_and_in_the_order_of_the_joints(
    joints: list[tuple[bool, float, bool]], random
) -> None:
    prismatic = [p for p, _, _ in joints]
    named = []
    for i, (is_prismatic, si, small_unit) in enumerate(joints):
        if is_prismatic:
            named.append((f"j{i + 1}_mm", si * 1000) if small_unit else (f"j{i + 1}_m", si))
        else:
            named.append(
                (f"j{i + 1}_deg", math.degrees(si)) if small_unit else (f"j{i + 1}_rad", si)
            )
    random.shuffle(named)
    assert joint_values(dict(named), prismatic, "here") == pytest.approx(
        [si for _, si, _ in joints], abs=1e-12
    )


@pytest.mark.parametrize(
    ("name", "finding"),
    [
        ("elbow", "no joint name"),
        ("j4_deg", "names joint 4, but the robot has 3 joints"),
        ("j1_mm", "joint 1 is revolute"),
        ("j3_deg", "joint 3 is prismatic"),
        ("j1_turns", "joint 1 is revolute"),
    ],
)
def test_a_header_that_does_not_fit_the_robot_is_refused_with_its_place(
    name: str, finding: str
) -> None:
    with pytest.raises(InputError, match=finding) as caught:
        joint_and_factor(name, [False, False, True], "table.csv:1")
    assert str(caught.value).startswith("table.csv:1: ")
    assert f"'{name}'" in str(caught.value)


def test_every_missing_joint_is_named() -> None:
    with pytest.raises(InputError, match=r"here: no value for j1, j3"):
        joint_values({"j2_rad": 0.1}, [False] * 3, "here")


def test_a_joint_that_is_given_twice_is_refused() -> None:
    with pytest.raises(InputError, match="j1"):
        joint_values({"j1_deg": 10.0, "j1_rad": 1.5}, [False], "here")
