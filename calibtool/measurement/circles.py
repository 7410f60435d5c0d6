"""Circle fits: while one joint turns alone, every target moves on a circle about that joint's axis.

The axes of joints 1 and 2 in the instrument's frame, matched with those of the nominal robot, give
T_instrument_base without known targets (the method of single joints, Mooring, Roth, Driels 1991,
ch. 5).
"""

from dataclasses import dataclass

import numpy as np

from calibtool.measurement.measurements import Measurements
from calibtool.robot.se3 import Array, inverse

_ARC = 0.05  # rad: a shorter arc shows no circle
_PARALLEL = 1e-3  # rad: axes with a smaller angle are parallel


@dataclass(frozen=True, eq=False)
class Line:
    """Axis of a joint: unit direction (3,) of positive rotation, and a point (3,) on it, m."""

    direction: Array
    point: Array


def circle_start(measurements: Measurements) -> Array | None:
    """T_instrument_base (4, 4) from circles of joints 1 and 2; None where the rows contain no such
    circles.

    Also None with closed loops, and when one of the joints is prismatic or the two axes are
    parallel, since parallel lines do not determine the position along them.
    """
    robot = measurements.robot
    if robot.n < 2 or any(robot.prismatic[:2]) or robot.chain.tree is not None:
        return None
    rows = single_joint_rows(measurements.q)
    if 0 not in rows or 1 not in rows:
        return None
    seen, nominal = [], []
    for j in (0, 1):
        line = circle_axis(measurements.q[rows[j], j], measurements.points[rows[j]])
        if line is None:
            return None
        seen.append(line)
        _, columns = robot.mechanism.forward_and_jacobian(measurements.q[rows[j][:1]])
        v, w = columns[0, :3, j], columns[0, 3:, j]
        nominal.append(Line(w, np.cross(w, v)))
    # Joint 2's circle was driven at one position of joint 1, and its nominal axis is taken there.
    frames = [_frame(*lines) for lines in (seen, nominal)]
    if frames[0] is None or frames[1] is None:
        return None
    return frames[0] @ inverse(frames[1])


def single_joint_rows(q: Array) -> dict[int, np.ndarray]:
    """For each joint, the largest set of at least four rows of q (N, n) in which it moves alone."""
    found = {}
    for j in range(q.shape[1]):
        others = np.delete(q, j, axis=1).round(6)
        _, label, count = np.unique(others, axis=0, return_inverse=True, return_counts=True)
        rows = np.flatnonzero(label.ravel() == np.argmax(count))
        if len(np.unique(q[rows, j].round(6))) >= 4:
            found[j] = rows
    return found


def circle_axis(angles: Array, points: Array) -> Line | None:
    """Axis of the circles of m targets, angles (K,) in rad, points (K, m, 3), NaN where unseen;
    None for no circle.

    p = c + u cos q + v sin q is linear in c, u, v; the axis is along u × v, weighed over the
    targets by their area.
    """
    if np.ptp(angles) < _ARC:
        return None
    direction, centres, weights = np.zeros(3), [], []
    for i in range(points.shape[1]):
        rows = ~np.isnan(points[:, i, 0])
        if rows.sum() < 4:
            continue
        turned = angles[rows]
        A = np.stack([np.ones(len(turned)), np.cos(turned), np.sin(turned)], axis=-1)
        centre, u, v = np.linalg.lstsq(A, points[rows, i], rcond=None)[0]
        direction += np.cross(u, v)
        centres.append(centre)
        weights.append(np.linalg.norm(np.cross(u, v)))
    length = np.linalg.norm(direction)
    if length < 1e-6:  # m²: targets on the axis
        return None
    return Line(direction / length, np.average(centres, axis=0, weights=weights))


def _frame(first: Line, second: Line) -> Array | None:
    """The frame of two lines: z along the first, x along the common normal, origin on the first."""
    normal = np.cross(first.direction, second.direction)
    sine = np.linalg.norm(normal)
    if sine < _PARALLEL:
        return None
    normal /= sine
    apart = second.point - first.point
    along = np.dot(np.cross(apart, second.direction), normal) / sine
    T = np.eye(4)
    T[:3, :3] = np.stack([normal, np.cross(first.direction, normal), first.direction], axis=-1)
    T[:3, 3] = first.point + along * first.direction
    return T
