"""Torques of the joints under the weight of the links."""

from functools import lru_cache

import numpy as np
import pinocchio as pin

from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly

_CARRIES_LOAD = (
    0.02  # a joint carries load when its torque reaches this part of the largest joint's
)


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
    return np.frombuffer(torques).reshape(len(q), robot.n)


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
    """Masses (n,) kg, their centres (n, 3) in the joint frames, m, and gravity (3,) in K_0, m/s²,
    of `gravity_torque`.
    """
    model = gravity_model(robot)
    masses = np.array([inertia.mass for inertia in list(model.inertias)[1:]])
    centres = np.array([inertia.lever for inertia in list(model.inertias)[1:]])
    return masses, centres, np.array(model.gravity.linear)


def load_carrying(robot: Robot) -> np.ndarray:
    """(n,) bool: revolute joints with at least 2 % of the largest static torque."""
    largest = largest_torque(robot)
    revolute = ~np.array(robot.prismatic)
    heavy = (largest > _CARRIES_LOAD * largest[revolute].max(initial=0.0)) & (largest > 1e-9)
    carrying: np.ndarray = revolute & heavy
    return carrying


@lru_cache
def largest_torque(robot: Robot) -> Array:
    """Largest |τ_g| of each joint over 500 fixed configurations of the whole joint range: (n,)."""
    rng = np.random.default_rng(0)
    q = robot.anywhere(500, rng)
    return readonly(np.abs(gravity_torque(robot, q)).max(axis=0))
