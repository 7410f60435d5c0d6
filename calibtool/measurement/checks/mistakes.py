"""Common single mistakes in a table, each with the measurements that result without it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calibtool.measurement.measurements import Measurements
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly

_UNIT = 180.0 / np.pi
LENGTHS = (
    (25.4, "inches, given as mm"),
    (1e3, "metres, given as mm"),
    (1e-3, "mm, given as metres"),
    (1 / 25.4, "mm, given as inches"),
    (0.0254, "inches, given as metres"),
    (1 / 0.0254, "metres, given as inches"),
    (10.0, "cm, given as mm"),
)


@dataclass(frozen=True)
class Mistake:
    """A possible mistake, in words, and the measurements without it."""

    name: str
    text: str
    repaired: Measurements


def mistakes(every: Measurements, rows: np.ndarray) -> Iterator[Mistake]:
    """Common single mistakes in a table, more probable ones first, repaired in some of the rows
    (k,).
    """
    measurements = every.rows(rows)
    robot, q = measurements.robot, measurements.q
    turning = [j for j in range(robot.n) if not robot.prismatic[j]]

    def with_q(name: str, text: str, values: Array) -> Mistake:
        return Mistake(name, text, replace(measurements, q=readonly(values)))

    for factor, text in (
        (1 / _UNIT, "in degrees, given as rad"),
        (_UNIT, "in rad, given as degrees"),
    ):
        for joints in [turning, *([j] for j in turning)]:
            scale = np.ones(robot.n)
            scale[joints] = factor
            who = "all angles are" if joints is turning else f"joint {joints[0] + 1} is"
            yield with_q("angle_unit", f"{who} {text}", q * scale)
    for factor, text in LENGTHS:
        repaired = replace(measurements, points=readonly(measurements.points * factor))
        yield Mistake("length_unit", f"the lengths are in {text}", repaired)
    if measurements.rotations is not None:
        yield Mistake(
            "inverse_poses",
            "the poses are inverted: those of a fixed board in a camera on the flange "
            "(--poses-of board)",
            inverse_poses(measurements),
        )
    for by in (1, -1, 2, -2):
        paired = rows[(rows - by >= 0) & (rows - by < len(every))]
        if len(paired) < 0.8 * len(rows):
            continue
        repaired = replace(every.rows(paired), q=readonly(every.q[paired - by]))
        which = "before" if by > 0 else "after"
        count = "row" if abs(by) == 1 else f"{abs(by)} rows"
        text = f"the points belong to the joints of the {count} {which} (shifted by {abs(by)})"
        yield Mistake("row_shift", text, repaired)
    mirrored = measurements.points * [1.0, -1.0, 1.0]
    repaired = replace(measurements, points=readonly(mirrored))
    yield Mistake(
        "left_handed_axes",
        "the instrument's axes are left-handed (mirror one coordinate)",
        repaired,
    )
    for j in range(robot.n):
        sign = np.ones(robot.n)
        sign[j] = -1.0
        yield with_q("joint_sign", f"joint {j + 1} is counted the other way round", q * sign)
    for a, b in combinations(range(robot.n), 2):
        order = np.arange(robot.n)
        order[[a, b]] = b, a
        yield with_q(
            "joint_order", f"the columns of joints {a + 1} and {b + 1} are swapped", q[:, order]
        )
    if len(turning) >= 3 and turning[1:3] == [1, 2]:
        for way, text in ((1.0, "the horizontal (add"), (-1.0, "link 2 (subtract")):
            coupled = q.copy()
            coupled[:, 2] += way * q[:, 1]
            option = _joint_values_option(robot, q, coupled)
            text = f"joint 3 is counted from {text} joint 2{option})"
            yield with_q("joint_coupling", text, coupled)


def _joint_values_option(robot: Robot, q: Array, repaired: Array) -> str:
    """The option that reads q (N, n) as the repaired ones, where the robot's coupling explains the
    mistake.
    """
    if not robot.coupled:
        return ""
    if np.allclose(robot.to_serial(q), repaired):
        return ": --joint-values controller"
    return ": --joint-values serial" if np.allclose(robot.to_controller(q), repaired) else ""


def inverse_poses(measurements: Measurements) -> Measurements:
    """Every measured pose inverted."""
    assert measurements.rotations is not None
    turned = np.swapaxes(measurements.rotations, -1, -2)
    points = -(turned[:, None] @ measurements.points[..., None])[..., 0]
    return replace(measurements, points=readonly(points), rotations=readonly(turned))
