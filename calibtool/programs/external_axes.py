"""External axes beside a position: joints of the chain where the description states so."""

from collections.abc import Mapping, Sequence

from calibtool.programs.motions import EXTERNAL
from calibtool.programs.numbers import Number
from calibtool.robot.robot import Robot
from calibtool.units import TO_SI

UNUSED = 9e9  # the value of an axis that does not exist

# Numbers of external axes by their number from 0; None for what is no number.
Beside = Mapping[int, Number | None]


def unit_of(robot: Robot, axis: int) -> str:
    """The unit in which an external axis is written: that of its joint, "" for an axis that is no
    joint.
    """
    joint = robot.external.get(axis)
    return "" if joint is None else "mm" if robot.prismatic[joint] else "deg"


def arm_units(robot: Robot) -> list[str]:
    """The units in which the axes of the arm are written."""
    return ["mm" if robot.prismatic[joint] else "deg" for joint in robot.arm]


def joints(robot: Robot, axes: Sequence[Number], beside: Beside) -> tuple[Number, ...] | str:
    """Numbers in the robot's order from those of arm and external axes, or a text that says which
    are missing.
    """
    given = dict(zip(robot.arm, axes, strict=True))
    for axis, joint in robot.external.items():
        number = beside.get(axis)
        if number is None or not is_axis(number):
            return f"the external axis e{axis + 1} has no value"
        given[joint] = number
    return tuple(given[joint] for joint in range(robot.n))


def beside_pose(robot: Robot, beside: Beside) -> tuple[tuple[tuple[int, Number], ...], str]:
    """Joints and numbers of external axes that are joints of the chain; the reason why a pose with
    other external axes is not corrected.
    """
    found = []
    for axis, joint in robot.external.items():
        number = beside.get(axis)
        if number is None or not is_axis(number):
            return (), f"the external axis e{axis + 1} has no value"
        found.append((joint, number))
    others = [number for axis, number in beside.items() if axis not in robot.external]
    matter = any(number is None or (number.value != 0 and is_axis(number)) for number in others)
    return tuple(found), EXTERNAL if matter else ""


def is_axis(number: Number) -> bool:
    """Whether a number stands for an existing axis; controllers write a fixed number for the
    others.
    """
    return abs(number.value) < 0.99 * UNUSED * TO_SI.get(number.unit, 1.0)
