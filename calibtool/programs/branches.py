"""Joint positions for the poses of a program: inverse kinematics on the branch that the configuration data mean."""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from calibtool.programs.configurations import Configuration, Posture, has_postures, posture
from calibtool.robot.coupling import JointValues
from calibtool.robot.inverse import inverse_kinematics, solve_poses
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array, readonly

_STARTS = 96  # random starts that find the branches of a pose
_REACHED = 1e-8


@dataclass(frozen=True, eq=False)
class Controller:
    """The nominal robot as its controller counts joints: q_serial = coupling @ q_controller, coupling (n, n)."""

    robot: Robot
    coupling: Array

    @cached_property
    def zero(self) -> Posture:
        """The branch with all of the controller's joint values at zero. For six-joint arms."""
        return posture(self.robot, self.to_serial(np.zeros(self.robot.n)), np.zeros(self.robot.n))

    def to_serial(self, q: Array) -> Array:
        """Joint positions of the serial chain for the controller's joint values, (…, n) both."""
        return q @ self.coupling.T

    def to_controller(self, q: Array) -> Array:
        """The controller's joint values for joint positions of the serial chain, (…, n) both."""
        return q @ np.linalg.inv(self.coupling).T


def coupling_of(robot: Robot, program_format: str, joint_values: JointValues | None) -> Array:
    """What stands between a program's joint values and the serial chain, (n, n).

    `controller`: the robot's own coupling; without one, FANUC six-joint arms state J3 against the horizontal: q3 = J3 + J2.
    `serial`: the program's values are the chain's. None: `controller` for FANUC programs, `serial` for the others.
    """
    if joint_values == "serial" or (joint_values is None and program_format != "fanuc-ls"):
        return readonly(np.eye(robot.n))
    coupling = robot.coupling.copy()
    if not robot.coupled and program_format == "fanuc-ls" and has_postures(robot):
        coupling[2, 1] = 1.0
    return readonly(coupling)


def solve_pose(
    controller: Controller, T_base_tool: Array, configuration: Configuration | None, q_near: Array | None
) -> Array | str:
    """Joint positions (n,) of the nominal robot within its limits for one pose (4, 4), or why there are none.

    configuration: the branch and turns that are asked for; without it the answer near `q_near`, the target before (None:
    the home of the default workspace).
    """
    robot = controller.robot
    start = robot.home(robot.workspace(None)[1]) if q_near is None else q_near
    solved = inverse_kinematics(robot, T_base_tool[None], start)
    if not solved.reached[0]:
        return f"the pose is unreachable ({solved.position[0] * 1e3:.3g} mm are missing)"
    if configuration is None:
        nearest: Array = solved.q[0]
        return nearest
    if not has_postures(robot):
        return f"the configuration {configuration.text} is that of a six-joint arm, and {robot.name} is none"

    def wanted(q: Array) -> Array | None:
        if not configuration.branch(posture(robot, q, controller.to_controller(q)), controller.zero):
            return None
        return next(
            (turned for turned in _turns(robot, q) if configuration.turns(controller.to_controller(turned))), None
        )

    found = wanted(solved.q[0])
    if found is not None:
        return found
    rng = np.random.default_rng(0)
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    starts = low + (high - low) * rng.random((_STARTS, robot.n))
    answers = solve_poses(
        robot.mechanism.forward_and_jacobian,
        np.repeat(T_base_tool[None], _STARTS, axis=0),
        starts,
        length=robot.length,
        lower=robot.lower,
        upper=robot.upper,
    )
    others = answers.q[answers.reached]
    for q in others[np.argsort(np.linalg.norm(others - start, axis=-1))]:
        found = wanted(q)
        if found is not None:
            return found
    return f"the pose cannot be reached with the configuration {configuration.text}"


def _turns(robot: Robot, q: Array) -> list[Array]:
    """The same pose with whole turns added where the limits allow it, nearest first."""
    choices = []
    for angle, low, high in zip(q, robot.lower, robot.upper, strict=True):
        turns = [angle + 2 * np.pi * k for k in (0, -1, 1, -2, 2)]
        choices.append([t for t in turns if low - 1e-9 <= t <= high + 1e-9] or [angle])
    answers = [np.array(combination) for combination in product(*choices)]
    return sorted(answers, key=lambda answer: float(np.abs(answer - q).sum()))
