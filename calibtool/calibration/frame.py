"""Base and tool frame of a calibration where the measurements do not determine them.

With an unknown instrument frame and unknown targets, T_instrument_base · T_base_tool(q) · t does
not change when the base or the tool frame is moved and the set-up is moved accordingly. Programs
are taught in the frames of the controller, so that corrections are made in the frames that move the
commanded poses least (`taught`), or in those of the fit (`fitted`).
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.measurement.setup import Setup
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, adjoint, exp6, inverse, log6, pose_difference, readonly
from calibtool.robot.singularity import at_point

FrameName = Literal["fitted", "taught"]
FRAMES: tuple[str, ...] = get_args(FrameName)
_STEPS, _SETTLED = 20, 1e-13  # of Gauss–Newton, m and rad; it takes three or four


@dataclass(frozen=True, eq=False)
class ChosenFrame:
    """Base and tool frame in which a calibration states its poses.

    T_taught(q) = T_taught_fitted · T_fitted(q) · T_tool_taught, poses of the tool in the base.

    name             `fitted` or `taught`
    T_taught_fitted  (4, 4) base frame of the fit in the taught base frame, m
    T_tool_taught    (4, 4) taught tool frame in the tool frame of the fit, m
    """

    name: FrameName
    T_taught_fitted: Array
    T_tool_taught: Array

    @property
    def moves(self) -> bool:
        """Whether poses in the chosen frames differ from those of the fit."""
        return self.name != "fitted"

    def errors(self, fitted: RobotErrors) -> RobotErrors:
        """Errors of the fit in the chosen frames: those of the placements on the base and of the
        tool change."""
        if not self.moves:
            return fitted
        nominal = fitted.robot.chain.placements
        placements = nominal @ exp6(fitted["placements"])
        roots = on_base(fitted.robot)
        placements[roots] = self.T_taught_fitted @ placements[roots]
        placements[-1] = placements[-1] @ self.T_tool_taught
        return fitted.having(placements=log6(inverse(nominal) @ placements))

    def setup(self, fitted: Setup) -> Setup:
        """Set-up of the fit in the chosen frames: predicted observations do not change."""
        return (
            moved_setup(fitted, self.T_taught_fitted, self.T_tool_taught) if self.moves else fitted
        )

    def fitted_setup(self, chosen: Setup) -> Setup:
        """The inverse of `setup`."""
        if not self.moves:
            return chosen
        return moved_setup(chosen, inverse(self.T_taught_fitted), inverse(self.T_tool_taught))


def on_base(robot: Robot) -> np.ndarray:
    """Which placements stand on the base: the first, or with closed loops several (k,)."""
    return np.flatnonzero(np.array(robot.chain.placed_on) < 0)


def moved_setup(setup: Setup, T_new_base: Array, T_tool_new: Array) -> Setup:
    """Set-up in which T_new_base · T_base_tool(q) · T_tool_new is observed as T_base_tool(q) was
    before.

    T_new_base and T_tool_new: (4, 4), m.
    """
    on_tool = setup.kind.in_tool(setup, inverse(T_tool_new))
    return setup.kind.in_base(on_tool, T_new_base)


def taught_frame(
    fitted: Array, taught: Array, setup: Setup, noise_position: float, noise_orientation: float
) -> ChosenFrame:
    """The frames in which fitted poses (N, 4, 4) are nearest to taught poses (N, 4, 4).

    Least squares of the pose errors: positions in units of noise_position (m), rotations in units
    of noise_orientation (rad). Free are the base frame where the instrument frame is unknown, and
    the tool frame where the targets are. Where both have the same effect (few joints, one
    configuration), the solution of minimum norm is taken.
    """
    T_base, T_tool = np.eye(4), np.eye(4)
    free = np.flatnonzero([not setup.frame_known, not setup.targets_known])
    sigma = pose_sigma(noise_position, noise_orientation)
    for _ in range(_STEPS):
        pose = T_base @ fitted @ T_tool
        columns = free_columns(pose, setup) / sigma[:, None]
        residual = pose_difference(taught, pose) / sigma
        step = np.zeros((2, 6))
        step[free] = np.linalg.lstsq(
            columns.reshape(residual.size, -1), residual.ravel(), rcond=1e-9
        )[0].reshape(-1, 6)
        T_base, T_tool = exp6(step[0]) @ T_base, T_tool @ exp6(step[1])
        if np.abs(step).max() < _SETTLED:
            break
    return ChosenFrame("taught", readonly(T_base), readonly(T_tool))


def free_columns(pose: Array, setup: Setup) -> Array:
    """Derivatives of poses (N, 4, 4) with respect to the free frames: (N, 6, 0, 6 or 12).

    Rows: displacement of the tool point (m) and rotation vector (rad) in K_0. Columns: a twist b of
    the base, exp6(b) T, where the instrument frame is unknown; a twist x of the tool, T exp6(x),
    where the targets are unknown.
    """
    base = np.broadcast_to(np.eye(6), (len(pose), 6, 6))
    blocks = [base] * (not setup.frame_known) + [adjoint(pose)] * (not setup.targets_known)
    return at_point(np.concatenate([*blocks, np.zeros((len(pose), 6, 0))], axis=-1), pose[:, :3, 3])


def pose_sigma(noise_position: float, noise_orientation: float) -> Array:
    """The unit of each component of a pose error: (6,), m and rad."""
    return np.repeat([noise_position, noise_orientation], 3)
