"""Drift since a calibration: a few rows against what the calibration predicts, with a stated rate
of false alarms, and the one cause that explains the difference best.
"""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from calibtool.calibration import Calibration, check_same_robot, fitting_setup
from calibtool.errors import InputError
from calibtool.measurement.kinds.instrument import InstrumentKind
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import linearised, weights
from calibtool.measurement.registration import register
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import Array, adjoint
from calibtool.units import three_digits

# Of the posterior's variances: benchmarks/frames.py finds squared deviations of 1.9 times the
# stated ones in the worst of ten seeds, and false alarms have to be rare for that arm, too.
_CAUTION = 2.0
_ANYWHERE = 1.0  # m and rad: standard deviation of a base of which nothing is known
_MOVED = 2e-4  # m, rad: expected size of a shift and a turn of base or tool
_SLIP = 1e-3  # rad or m: expected size of a slip of a joint
_ALIKE = 3.0  # causes with a smaller difference of evidence (a factor of 20) count as equally good


@dataclass(frozen=True, eq=False)
class Cause:
    """One possible cause, fitted alone.

    name       `base`, `tool`, `joint 3`, or `something else`
    change     (k,) the most probable change: twist of the base in K_0 or of the tool in its own
               frame (m, rad), motion of a joint (rad or m); empty for `something else`
    std        (k,) its standard deviations
    evidence   logarithm of how much more probable the residuals are with it than without
    p_value    probability of explaining as much where nothing has changed
    rest       probability of residuals as large as those that it leaves, where it is the cause
    """

    name: str
    change: Array
    std: Array
    evidence: float
    p_value: float
    rest: float

    @property
    def change_text(self) -> str:
        """The change in words: `0.103 mm and 0.0120 deg`, `0.0502 ± 0.0030 deg`."""
        if len(self.change) == 0:
            return "no single cause"
        if len(self.change) == 1:
            slides = self.name.startswith("slide")
            factor, unit = (1e3, "mm") if slides else (np.rad2deg(1.0), "deg")
            value, std = float(self.change[0]) * factor, float(self.std[0]) * factor
            return f"{three_digits(value)} ± {three_digits(std)} {unit}"
        shift, turn = (float(np.linalg.norm(part)) for part in self.change.reshape(2, 3))
        return f"{three_digits(shift * 1e3)} mm, {three_digits(np.rad2deg(turn))} deg"


@dataclass(frozen=True, eq=False)
class DriftCheck:
    """Outcome of a check.

    robot               name of the robot
    configurations      how many were measured
    residual, expected  root mean square of the residuals per coordinate, m (of positions), and what
                        noise and the calibration's uncertainty explain
    p_value             probability of at least so large an effect where nothing has changed
    false_alarm         rate of false alarms at which it is judged
    causes              the likely ones first; one, or several that explain the rows equally well
    likely              how many of `causes` explain the difference equally well
    """

    robot: str
    configurations: int
    residual: float
    expected: float
    p_value: float
    false_alarm: float
    causes: tuple[Cause, ...]
    likely: int

    @property
    def alarm(self) -> bool:
        """Whether something has changed, at the stated rate of false alarms."""
        return self.p_value < self.false_alarm

    @property
    def named(self) -> str:
        """The likely causes in words, and whether they explain the whole difference."""
        likely = self.causes[: self.likely]
        text = " or ".join(f"{cause.name} ({cause.change_text})" for cause in likely)
        if max(cause.rest for cause in likely) >= self.false_alarm:
            verb = "the likely cause is" if self.likely == 1 else "likely causes are"
            return f"{verb} {text}"
        return f"no single cause explains it, the nearest is {text}"

    def as_json(self) -> dict[str, object]:
        """The object that `monitor --json` prints, and a line of its history."""
        return {
            "schema": "calibtool/monitor",
            "schema_version": 1,
            "robot": self.robot,
            "configurations": self.configurations,
            "residual_rms_mm": self.residual * 1e3,
            "expected_rms_mm": self.expected * 1e3,
            "p_value": self.p_value,
            "false_alarm_rate": self.false_alarm,
            "alarm": self.alarm,
            "likely": [cause.name for cause in self.causes[: self.likely]] if self.alarm else [],
            "causes": [
                {
                    "name": cause.name,
                    "change": [float(v) for v in cause.change],
                    "std": [float(v) for v in cause.std],
                    "p_value": cause.p_value,
                }
                for cause in self.causes
            ],
        }


