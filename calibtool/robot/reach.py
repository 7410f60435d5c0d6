"""Unreachable poses, found from the pose alone by the triangle inequality."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, inverse, readonly

_ROUNDING = 1e-9  # m and rad: room for rounding


@dataclass(frozen=True, eq=False)
class Reach:
    """Bounds on the distance and the angle between a point and a direction of K_0 and of the tool,
    for all joints.

    The points of a joint's axis do not move when it turns. So points o_j on the axes form a polygon
    with sides of fixed length, which slides lengthen by their stroke, and the axes form a polygon
    on the sphere with sides of fixed angle.

    p_base, p_tool   (3,) first point in K_0, last point in K_{n+1}, m
    a_base, a_tool   (3,) first and last axis in the same frames
    distance, angle  (least, most) between the points, m, and between the axes, rad
    """

    p_base: Array
    p_tool: Array
    a_base: Array
    a_tool: Array
    distance: tuple[float, float]
    angle: tuple[float, float]

    @classmethod
    def of(cls, robot: Robot) -> Self | None:
        """The bounds of a robot, slides within their limits; None where no joint turns."""
        slides = np.array(robot.prismatic)
        if slides.all():
            return None
        middle = np.where(slides, (robot.lower + robot.upper) / 2, 0.0)
        strokes = ((robot.upper - robot.lower) / 2)[slides]
        frames = robot.mechanism.frames(middle[None])
        joints = frames.before[0, ~slides]
        axes = (joints[:, :3, :3] @ robot.chain.twists[~slides, 3:, None])[..., 0]
        points = _nearest_points(joints[:, :3, 3], axes)
        for j in range(1, len(axes)):
            if axes[j] @ axes[j - 1] < 0:  # an axis has no sense: the smaller angle
                axes[j] = -axes[j]
        T_tool_base = inverse(frames.tool[0])
        return cls(
            p_base=readonly(points[0]),
            p_tool=readonly(T_tool_base[:3, :3] @ points[-1] + T_tool_base[:3, 3]),
            a_base=readonly(axes[0]),
            a_tool=readonly(T_tool_base[:3, :3] @ axes[-1]),
            distance=_polygon(
                np.linalg.norm(np.diff(points, axis=0), axis=1), float(strokes.sum())
            ),
            angle=_polygon(angle_between(axes[1:], axes[:-1]), 0.0),
        )

    def excludes(self, target: Array, position: float, orientation: float) -> np.ndarray:
        """Poses (N, 4, 4) that no joints reach within `position` (m) and `orientation` (rad)."""
        distance = np.linalg.norm(
            target[:, :3, :3] @ self.p_tool + target[:, :3, 3] - self.p_base, axis=-1
        )
        angle = angle_between(target[:, :3, :3] @ self.a_tool, self.a_base)
        slack = position + orientation * float(np.linalg.norm(self.p_tool)) + _ROUNDING
        result: np.ndarray = _outside(distance, self.distance, slack)
        result |= _outside(angle, self.angle, orientation + _ROUNDING)
        return result


def excluded(robot: Robot, target: Array, tolerance: float) -> np.ndarray:
    """Poses (N, 4, 4) that the robot cannot reach to within `tolerance`, rad or characteristic
    lengths: (N,) bool.

    It finds most poses out of reach, and every wrong tilt of an arm whose axes are parallel. Joint
    limits are used for slides only.
    """
    bounds = None if robot.chain.tree is not None else _reach(robot)
    if bounds is None:
        return np.zeros(len(target), dtype=bool)
    return bounds.excludes(target, tolerance * robot.length, tolerance)


@lru_cache
def _reach(robot: Robot) -> Reach | None:
    return Reach.of(robot)


def angle_between(a: Array, b: Array) -> Array:
    """Angle of unit vectors (…, 3), to the last digit also where they are parallel: (…,) rad."""
    result: Array = 2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))
    return result


def _nearest_points(points: Array, axes: Array) -> Array:
    """Points on the axes whose polygon is short: (k, 3).

    Weighted least squares, repeated; any choice gives bounds.
    """
    k = len(axes)
    sides = np.zeros((3 * (k - 1), k))  # ∂ sides / ∂ shifts along the axes
    for j in range(k - 1):
        sides[3 * j : 3 * j + 3, j], sides[3 * j : 3 * j + 3, j + 1] = -axes[j], axes[j + 1]
    shifts = np.zeros(k)
    start = np.diff(points, axis=0)
    for _ in range(100):
        lengths = np.linalg.norm(start + (sides @ shifts).reshape(-1, 3), axis=1)
        weights = np.repeat(1.0 / np.sqrt(np.maximum(lengths, 1e-6)), 3)
        shifts[:] = -np.linalg.lstsq(weights[:, None] * sides, weights * start.ravel(), rcond=None)[
            0
        ]
    return points + shifts[:, None] * axes


def _polygon(sides: Array, slack: float) -> tuple[float, float]:
    """Least and greatest closing side of a polygon with these sides and a `slack`."""
    most, longest = float(sides.sum()) + slack, float(sides.max(initial=0.0))
    return max(0.0, 2.0 * longest - most), most


def _outside(values: Array, bounds: tuple[float, float], slack: float) -> np.ndarray:
    return (values < bounds[0] - slack) | (values > bounds[1] + slack)
