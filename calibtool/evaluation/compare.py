"""Evaluation of methods on measurements, side by side with the nominal robot."""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from calibtool.calibration import Calibration, check_same_robot, fitting_setup, identify
from calibtool.calibration.guard import coverage
from calibtool.compensation.bounds import Bounds
from calibtool.compensation.exact import exact
from calibtool.compensation.solve import Method
from calibtool.compensation.status import DOUBTFUL
from calibtool.compensation.targets import OUTSIDE_POLICIES, OutsidePolicy, guarded
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import InputError, NoSolutionError, UsageError, check_choice
from calibtool.evaluation.metrics import MethodErrors, MethodResult, pose_statistics, summary
from calibtool.evaluation.observed import errors_against, point_errors
from calibtool.evaluation.pose_test import PoseTest, pose_test, repeated_poses
from calibtool.evaluation.proof import Before, Proof, prove
from calibtool.measurement.measurements import Measurements, Truth
from calibtool.measurement.registration import register
from calibtool.measurement.simulate import observe
from calibtool.robot.inverse import solve_poses
from calibtool.robot.se3 import Array, inverse, log6, pose_difference, transform_points

_BEHIND = 1e4  # m: so far away is what a camera would have to see behind it
_UNBOUNDED = Bounds(np.inf, (np.inf, np.inf))

Kind = Literal["compensated", "predicted", "measured"]


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation:
    """Methods side by side; for example `evaluation["complete"].position.mean`.

    kind           `compensated`: the actual robot was driven to the corrected joints and observed
                   without noise; `predicted`: difference between measured and predicted target
                   points, what to expect of a correction; `measured`: commanded against measured
                   points, the arm driven to the commands (nominal) and to the corrected joints (the
                   one calibration), see `proof`
    results        of every method, the nominal robot first
    uncorrectable  remaining error of every method, a row for every pose that the actual
                   robot cannot reach (n < 6, or an arm that is shorter than drawn): nearest pose
                   against the commanded one; None where every pose is reached, or this is unknown
    pose_test      ISO 9283, from the measured points, where configurations were measured
                   repeatedly; else None
    proof          of kind `measured`: what was expected, and whether `before` was
                   measured; else None
    """

    robot: str
    configurations: int
    kind: Kind
    results: tuple[MethodResult, ...]
    uncorrectable: MethodErrors | None = None
    pose_test: PoseTest | None = None
    proof: Proof | None = None

    def __getitem__(self, name: str) -> MethodResult:
        """The result of a method by its name. Raises KeyError for a name that is not there."""
        for result in self.results:
            if result.name == name:
                return result
        raise KeyError(f"no method '{name}'; there are {', '.join(r.name for r in self.results)}")

    def __repr__(self) -> str:
        lines = (f"  {result!r}" for result in self.results)
        head = f"<Evaluation of {self.robot} at {self.configurations} configurations, {self.kind}"
        return "\n".join([head, *lines]) + ">"

    @property
    def methods(self) -> list[MethodErrors]:
        """Whole errors of every method."""
        return [result.errors for result in self.results]

    @property
    def before(self) -> Before | None:
        """How errors before the correction were obtained (kind `measured`); or None."""
        return None if self.proof is None else self.proof.before_is

    @property
    def pose_tests(self) -> list[PoseTest | None]:
        """ISO 9283 of every method alone."""
        test = self.pose_test
        return [None if test is None else test.alone(k) for k in range(len(self.results))]

    def as_json(self) -> dict[str, object]:
        """The object that `evaluate --json` prints: its keys are what scripts use.

        Statistics are those of the whole errors, reductions those of the correctable part.
        """
        nominal = self.results[0].correctable
        result: dict[str, object] = {
            "schema": "calibtool/evaluation",
            "schema_version": 1,
            "robot": self.robot,
            "configurations": self.configurations,
            "kind": self.kind,
            "methods": [
                summary(result.correctable, nominal, result.errors) for result in self.results
            ],
        }
        if self.uncorrectable is not None:
            count = len(self.uncorrectable.position)
            result["uncorrectable"] = {
                "configurations": count,
                **pose_statistics(self.uncorrectable),
            }
        if self.pose_test is not None:
            result["iso9283"] = self.pose_test.as_json()
        if self.proof is not None:
            result |= self.proof.as_json()
        return result


