"""Methods side by side on measurements: really driven to corrected joints where the truth is known, predicted otherwise."""

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np

from calibtool.calibration import Calibration, check_same_robot, fitting_setup
from calibtool.calibration.guard import coverage
from calibtool.compensation.program import OUTSIDE_POLICIES, OutsidePolicy, guarded
from calibtool.compensation.solve import NEAR_SINGULAR, OUT_OF_LIMITS, Method
from calibtool.errors import NoSolutionError, check_choice
from calibtool.evaluation.iso9283 import PoseTest, pose_test, repeated_poses
from calibtool.evaluation.metrics import MethodErrors, pose_statistics, summary
from calibtool.measurement.measurements import Measurements, Setup, Truth, determines_orientation
from calibtool.measurement.observation import measured_in_base, residuals
from calibtool.measurement.registration import register, rigid_fit
from calibtool.measurement.simulate import observe
from calibtool.robot.inverse import solve_poses
from calibtool.robot.se3 import Array, inverse, log3, transform_points


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The first method is the nominal robot.

    kind           `compensated`: the actual robot was driven to the corrected joints and observed without noise;
                   `predicted`: what is left between measured and predicted target points
    marked         (methods,) how many rows of the compensation were near a singularity or out of limits
    outside        (methods,) how many rows are unlike the configurations of the training
    uncorrectable  what stays whatever the method, a row for every pose that the actual robot cannot take (n < 6, or out of
                   reach of an arm that is shorter than drawn): nearest pose against commanded one; None where every pose
                   can be taken, or that is not known
    correctable    the methods' errors against the nearest pose that the actual robot can take; `methods` where
                   `uncorrectable` is None
    pose_test      ISO 9283, from the measured points, where configurations were measured repeatedly; else None
    """

    robot: str
    configurations: int
    kind: Literal["compensated", "predicted"]
    methods: list[MethodErrors]
    marked: list[int]
    outside: list[int] = field(default_factory=list)
    uncorrectable: MethodErrors | None = None
    correctable: list[MethodErrors] = field(default_factory=list)
    pose_test: PoseTest | None = None

    def as_json(self) -> dict[str, object]:
        """The object that `evaluate --json` prints (a contract of DESIGN).

        Statistics are those of the whole errors, reductions those of the correctable part.
        """
        parts = self.correctable or self.methods
        result: dict[str, object] = {
            "schema": "calibtool/evaluation",
            "schema_version": 1,
            "robot": self.robot,
            "configurations": self.configurations,
            "kind": self.kind,
            "methods": [summary(part, parts[0], whole) for part, whole in zip(parts, self.methods, strict=True)],
        }
        if self.uncorrectable is not None:
            count = len(self.uncorrectable.position)
            result["uncorrectable"] = {"configurations": count, **pose_statistics(self.uncorrectable)}
        if self.pose_test is not None:
            result["iso9283"] = self.pose_test.as_json()
        return result


def evaluate(
    calibrations: list[tuple[str, Calibration]],
    measurements: Measurements,
    *,
    method: Method = "exact",
    refit_setup: bool = False,
    outside: OutsidePolicy = "mark",
) -> Evaluation:
    """Errors of the nominal robot and of every one of `calibrations`, named, at the configurations of `measurements`.

    outside: what to do at configurations unlike those of the training: count them, predict them by the base model alone,
    or refuse.
    refit_setup: fit unknown instrument frame and targets again on these rows, for every method alike (a moved tracker);
    otherwise the set-up that belongs to the training is used and nothing is fitted here.
    Raises InputError when a calibration is for another robot, UsageError for an unknown method or policy, NoSolutionError
    where `refuse` refuses.
    """
    check_choice(method, get_args(Method), "method")
    check_choice(outside, OUTSIDE_POLICIES, "outside")
    for name, given in calibrations:
        check_same_robot(given.robot, measurements.robot, f"calibration '{name}'", "the measurements")
    measurements = judged_rows(measurements)
    every: list[tuple[str, Calibration | None]] = [("nominal", None), *calibrations]
    methods, correctable, marked, far = [], [], [], []
    nearest, uncorrectable = _nearest_poses(measurements)
    for name, calibration in every:
        count = 0
        unlike = np.zeros(len(measurements), dtype=bool)
        if calibration is not None:
            unlike = coverage(calibration, measurements.q).outside
            if outside == "refuse" and unlike.any():
                raise NoSolutionError(f"{name}: {int(unlike.sum())} configurations are outside those of the training")
        if measurements.truth is not None:
            errors, part, count = _compensated(
                name, calibration, measurements, measurements.truth, nearest, method, outside
            )
            correctable.append(part)
        else:
            first = calibrations[0][1] if calibrations else None
            errors = _predicted(name, calibration, first, measurements, refit_setup, outside)
        methods.append(errors)
        marked.append(count)
        far.append(int(unlike.sum()))
    return Evaluation(
        robot=measurements.robot.name,
        configurations=len(measurements),
        kind="predicted" if measurements.truth is None else "compensated",
        methods=methods,
        marked=marked,
        outside=far,
        uncorrectable=uncorrectable,
        correctable=correctable,
        pose_test=_pose_test(every, measurements, methods, refit_setup, outside),
    )


def judged_rows(measurements: Measurements) -> Measurements:
    """The rows that `evaluate` judges: a prediction needs whole observations, a simulation can be driven again."""
    if measurements.truth is not None:
        return measurements
    return measurements.rows(np.flatnonzero(measurements.seen.all(axis=-1)))


def _pose_test(
    every: list[tuple[str, Calibration | None]],
    measurements: Measurements,
    methods: list[MethodErrors],
    refit: bool,
    outside: OutsidePolicy,
) -> PoseTest | None:
    """ISO 9283 where configurations were repeated: from the measured points, which a noiseless drive does not have."""
    measurements = measurements.rows(np.flatnonzero(measurements.seen.all(axis=-1)))
    poses = repeated_poses(measurements.q, measurements.robot.mechanism.forward(measurements.q)[:, :3, 3])
    if not poses:
        return None
    if measurements.truth is not None:
        first = every[1][1] if len(every) > 1 else None
        methods = [_predicted(name, calibration, first, measurements, refit, outside) for name, calibration in every]
    return pose_test(methods, poses)


def _compensated(
    name: str,
    calibration: Calibration | None,
    measurements: Measurements,
    truth: Truth,
    nearest: Array | None,
    method: Method,
    outside: OutsidePolicy,
) -> tuple[MethodErrors, MethodErrors, int]:
    """The whole errors, those against the nearest poses, and how many corrections are doubtful."""
    robot, q = measurements.robot, measurements.q
    marked = 0
    if calibration is None:
        driven, setup = q, measurements.setup
    else:
        setup = fitting_setup(calibration, measurements)
        driven = np.empty_like(q)
        for conditions, rows in measurements.conditions.alike(len(q)):
            result = guarded(calibration, q[rows], None, method, outside, conditions=conditions)
            driven[rows] = result.q
            marked += int(np.isin(result.status, (NEAR_SINGULAR, OUT_OF_LIMITS)).sum())
        driven = driven + calibration.base.errors["backlash"] * truth.actual.directions(driven)
    commanded = robot.mechanism.forward(q)
    if measurements.setup.known:
        actual = truth.actual.forward(driven, measurements.conditions)
        errors = _pose_errors(name, actual, commanded)
        return errors, errors if nearest is None else _pose_errors(name, actual, nearest), marked
    # Commanded poses live in the registered frame: compare target points there, as an instrument would.
    seen = transform_points(
        inverse(setup.T_instrument_base), observe(truth.actual, truth.setup, driven, measurements.conditions)
    )
    errors = _from_points(name, seen, commanded, setup)
    return errors, errors, marked


def _nearest_poses(measurements: Measurements) -> tuple[Array | None, MethodErrors | None]:
    """Nearest poses to the commanded ones that the actual robot can take, and how far they stay; None if all can be taken.

    Only where truth and set-up are known: an estimated instrument frame moves the commanded poses with the method.
    """
    truth, robot, q = measurements.truth, measurements.robot, measurements.q
    if truth is None or not measurements.setup.known:
        return None, None
    commanded = robot.mechanism.forward(q)
    # Motion errors of the joints do not change which poses can be taken, only where the joints have to go.
    solved = solve_poses(
        truth.actual.mechanism.forward_and_jacobian, commanded, q, length=robot.length, max_iterations=300, descend=True
    )
    if solved.reached.all():
        return None, None
    beyond = ~solved.reached
    nearest = commanded.copy()
    nearest[beyond] = truth.actual.mechanism.forward(solved.q[beyond])
    return nearest, _pose_errors("uncorrectable", nearest[beyond], commanded[beyond])


def _pose_errors(name: str, pose: Array, reference: Array) -> MethodErrors:
    """Displacements of the tool origin and rotations from reference poses (N, 4, 4)."""
    turn = log3(pose[:, :3, :3] @ np.swapaxes(reference[:, :3, :3], -1, -2))
    return MethodErrors(name, (pose - reference)[:, None, :3, 3], turn)


def _predicted(
    name: str,
    calibration: Calibration | None,
    first: Calibration | None,
    measurements: Measurements,
    refit: bool,
    outside: OutsidePolicy,
) -> MethodErrors:
    robot, q, conditions = measurements.robot, measurements.q, measurements.conditions
    pose = robot.mechanism.forward(q) if calibration is None else calibration.forward(q, conditions)
    if calibration is not None and calibration.networks and outside == "base":
        unlike = coverage(calibration, q).outside
        alone = replace(calibration, networks=())
        pose[unlike] = alone.forward(q[unlike], conditions.rows(unlike))
    if measurements.setup.known:
        setup = measurements.setup
    elif refit:
        setup = register(measurements, pose)
    elif calibration is not None:
        setup = fitting_setup(calibration, measurements)
    else:
        setup = measurements.setup if first is None else first.nominal_setup
    points, rotations = measured_in_base(measurements, setup)
    if rotations is None:
        return _from_points(name, points, pose, setup)
    left = residuals(measurements, setup, pose)
    return MethodErrors(name, left[:, None, :3], left[:, 3:])


def _from_points(name: str, points: Array, pose: Array, setup: Setup) -> MethodErrors:
    """Errors of target points (N, m, 3) in K_0 against those of poses; the turn is that of the best rigid fit."""
    expected = transform_points(pose, setup.targets)
    turn = log3(rigid_fit(expected, points)[:, :3, :3]) if determines_orientation(setup.targets) else None
    return MethodErrors(name, points - expected, turn)