def check_drift(
    calibration: Calibration,
    measurements: Measurements,
    *,
    false_alarm: float = 0.01,
    refit_setup: bool = False,
) -> DriftCheck:
    """Whether a few rows differ from what a calibration predicts, and the most likely causes.

    Residuals r, divided by the stated noise, have the covariance S = f² I + 2 A C Aᵀ, with the
    estimated noise f, the calibration's posterior C, and its columns A at these rows. The factor 2
    is there because the posterior variances are too small for some arms. A cause with k columns W
    explains ‖Q S^(−½) r‖² of them (Q: projection on S^(−½) W), which is k times an F(k, ν) variable
    where nothing has changed; ν are the degrees of freedom from which f was estimated. The smallest
    probability, multiplied by the number of causes, is compared with `false_alarm`. The likely
    cause is that of the largest evidence, for changes of about 0.2 mm and 0.2 mrad of base or tool,
    or 1 mrad of a joint; base, tool, and all joints together have equal prior probability.

    refit_setup: the instrument was moved. Its place is registered again on these rows, so that the
    base is not judged; with other instruments than trackers and 6-D probes, their part of the tool
    is registered, too, and the tool is not judged either. Raises InputError for a calibration
    without a posterior, for another robot or other targets, and for rows that cannot be seen in the
    set-up of the calibration; NoSolutionError where too few rows register the set-up.
    """
    from scipy.special import fdtrc

    check_same_robot(calibration.robot, measurements.robot, "the calibration", "the measurements")
    posterior = calibration.base.posterior
    if posterior is None:
        raise InputError(
            f"a '{calibration.base.model}' base does not know its uncertainty; identify with "
            "--model complete"
        )
    as_fitted = calibration.in_frame("fitted") if calibration.frame is not None else calibration
    q, conditions = measurements.q, measurements.conditions
    pose = as_fitted.forward(q, conditions)
    context = as_fitted.base.errors.context(q, conditions)
    again = refit_setup and not measurements.setup.known
    of_tool = isinstance(measurements.setup.kind, InstrumentKind)  # a tool side of its own
    if again:
        setup = _placed_again(as_fitted, measurements, pose)
        as_in_fit = replace(setup, targets_known=as_fitted.setup.targets_known)
    else:
        setup = as_in_fit = fitting_setup(as_fitted, measurements)
    parameters = posterior.parameters
    columns, residual = linearised(
        measurements, as_in_fit, pose, parameters.pose_columns(context), bool(parameters.targets)
    )
    known = len(posterior.covariance)
    if again:  # the rest is free
        known -= len(parameters.targets)
        known += as_fitted.setup.kind.coordinates(setup) * (of_tool and not as_in_fit.targets_known)
    kept = (weights(measurements) > 0).ravel()
    r = residual.ravel()[kept]

    def flat(part: Array) -> Array:
        return part.reshape(-1, part.shape[-1])[kept]

    def seen(twists: Array) -> Array:
        return flat(linearised(measurements, setup, pose, twists, False)[0])

    free = np.zeros((len(r), 0))
    of_base = np.broadcast_to(np.eye(6), (len(q), 6, 6))
    if again:
        free = flat(linearised(measurements, setup, pose, of_base, bool(setup.free_names))[0])
    own, sizes, _ = np.linalg.svd(free, full_matrices=False)
    own = np.asarray(
        own[:, sizes > 1e-9 * sizes.max(initial=0.0)], dtype=float
    )  # directions that the set-up takes up
    A = flat(columns)[:, :known]
    A = A - own @ (own.T @ A)
    unsure = _CAUTION * A @ posterior.covariance[:known, :known] @ A.T
    covariance: Array = posterior.noise_factor**2 * np.eye(len(r)) + unsure
    nuisance = own.shape[1]
    expected = float(np.trace(covariance) - posterior.noise_factor**2 * nuisance) / len(r)
    covariance = covariance + _ANYWHERE**2 * free @ free.T
    half = _root(covariance, r)
    z: Array = np.asarray(np.linalg.solve(half, r), dtype=float)
    whole = float(z @ z)
    robot = calibration.robot
    names = [f"{'slide' if p else 'joint'} {j + 1}" for j, p in enumerate(robot.prismatic)]
    joints = seen(context.offset_columns)[:, : robot.n]
    candidates = {name: joints[:, j : j + 1] for j, name in enumerate(names)}
    if of_tool or not again:
        candidates["tool"] = seen(adjoint(pose))
    if not again:
        candidates["base"] = seen(of_base)
    rows = calibration.configurations * setup.kind.coordinates(setup)
    freedom = max(rows - posterior.effective, 1.0)

    def judged(name: str, W: Array) -> Cause:
        u, s, _ = np.linalg.svd(np.linalg.solve(half, W), full_matrices=False)
        freed = len(z) - W.shape[1] - nuisance
        own = s > 1e-9 * max(float(s[0]), 1e-300)
        k, statistic = int(own.sum()), float(((u[:, own].T @ z) ** 2).sum())
        p_value = float(fdtrc(k, freedom, statistic / k))
        rest = float(fdtrc(freed, freedom, max(whole - statistic, 0.0) / freed))
        if W.shape[1] == 1:
            return _fitted(name, half, z, W, np.full(1, _SLIP), p_value, rest)
        sizes = (np.repeat([_MOVED, 0.0], 3), np.full(6, _MOVED))  # a shift alone, or with a turn
        fitted = [_fitted(name, half, z, W, size, p_value, rest) for size in sizes]
        best = max(fitted, key=lambda cause: cause.evidence)
        return replace(best, evidence=best.evidence + float(np.log(robot.n)))

    causes = [judged(name, W) for name, W in candidates.items()]
    freed = len(z) - nuisance
    every = Cause(
        "something else",
        np.empty(0),
        np.empty(0),
        0.0,
        float(fdtrc(freed, freedom, whole / freed)),
        1.0,
    )
    least = min(cause.p_value for cause in (*causes, every))
    causes.sort(key=lambda cause: -cause.evidence)
    alike = sum(cause.evidence >= causes[0].evidence - _ALIKE for cause in causes)
    if causes[0].p_value > every.p_value:  # none of them explains it
        causes, alike = [every, *causes], 1
    else:
        causes.append(every)
    positions = (residual * measurements.noise_position).ravel()[kept]
    return DriftCheck(
        robot=robot.name,
        configurations=len(measurements),
        residual=float(np.sqrt((positions**2).mean())),
        expected=float(np.sqrt(expected)) * measurements.noise_position,
        p_value=min(least * len(causes), 1.0),
        false_alarm=false_alarm,
        causes=tuple(causes),
        likely=alike,
    )