def evaluate(
    calibrations: list[tuple[str, Calibration]],
    measurements: Measurements,
    *,
    method: Method = "exact",
    refit_setup: bool = False,
    outside: OutsidePolicy = "mark",
    before: Measurements | None = None,
) -> Evaluation:
    """Errors of the nominal robot and of every one of `calibrations`, named, at the configurations
    of `measurements`.

    outside: what to do at configurations unlike those of the training: count them, predict them by
    the base model alone, or refuse.
    refit_setup: fit unknown instrument frame and targets again on these rows, for every method
    alike (a moved tracker); otherwise the set-up that belongs to the training is used and nothing
    is fitted here.
    before: where the measurements were taken at corrected joints (`Measurements.commanded`), the
    same commands measured without correction; only for kind `measured`, with one
    calibration and no method.
    Raises InputError when a calibration is for another robot, UsageError for an unknown method or
    policy, NoSolutionError where `refuse` refuses, InputError also where the driven joints are not
    those of the calibration.
    """
    check_choice(method, get_args(Method), "method")
    check_choice(outside, OUTSIDE_POLICIES, "outside")
    for name, given in calibrations:
        check_same_robot(
            given.robot, measurements.robot, f"calibration '{name}'", "the measurements"
        )
    if measurements.commanded is not None or before is not None:
        return _proved(calibrations, measurements, before, refit_setup)
    measurements = judged_rows(measurements)
    every: list[tuple[str, Calibration | None]] = [("nominal", None), *calibrations]
    results: list[MethodResult] = []
    driven = measurements.truth is not None and measurements.setup.further_frames is None
    driven = driven and measurements.kind == "points"
    nearest, uncorrectable = _nearest_poses(measurements)
    for name, calibration in every:
        count = 0
        unlike = np.zeros(len(measurements), dtype=bool)
        if calibration is not None:
            unlike = coverage(calibration, measurements.q).outside
            if outside == "refuse" and unlike.any():
                raise NoSolutionError(
                    f"{name}: {int(unlike.sum())} configurations are outside those of the training"
                )
        if driven:
            assert measurements.truth is not None
            errors, part, count = _compensated(
                name, calibration, measurements, measurements.truth, nearest, method, outside
            )
        else:
            first = calibrations[0][1] if calibrations else None
            errors = _predicted(name, calibration, first, measurements, refit_setup, outside)
            part = errors
        results.append(MethodResult(errors, part, count, int(unlike.sum())))
    return Evaluation(
        robot=measurements.robot.name,
        configurations=len(measurements),
        kind="compensated" if driven else "predicted",
        results=tuple(results),
        uncorrectable=uncorrectable,
        pose_test=_pose_test(
            every, measurements, [r.errors for r in results], refit_setup, outside
        ),
    )


def judged_rows(measurements: Measurements) -> Measurements:
    """Rows that `evaluate` judges: whole observations, or all of a simulation."""
    if measurements.truth is not None and measurements.commanded is None:
        return measurements
    seen = measurements.setup.kind.weights(measurements.readings, 1.0, 1.0) > 0
    return measurements.rows(np.flatnonzero(seen.all(axis=-1)))


def _proved(
    calibrations: list[tuple[str, Calibration]],
    after: Measurements,
    before: Measurements | None,
    refit_setup: bool,
) -> Evaluation:
    """Kind `measured`: errors before and after one correction."""
    if after.commanded is None:
        raise UsageError(
            "before a correction and after it: the measurements after it must say what was "
            "commanded; import them with --commanded"
        )
    if len(calibrations) != 1:
        raise UsageError(
            "the measurements were taken after one correction; give its calibration alone"
        )
    ((name, calibration),) = calibrations
    if before is not None:
        check_same_robot(before.robot, after.robot, "before the correction", "after it")
        if len(before) == len(after):
            before = before.rows(np.flatnonzero(after.seen.all(axis=-1)))
    after = judged_rows(after)
    proof = prove(name, calibration, after, before, refit_setup=refit_setup)
    return Evaluation(
        robot=after.robot.name,
        configurations=len(after),
        kind="measured",
        results=(
            MethodResult(proof.before, proof.before),
            MethodResult(
                proof.after,
                proof.after,
                outside=int(coverage(calibration, after.q).outside.sum()),
            ),
        ),
        pose_test=proof.pose_test,
        proof=proof,
    )


