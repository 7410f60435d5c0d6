"""Joint motions beyond the offsets: gear eccentricity, wind-up under gravity and backlash (METHOD §2, §7.2)."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
import pinocchio as pin

from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array, readonly

_CARRIES_LOAD = 0.02  # a joint carries load when its torque reaches this part of the largest joint's
_STANDS_STILL = 1e-6  # rad or m: a smaller move is rounding and turns no gear round


@dataclass(frozen=True, eq=False)
class JointMotion:
    """δq_j(q) = Σ_h a_jh sin(h q_j) + b_jh cos(h q_j) − c_j τ_g,j(q) − w_j d_j, beyond the constant offset.

    d_j is the direction of the joint's last motion (−1, 0, +1), see `directions`.

    harmonics   (n, 2H) a_j1, b_j1, a_j2, b_j2, … in rad; zero for prismatic joints
    compliance  (n,) c_j in rad per N m of `gravity_torque`; zero for joints that carry no load
    backlash    (n,) w_j, half width in rad or m
    """

    harmonics: Array
    compliance: Array
    backlash: Array

    @classmethod
    def none(cls, n: int) -> Self:
        """No such errors, for n joints."""
        return cls(readonly(np.zeros((n, 0))), readonly(np.zeros(n)), readonly(np.zeros(n)))

    @property
    def is_none(self) -> bool:
        """Whether no joint has such errors."""
        return not (self.harmonics.any() or self.compliance.any() or self.backlash.any())

    def errors(self, robot: Robot, q: Array, direction: Array | None = None) -> Array:
        """δq for joint positions q (N, n) and directions (N, n): (N, n) in rad. Without directions, the mean of both."""
        result = np.zeros_like(q)
        if self.harmonics.any():
            result += (harmonic_functions(q, self.harmonics.shape[1] // 2) * self.harmonics).sum(axis=-1)
        if self.compliance.any():
            result -= self.compliance * gravity_torque(robot, q)
        if direction is not None and self.backlash.any():
            result -= self.backlash * direction
        return result


def directions(q: Array, start: Array | None = None, before: Array | None = None) -> Array:
    """Sign −1, 0, +1 of each joint's last motion on the way through the rows of q (N, n), in order: (N, n).

    A joint that stands still stays on its side. start (n,): where it last counted as moved (`last_moved`) before the first
    row, and before (n,) the directions there; 0, unknown, until a joint has moved.
    """
    start = q[0] if start is None else start
    signs = np.sign(np.diff(last_moved(q, start), axis=0, prepend=start[None]))
    signs = np.concatenate([np.zeros((1, q.shape[1])) if before is None else before[None], signs])
    last = np.maximum.accumulate(np.where(signs != 0, np.arange(len(signs))[:, None], 0), axis=0)
    return np.take_along_axis(signs, last, axis=0)[1:]


def last_moved(q: Array, start: Array) -> Array:
    """Where each joint last counted as moved on the way through the rows of q (N, n), in order, from start (n,): (N, n).

    A joint counts as moved when it is farther than rounding from there: one that creeps does so every few rows.
    """
    places = q.copy()
    steps = np.abs(np.diff(q, axis=0, prepend=start[None]))
    for j in np.flatnonzero(((steps > 0.0) & (steps <= _STANDS_STILL)).any(axis=0)):
        place = float(start[j])
        for k, position in enumerate(q[:, j].tolist()):
            if abs(position - place) > _STANDS_STILL:
                place = position
            places[k, j] = place
    return places


def harmonic_functions(q: Array, count: int) -> Array:
    """sin q, cos q, sin 2q, cos 2q, … up to `count`, by the addition theorems: q (N, n) → (N, n, 2 count)."""
    result = np.empty((*q.shape, 2 * count))
    if not count:
        return result
    first = sine, cosine = np.sin(q), np.cos(q)
    for h in range(count):
        result[..., 2 * h], result[..., 2 * h + 1] = sine, cosine
        sine, cosine = sine * first[1] + cosine * first[0], cosine * first[1] - sine * first[0]
    return result


def gravity_torque(robot: Robot, q: Array) -> Array:
    """Generalised gravity τ_g(q), N m (N if prismatic): q (N, n) → (N, n). Pinocchio's `computeGeneralizedGravity`.

    With the URDF's masses; where it has none, with those of uniform links of 1 kg/m, of which only the shape of the
    function matters.
    """
    model = gravity_model(robot)
    data = model.createData()
    torque = np.empty((len(q), robot.n))
    for k, row in enumerate(robot.mechanism.configuration(q)):
        torque[k] = pin.computeGeneralizedGravity(model, data, row)
    return torque


@lru_cache
def gravity_model(robot: Robot) -> pin.Model:
    """The nominal Pinocchio model with the masses that `gravity_torque` uses."""
    model = robot.chain.model
    if sum(inertia.mass for inertia in model.inertias) > 0:
        return model
    model = model.copy()
    for j in range(1, robot.n + 1):
        link = robot.chain.placements[j, :3, 3]  # to the next joint, or to the tool
        model.inertias[j] = pin.Inertia(float(np.linalg.norm(link)), link / 2, np.zeros((3, 3)))
    return model


def link_masses(robot: Robot) -> tuple[Array, Array, Array]:
    """Masses (n,) kg, their centres (n, 3) in the joint frames, m, and gravity (3,) in K_0, m/s², of `gravity_torque`."""
    model = gravity_model(robot)
    masses = np.array([inertia.mass for inertia in list(model.inertias)[1:]])
    centres = np.array([inertia.lever for inertia in list(model.inertias)[1:]])
    return masses, centres, np.array(model.gravity.linear)


def load_carrying(robot: Robot) -> np.ndarray:
    """Revolute joints whose static torque matters, at least 2 % of the largest joint's: (n,) bool."""
    largest = largest_torque(robot)
    revolute = ~np.array(robot.prismatic)
    heavy = (largest > _CARRIES_LOAD * largest[revolute].max(initial=0.0)) & (largest > 1e-9)
    carrying: np.ndarray = revolute & heavy
    return carrying


@lru_cache
def largest_torque(robot: Robot) -> Array:
    """Largest |τ_g| of each joint over 500 fixed configurations of the whole joint range: (n,)."""
    rng = np.random.default_rng(0)
    q = robot.lower + (robot.upper - robot.lower) * rng.random((500, robot.n))
    return readonly(np.abs(gravity_torque(robot, q)).max(axis=0))
