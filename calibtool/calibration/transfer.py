"""Transfer of a calibration to a new set-up: base and tool frame are fitted to a few rows."""

from dataclasses import dataclass, replace

import numpy as np

from calibtool.calibration.calibration import Calibration, check_same_robot
from calibtool.calibration.frame import on_base
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import UsageError
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import weighted_residuals
from calibtool.measurement.registration import register, rigid_fit
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import Array, exp6, inverse, log6, translation

REFITTED = ("base", "tool")


@dataclass(frozen=True)
class Transfer:
    """Errors on held-out rows, RMS per coordinate in m, of the nominal and of the calibrated robot,
    both with the same frames fitted.
    """

    nominal: float
    calibrated: float

    @property
    def still_helps(self) -> bool:
        """Whether the calibrated robot has the smaller error on held-out rows."""
        return self.calibrated < self.nominal


def refit(
    calibration: Calibration, measurements: Measurements, parts: tuple[str, ...]
) -> tuple[Calibration, Transfer]:
    """Fit base and/or tool frame of a calibration to new measurements, and compare with the nominal
    robot.

    The comparison leaves each row out in turn (at most 20 groups). In a known set-up the fitted
    frames become errors of the first and of the last placement; otherwise they are part of the
    set-up. Raises UsageError for parts other than base and tool.
    """
    unknown = [part for part in parts if part not in REFITTED]
    if unknown or not parts:
        raise UsageError(f"--refit: '{','.join(parts)}'; expected base, tool or base,tool")
    check_same_robot(calibration.robot, measurements.robot, "the calibration", "the measurements")
    free = replace(
        measurements.setup,
        frame_known=measurements.setup.frame_known and "base" not in parts,
        targets_known=measurements.setup.targets_known and "tool" not in parts,
    )
    pose = calibration.forward(measurements.q, measurements.conditions)
    setup = register(replace(measurements, setup=free), pose)
    nominal_pose = measurements.robot.mechanism.forward(measurements.q)
    transfer = Transfer(
        nominal=_left_out(measurements, free, nominal_pose),
        calibrated=_left_out(measurements, free, pose),
    )
    if measurements.setup.known:
        errors = _absorbed(calibration, measurements.setup, setup)
        base = replace(calibration.base, errors=errors, setup=measurements.setup, posterior=None)
        moved = replace(calibration, base=base, frame=None)
    else:
        restored = replace(
            setup,
            frame_known=measurements.setup.frame_known,
            targets_known=measurements.setup.targets_known,
        )
        if calibration.frame is not None:
            restored = calibration.frame.fitted_setup(restored)
        moved = replace(calibration, base=replace(calibration.base, setup=restored, posterior=None))
    return replace(moved, nominal_setup=measurements.setup), transfer


def _absorbed(calibration: Calibration, known: Setup, fitted: Setup) -> RobotErrors:
    """Base and tool as errors of the first and last placement, for poses in the known set-up."""
    chain, errors = calibration.robot.chain, calibration.errors
    placements = chain.placements @ exp6(errors["placements"])
    roots = on_base(calibration.robot)
    placements[roots] = (
        inverse(known.T_instrument_base) @ fitted.T_instrument_base @ placements[roots]
    )
    if len(known.targets) >= 3:
        placements[-1] = placements[-1] @ rigid_fit(known.targets, fitted.targets)
    else:
        placements[-1] = placements[-1] @ translation((fitted.targets - known.targets).mean(axis=0))
    return errors.having(placements=log6(inverse(chain.placements) @ placements))


def _left_out(measurements: Measurements, free: Setup, pose: Array) -> float:
    """RMS per coordinate, in m, on rows that the registration did not see."""
    count = len(measurements)
    squares = np.empty(count)
    for held in np.array_split(np.arange(count), min(count, 20)):
        rest = np.setdiff1d(np.arange(count), held)
        setup = register(replace(measurements.rows(rest), setup=free), pose[rest])
        squares[held] = (weighted_residuals(measurements.rows(held), setup, pose[held]) ** 2).sum(
            axis=-1
        )
    return float(np.sqrt(squares.sum() / measurements.equations)) * measurements.noise_position
