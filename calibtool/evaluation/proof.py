"""Verification on the robot: commanded against measured poses, before and after a correction.

The points were measured while the robot was driven to corrected joints (`Measurements.commanded`).
Errors that the model predicts there are reported beside them as expected.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibtool.calibration import Calibration, fitting_setup
from calibtool.compensation.solve import compensate_poses
from calibtool.errors import InputError
from calibtool.evaluation.metrics import MethodErrors, pose_statistics
from calibtool.evaluation.observed import errors_against, point_errors
from calibtool.evaluation.pose_test import PoseTest, measured_pose_test, repeated_poses
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.registration import register
from calibtool.measurement.setup import Setup
from calibtool.robot.inverse import inverse_kinematics
from calibtool.robot.se3 import Array, pose_difference, pose_distances, transform_points

Before = Literal["measured", "expected"]

_SAME_COMMAND = 1e-5  # m and rad: joints are written with four decimals of a degree
# of the largest correction: farther from the calibration's own joints, driven joints are not
# plausible
_PLAUSIBLE = 0.5
_SMALLEST = 3.0  # times the stated noise: differences below this are accepted
_LISTED = 5


@dataclass(frozen=True, eq=False)
class Proof:
    """Commanded against measured target points, one row per configuration.

    before           the arm driven to the commands without correction: measured, or expected by the
    model
    after            the arm driven to the corrected joints, measured
    expected         what the model expects there, after correction
    before_measured  whether the errors before the correction were measured
    pose_test        AP of before and after, RP of the measured ones; None without repeats
    """

    before: MethodErrors
    after: MethodErrors
    expected: MethodErrors
    before_measured: bool
    pose_test: PoseTest | None

    @property
    def before_is(self) -> Before:
        """How `before` was obtained: measured, or expected by the model."""
        return "measured" if self.before_measured else "expected"

    def as_json(self) -> dict[str, object]:
        """The keys that kind `measured` adds to `evaluate --json`."""
        return {
            "before": self.before_is,
            "expected": {"name": self.expected.name, **pose_statistics(self.expected)},
        }


def prove(
    name: str,
    calibration: Calibration,
    after: Measurements,
    before: Measurements | None = None,
    *,
    refit_setup: bool = False,
) -> Proof:
    """Before and after of a correction by `calibration`, from rows that hold commanded poses.

    before: the same commands in the same order, measured without this correction. refit_setup: an
    unknown instrument frame and unknown targets are fitted again, separately to each of the two.
    Raises InputError where the driven joints cannot be those that the calibration asks for, or
    the rows of before and after had different commands.
    """
    commanded = after.commanded
    assert commanded is not None
    robot = calibration.robot
    q = inverse_kinematics(robot, commanded, after.q).q
    pose = calibration.forward(after.q, after.conditions)
    setup = _setup(calibration, after, pose, refit_setup)
    uncorrected = _expected("nominal", calibration.forward(q), commanded, setup)
    expected = _expected(name, pose, commanded, setup)
    _check_driven(name, calibration, after, setup, uncorrected)
    if before is not None:
        earlier = _commanded_alike(before, commanded)
        model = calibration.forward(before.q, before.conditions)
        place = _setup(calibration, before, model, refit_setup)
        uncorrected = errors_against("nominal", before, place, earlier)
    measured = errors_against(name, after, setup, commanded)
    groups = repeated_poses(commanded[:, :3].reshape(len(after), 12), commanded[:, :3, 3])
    test = None
    if groups:
        test = measured_pose_test(uncorrected, measured, groups, before_measured=before is not None)
    return Proof(uncorrected, measured, expected, before is not None, test)


def _setup(calibration: Calibration, measurements: Measurements, pose: Array, refit: bool) -> Setup:
    if refit and not measurements.setup.known:
        return register(measurements, pose)
    return fitting_setup(calibration, measurements)


def _expected(name: str, pose: Array, commanded: Array, setup: Setup) -> MethodErrors:
    """Errors of poses (N, 4, 4) against commanded ones, as the instrument of a set-up sees them."""
    errors = point_errors(name, transform_points(pose, setup.targets), commanded, setup)
    if setup.kind.id == "points":
        return errors
    return replace(errors, orientation=pose_difference(pose, commanded)[:, 3:])


def _commanded_alike(before: Measurements, commanded: Array) -> Array:
    """Commanded poses of `before` (N, 4, 4). InputError unless they are those of the other rows."""
    if len(before) != len(commanded):
        raise InputError(
            f"the measurements: {len(before)} rows before the correction, {len(commanded)} after "
            "it; both need the same commands in the same order"
        )
    if not before.seen.all():
        row = int(np.argmin(before.seen.all(axis=-1))) + 1
        raise InputError(
            f"the measurements before the correction: row {row} lacks a target; measure it again"
        )
    earlier = before.commanded
    if earlier is None:
        earlier = before.robot.mechanism.forward(before.q)
    apart, turned = pose_distances(earlier, commanded)
    wrong = np.flatnonzero(np.maximum(apart, turned) > _SAME_COMMAND)
    if len(wrong):
        raise InputError(
            f"the measurements before the correction: row {wrong[0] + 1} was commanded "
            f"{apart[wrong[0]] * 1e3:.3g} mm from that row after it; both need the "
            "same commands in the same order"
        )
    return earlier


def _check_driven(
    name: str,
    calibration: Calibration,
    after: Measurements,
    setup: Setup,
    uncorrected: MethodErrors,
) -> None:
    """InputError where driven joints are far from those that the calibration asks for."""
    assert after.commanded is not None
    own = compensate_poses(calibration, after.commanded, after.q)
    judged = np.flatnonzero(np.isfinite(own.q).all(axis=-1))
    predicted = calibration.forward(own.q[judged])
    driven = calibration.forward(after.q, after.conditions)[judged]
    apart = _expected(name, driven, predicted, setup).position_size
    correction = float(uncorrected.position_size[judged].max(initial=0.0))
    far = apart > max(_PLAUSIBLE * correction, _SMALLEST * calibration.noise_position)
    if far.any():
        rows = judged[far] + 1
        listed = ", ".join(map(str, rows[:_LISTED])) + (" …" if len(rows) > _LISTED else "")
        raise InputError(
            f"the measurements: {int(far.sum())} of {len(after)} rows were driven to other joints "
            f"than '{name}' asks for (row {listed}), up to {apart.max() * 1e3:.3g} mm away where "
            f"its corrections are at most {correction * 1e3:.3g} mm; are calibration, frame and "
            "commanded rows those of the correction?"
        )
