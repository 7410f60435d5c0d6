"""Torques of the joints under the weight of the links."""

from functools import lru_cache

import numpy as np
import pinocchio as pin

from calibtool.robot.closed import ClosedMechanism
from calibtool.robot.mechanism import Frames
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly

_CARRIES_LOAD = 0.02  # of the largest joint's torque: joints with at least this carry load
_TURNS = 1e-6  # of the largest joint's torque: less is rounding


def gravity_torque(robot: Robot, q: Array) -> Array:
    """Generalised gravity τ_g(q), N m (N if prismatic): q (N, n) → (N, n).

    Pinocchio's `computeGeneralizedGravity`. With the URDF's masses; where it has none, with those
    of uniform links of 1 kg/m, of which only the shape of the function matters.
    """
    model = gravity_model(robot)
    data = model.createData()
    torque, torques, move = data.g.data, bytearray(), pin.computeGeneralizedGravity
    for row in robot.mechanism.configuration(q):
        move(model, data, row)
        torques += torque
    found = np.frombuffer(torques).reshape(len(q), model.nv)
    if isinstance(robot.mechanism, ClosedMechanism):  # virtual work
        return robot.mechanism.by_actuators(found, q)
    return found


@lru_cache
def gravity_model(robot: Robot) -> pin.Model:
    """The nominal Pinocchio model with the masses that `gravity_torque` uses."""
    model = robot.chain.model
    if sum(inertia.mass for inertia in model.inertias) > 0:
        return model
    model = model.copy()
    if isinstance(robot.mechanism, ClosedMechanism):
        _add_links(model, robot.mechanism)
        return model
    for j in range(1, robot.n + 1):
        link = robot.chain.placements[j, :3, 3]  # to the next joint, or to the tool
        model.inertias[j] = pin.Inertia(float(np.linalg.norm(link)), link / 2, np.zeros((3, 3)))
    return model


def _add_links(model: pin.Model, mechanism: ClosedMechanism) -> None:
    """Uniform links of 1 kg/m from every joint to the next ones."""
    placed_on, ids = mechanism.tree.placed_on, mechanism.model_joints
    for carrier, placement in zip(placed_on, mechanism.placements, strict=True):
        link = placement[:3, 3]
        if carrier >= 0 and link.any():
            part = pin.Inertia(float(np.linalg.norm(link)), link / 2, np.zeros((3, 3)))
            joint = int(ids[carrier]) + 1
            model.inertias[joint] = model.inertias[joint] + part


def link_masses(robot: Robot) -> tuple[Array, Array, Array]:
    """Masses (n,) kg, centres (n, 3) in joint frames, m, gravity (3,) in K_0, of
    `gravity_torque`.
    """
    model = gravity_model(robot)
    masses = np.array([inertia.mass for inertia in list(model.inertias)[1:]])
    centres = np.array([inertia.lever for inertia in list(model.inertias)[1:]])
    return masses, centres, np.array(model.gravity.linear)


def weight_moments(robot: Robot, frames: Frames) -> Array:
    """Moments of the weight beyond each joint about the origin of F0_j, in K_0: (N, n, 3) N m."""
    masses, centres, gravity = link_masses(robot)
    after = frames.after
    first = (after[..., :3, :3] @ centres[..., None])[..., 0] + after[..., :3, 3]
    first = np.cumsum((masses[:, None] * first)[:, ::-1], axis=1)[:, ::-1]
    mass = np.cumsum(masses[::-1])[::-1]
    return np.cross(first - mass[:, None] * frames.before[..., :3, 3], gravity)


def load_carrying(robot: Robot) -> np.ndarray:
    """Revolute joints with a static torque of at least 2 % of the largest joint's: (n,) bool."""
    return _reaching(robot, _CARRIES_LOAD)


def turned_by_gravity(robot: Robot) -> np.ndarray:
    """Revolute joints that gravity turns at all, independent of the masses: (n,) bool."""
    return _reaching(robot, _TURNS)


def _reaching(robot: Robot, part: float) -> np.ndarray:
    largest = largest_torque(robot)
    revolute = ~np.array(robot.prismatic)
    reaching: np.ndarray = (
        revolute & (largest > part * largest[revolute].max(initial=0.0)) & (largest > 1e-9)
    )
    return reaching


@lru_cache
def largest_torque(robot: Robot) -> Array:
    """Largest |τ_g| of each joint over 500 fixed configurations of the whole joint range: (n,)."""
    rng = np.random.default_rng(0)
    q = robot.closing(robot.anywhere(500, rng))
    return readonly(np.abs(gravity_torque(robot, q)).max(axis=0))