def _pose_test(
    every: list[tuple[str, Calibration | None]],
    measurements: Measurements,
    methods: list[MethodErrors],
    refit: bool,
    outside: OutsidePolicy,
) -> PoseTest | None:
    """ISO 9283 for repeated configurations with measured points; None for others."""
    measurements = measurements.rows(np.flatnonzero(measurements.seen.all(axis=-1)))
    poses = repeated_poses(
        measurements.q, measurements.robot.mechanism.forward(measurements.q)[:, :3, 3]
    )
    if not poses:
        return None
    if measurements.truth is not None:
        first = every[1][1] if len(every) > 1 else None
        methods = [
            _predicted(name, calibration, first, measurements, refit, outside)
            for name, calibration in every
        ]
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
    """The whole errors, those from the nearest reachable poses, and the number of doubtful
    corrections.

    A correction at which the loops of the actual robot do not close counts as none.
    """
    robot, q = measurements.robot, measurements.q
    doubtful = np.zeros(len(q), dtype=bool)
    if calibration is None:
        driven, setup = q, measurements.setup
    else:
        setup = fitting_setup(calibration, measurements)
        driven = np.empty_like(q)
        for conditions, rows in measurements.conditions.alike(len(q)):
            result = guarded(calibration, q[rows], None, method, outside, conditions=conditions)
            driven[rows] = result.q
            doubtful[rows] = np.isin(result.status, DOUBTFUL)
        driven = driven + calibration.base.errors["backlash"] * truth.actual.directions(driven)
    actual = truth.actual.forward(driven, measurements.conditions)
    stuck = np.isnan(actual[:, 0, 0])  # the loops do not close: the arm cannot be driven there
    if stuck.any():
        driven = np.where(stuck[:, None], q, driven)
        actual = truth.actual.forward(driven, measurements.conditions)
    marked = int((doubtful | stuck).sum())
    commanded = robot.mechanism.forward(q)
    if measurements.setup.known:
        errors = _pose_errors(name, actual, commanded)
        return errors, errors if nearest is None else _pose_errors(name, actual, nearest), marked
    # Commanded poses live in the registered frame: compare target points there, as an
    # instrument would.
    observed = observe(truth.actual, truth.setup, driven, measurements.conditions)
    seen = transform_points(inverse(setup.T_instrument_base), observed)
    errors = point_errors(name, seen, commanded, setup)
    return errors, errors, marked


def _nearest_poses(measurements: Measurements) -> tuple[Array | None, MethodErrors | None]:
    """Nearest poses to the commanded ones that the actual robot can reach, and their distances;
    None if all are reached.

    Within the joint limits, and nearest by the weighted pose error; for n < 6 by the components
    that `exact` corrects, computed with the true errors. Only where truth and set-up are known: an
    estimated instrument frame moves the commanded poses with the method.
    """
    truth, robot, q = measurements.truth, measurements.robot, measurements.q
    if truth is None or not measurements.setup.known:
        return None, None
    commanded = robot.mechanism.forward(q)
    # Motion errors along the joints do not change which poses can be taken, only where the
    # joints have to go; bent joints and tilted axes leave the space of fewer than six joints.
    actual = truth.actual.mechanism
    if robot.n < 6:
        moved = log6(inverse(robot.chain.placements) @ actual.placements)  # thermal growth included
        errors = truth.actual.errors
        turning = {name: errors[name] for name in ("bending", "wobble")}
        kept = RobotErrors.of(
            robot, placements=moved, twists=errors["twists"], offsets=errors["offsets"], **turning
        )
        nominal = identify(measurements, "nominal")
        knowing = replace(nominal, base=replace(nominal.base, model="local-poe", errors=kept))
        nearest = knowing.forward(exact(knowing, q, commanded, _UNBOUNDED).q)
        nearest = np.where(np.isnan(nearest), commanded, nearest)  # loops that do not close
        return nearest, _pose_errors("uncorrectable", nearest, commanded)
    solved = solve_poses(
        actual.forward_and_jacobian,
        commanded,
        q,
        length=robot.length,
        lower=np.minimum(robot.lower, q),
        upper=np.maximum(robot.upper, q),
        max_iterations=300,
        descend=True,
    )
    if solved.reached.all():
        return None, None
    beyond = ~solved.reached
    nearest = commanded.copy()
    nearest[beyond] = actual.forward(solved.q[beyond])
    nearest = np.where(np.isnan(nearest), commanded, nearest)
    return nearest, _pose_errors("uncorrectable", nearest[beyond], commanded[beyond])


def _pose_errors(name: str, pose: Array, reference: Array) -> MethodErrors:
    """Displacements of the tool origin and rotations from reference poses (N, 4, 4)."""
    difference = pose_difference(pose, reference)
    return MethodErrors(name, difference[:, None, :3], difference[:, 3:])


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
        setup = setup.with_read_parts(measurements.setup)
    errors = errors_against(name, measurements, setup, pose)
    if np.abs(errors.position).max(initial=0.0) > _BEHIND:
        raise InputError(
            "the measurements cannot be seen in the set-up of the calibration; where the "
            "instrument was moved, --refit-setup finds its place in these rows"
        )
    return errors