def _placed_again(calibration: Calibration, measurements: Measurements, pose: Array) -> Setup:
    """The set-up registered on these rows, with the calibration's targets where they are points."""
    setup, mine = measurements.setup, calibration.setup
    if isinstance(setup.kind, InstrumentKind) and len(mine.targets) == len(setup.targets):
        setup = replace(
            setup, targets=mine.targets, R_tool_sensor=mine.R_tool_sensor, targets_known=True
        )
    return register(replace(measurements, setup=setup), pose)


def _root(covariance: Array, residual: Array) -> Array:
    """Cholesky root; InputError where residuals and columns of the set-up are no numbers."""
    if np.isfinite(residual).all() and np.isfinite(covariance).all():
        with suppress(np.linalg.LinAlgError):
            return np.asarray(np.linalg.cholesky(covariance), dtype=float)
    raise InputError(
        "the measurements cannot be seen in the set-up of the calibration; where the instrument "
        "was moved, --refit-setup"
    )


def _fitted(
    name: str, half: Array, z: Array, W: Array, size: Array, p_value: float, rest: float
) -> Cause:
    """The most probable change with columns W (rows, k), whose elements have standard deviations
    `size` (k,) before; z: whitened residuals, half: root of their covariance.
    """
    scaled = np.linalg.solve(half, W * size)
    information = np.eye(len(size)) + scaled.T @ scaled
    gradient = scaled.T @ z
    change = np.linalg.solve(information, gradient)
    evidence = 0.5 * float(gradient @ change - np.linalg.slogdet(information)[1])
    std = size * np.sqrt(np.diag(np.linalg.inv(information)))
    return Cause(name, size * change, std, evidence, p_value, rest)
