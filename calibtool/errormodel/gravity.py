"""Wind-up of the joints under the weight of the links: −c_j τ_g,j(q)."""

import numpy as np

from calibtool.errormodel.family import JointFunctions, Rows, Sizes, joint_list, sections_of_joints
from calibtool.errormodel.tolerances import Tolerances
from calibtool.robot.gravity_torque import largest_torque, load_carrying, turned_by_gravity
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array


class Gravity(JointFunctions):
    """Compliances c_j (n,) in rad per N m of `gravity_torque`; zero for joints that gravity does
    not turn."""

    id, symbol, ascii, kind = "gravity", "gravity", "gravity", "gravity"
    words, unit, size = "wind-up under gravity", "rad/(N m)", 0.5e-3
    meaning = "−c τ_g(q)"
    grows = False

    def free(self, robot: Robot, shape: tuple[int, ...]) -> np.ndarray:
        return turned_by_gravity(robot)

    def tolerance(self, robot: Robot, tolerances: Tolerances, shape: tuple[int, ...]) -> Array:
        """A wind-up in rad at the joint's largest torque, over that torque."""
        return tolerances.of.get(self.id, 1e-3) / np.maximum(largest_torque(robot), 1e-12)

    def sections(self, shape: tuple[int, ...]) -> np.ndarray:
        return sections_of_joints(shape)

    def display(self, robot: Robot, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
        return 1e3 * largest_torque(robot), ["mrad"] * robot.n

    def describe(self, robot: Robot, value: Array, free: np.ndarray) -> str:
        return f"gravity on {joint_list(free)}"

    def functions(self, shape: tuple[int, ...], rows: Rows) -> Array:
        return -rows.torque[..., None]

    def drawn(self, robot: Robot, sizes: Sizes, rng: np.random.Generator) -> Array:
        carrying, value = load_carrying(robot), np.zeros(robot.n)
        value[carrying] = sizes.size / largest_torque(robot)[carrying]
        return value
