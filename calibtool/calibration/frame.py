"""Base and tool frame of a calibration where the measurements leave them free: fitted or taught.

With an unknown instrument frame and unknown targets, T_instrument_base · T_base_tool(q) · t stays
what it is when the base or the tool frame moves and the set-up moves along. Programs were taught
in the controller's frames, so corrections belong into the frames that move commanded poses least.
"""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.measurement.measurements import Setup
from calibtool.robot.damped import at_point
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array, adjoint, exp6, inverse, log3, log6, readonly

FrameName = Literal["fitted", "taught"]
FRAMES: tuple[str, ...] = get_args(FrameName)
_STEPS, _SETTLED = 20, 1e-13  # of Gauss–Newton, m and rad; it takes three or four


@dataclass(frozen=True, eq=False)
class ChosenFrame:
    """Which frames a calibration speaks in.

    T_taught(q) = T_taught_fitted · T_fitted(q) · T_tool_taught, poses of the tool in the base.

    name             the chosen ones, `fitted` or `taught`
    T_taught_fitted  (4, 4) base of the fit in the taught base frame, m
    T_tool_taught    (4, 4) taught tool frame in the tool of the fit, m
    """

    name: FrameName
    T_taught_fitted: Array
    T_tool_taught: Array

    @property
    def moves(self) -> bool:
        """Poses in the chosen frames are not those of the fit."""
        return self.name != "fitted"

    def errors(self, fitted: RobotErrors) -> RobotErrors:
        """The errors of the fit in the chosen frames: what stands on the base, and the tool, move."""
        if not self.moves:
            return fitted
        nominal = fitted.robot.chain.placements
        placements = nominal @ exp6(fitted["placements"])
        roots = on_base(fitted.robot)
        placements[roots] = self.T_taught_fitted @ placements[roots]
        placements[-1] = placements[-1] @ self.T_tool_taught
        return fitted.having(placements=log6(inverse(nominal) @ placements))

    def setup(self, fitted: Setup) -> Setup:
        """The set-up of the fit in the chosen frames: predicted points stay where they were."""
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
    """The set-up with which T_new_base · T_base_tool(q) · T_tool_new is seen as T_base_tool(q) was.

    Both (4, 4), m.
    """
    T_new_tool = inverse(T_tool_new)
    on_tool = setup.kind.in_tool(setup, T_new_tool)
    return replace(
        on_tool, T_instrument_base=readonly(setup.T_instrument_base @ inverse(T_new_base))
    )


def taught_frame(
    fitted: Array, taught: Array, setup: Setup, noise_position: float, noise_orientation: float
) -> ChosenFrame:
    """The frames in which fitted poses (N, 4, 4) are nearest to the taught ones (N, 4, 4).

    Least squares of the pose error, position in units of noise_position (m), orientation of
    noise_orientation (rad), over what the set-up leaves unknown: the base frame where the
    instrument's is, the tool frame where the targets are. Where base and tool can do the same
    (few joints, one configuration), both together move least.
    """
    T_base, T_tool = np.eye(4), np.eye(4)
    free = np.flatnonzero([not setup.frame_known, not setup.targets_known])
    sigma = pose_sigma(noise_position, noise_orientation)
    for _ in range(_STEPS):
        pose = T_base @ fitted @ T_tool
        columns = free_columns(pose, setup) / sigma[:, None]
        turn = log3(taught[:, :3, :3] @ np.swapaxes(pose[:, :3, :3], -1, -2))
        left = np.concatenate([taught[:, :3, 3] - pose[:, :3, 3], turn], axis=-1) / sigma
        step = np.zeros((2, 6))
        step[free] = np.linalg.lstsq(columns.reshape(left.size, -1), left.ravel(), rcond=1e-9)[
            0
        ].reshape(-1, 6)
        T_base, T_tool = exp6(step[0]) @ T_base, T_tool @ exp6(step[1])
        if np.abs(step).max() < _SETTLED:
            break
    return ChosenFrame("taught", readonly(T_base), readonly(T_tool))


def free_columns(pose: Array, setup: Setup) -> Array:
    """How poses (N, 4, 4) move with the frames that a set-up leaves free: (N, 6, 0, 6 or 12).

    Displacement of the tool point (m) and turn (rad) in K_0: for a twist b of the base, exp6(b) T,
    where the instrument frame is unknown; for a twist x of the tool, T exp6(x), where the targets
    are.
    """
    base = np.broadcast_to(np.eye(6), (len(pose), 6, 6))
    blocks = [base] * (not setup.frame_known) + [adjoint(pose)] * (not setup.targets_known)
    return at_point(np.concatenate([*blocks, np.zeros((len(pose), 6, 0))], axis=-1), pose[:, :3, 3])


def pose_sigma(noise_position: float, noise_orientation: float) -> Array:
    """The unit of each component of a pose error: (6,), m and rad."""
    return np.repeat([noise_position, noise_orientation], 3)
