"""Changes while measuring: drift, temperature, scatter, commanded and read positions."""

from dataclasses import replace

import numpy as np
from scipy.special import stdtr

from calibtool.measurement.auxiliary import AuxiliaryReadings
from calibtool.measurement.checks.design import repeated_groups
from calibtool.measurement.checks.finding import Finding, Numbers, severity
from calibtool.measurement.checks.nominal_fit import Fit, nominal_fit
from calibtool.measurement.checks.unexplained import Unexplained
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.reference_motion import ReferencePoints
from calibtool.robot.se3 import Array, readonly, transform_points
from calibtool.units import count_of, millimetres

_LOUD = 3.0  # times the stated noise: largest scatter of repeated configurations
_RARE = 1e-3  # probability below which a trend is not chance
_MOST_ROWS = 1000  # number of rows that is enough for a trend
_CLEAR = 5.0  # standard errors at which a drift or the better joint positions are named


def condition_findings(
    measurements: Measurements, fit: Fit, auxiliary: AuxiliaryReadings
) -> list[Finding]:
    """Repeatability, drift of reference points, trend with temperature, and which joint positions
    fit better.

    fit: the nominal robot registered to the measurements.
    """
    found = [_drift(measurements, auxiliary)]
    if np.isfinite(fit.rms):
        found.append(_repeatability(measurements, fit))
        if len(measurements) > _MOST_ROWS:
            rows = np.linspace(0, len(measurements) - 1, _MOST_ROWS).astype(int)
            measurements, auxiliary = measurements.rows(rows), auxiliary.rows(rows)
            fit = replace(fit, residual=fit.residual[rows])
        found += [
            _temperature(measurements, fit, auxiliary),
            _commanded_or_read(measurements, auxiliary),
        ]
    return [finding for finding in found if finding is not None]


def _repeatability(measurements: Measurements, fit: Fit) -> Finding | None:
    """Scatter of the residuals, not of the points, within repeated configurations."""
    groups = repeated_groups(measurements.q)
    seen = measurements.seen.repeat(3, axis=-1)
    size = np.zeros((int(groups.max()) + 1, seen.shape[1]))
    total = np.zeros_like(size)
    np.add.at(size, groups, seen)
    np.add.at(total, groups, np.where(seen, fit.residual, 0.0))
    freedom = float(np.maximum(size - 1, 0).sum())
    if not freedom:
        return None
    own = np.where(seen, fit.residual - (total / np.maximum(size, 1))[groups], 0.0)
    scatter, noise = float(np.sqrt((own**2).sum() / freedom)), measurements.noise_position
    rows = len(groups) - len(size)
    message = (
        f"{rows} rows repeat the joint positions of another row: they scatter by "
        f"{millimetres(scatter)} per coordinate, stated noise {millimetres(noise)}"
    )
    numbers: Numbers = {
        "rows": rows,
        "scatter_mm": scatter * 1e3,
        "stated_noise_mm": noise * 1e3,
        "degrees_of_freedom": freedom,
    }
    return Finding("repeatability", severity(scatter > _LOUD * noise), message, numbers)


def _drift(measurements: Measurements, auxiliary: AuxiliaryReadings) -> Finding | None:
    """Movement of fixed points, by von Neumann's ratio of differences to variance."""
    if auxiliary.reference_points is None:
        return None
    readings = ReferencePoints(np.arange(float(len(measurements))), auxiliary.reference_points)
    readings, gross = readings.ordered().without_gross(measurements.noise_position)
    points, order = readings.points, readings.times.astype(int)
    squares = steps = 0.0
    weight, paths = 0.0, []
    for i in range(points.shape[1]):
        rows = np.flatnonzero(np.isfinite(points[:, i]).all(axis=-1))
        if len(rows) < 6:
            continue
        path = points[rows, i] - points[rows, i].mean(axis=0)
        squares += float((path**2).sum())
        steps += float((np.diff(path, axis=0) ** 2).sum())
        weight += 3 * (len(rows) ** 2 - 1) / (len(rows) - 2)
        means = np.array(
            [part.mean(axis=0) for part in np.array_split(path, min(5, len(rows) // 3))]
        )
        paths.append((order[rows], means))
    if not paths:
        return None
    z = float((1 - steps / max(2 * squares, 1e-300)) * np.sqrt(weight))
    spans = [float(np.linalg.norm(np.ptp(means, axis=0))) for _, means in paths]
    rows, means = paths[int(np.argmax(spans))]
    span, noise = max(spans), measurements.noise_position
    numbers: Numbers = {"moved_mm": span * 1e3, "standard_errors": z}
    omitted = f"; {count_of(gross, 'gross reading')} left out" if gross else ""
    if z < _CLEAR:
        message = (
            f"the reference points do not drift: {millimetres(span)} between parts of the "
            f"file{omitted}"
        )
        return Finding("reference_drift", "note", message, numbers)
    numbers["first_to_last_mm"] = [float(v) * 1e3 for v in means[-1] - means[0]]
    speed = ""
    if auxiliary.time_s is not None and (hours := float(np.ptp(auxiliary.time_s[rows])) / 3600) > 0:
        numbers["hours"] = hours
        speed = f" in {hours:.3g} h"
    message = (
        f"the reference points move by {millimetres(span)}{speed} against the instrument: the base "
        "or the instrument "
        "drifts; import --use-references brings the rows back by them" + omitted
    )
    return Finding("reference_drift", severity(span > noise), message, numbers)


def _temperature(
    measurements: Measurements, fit: Fit, auxiliary: AuxiliaryReadings
) -> Finding | None:
    """Trend of the residual with temperature: drift along x, y, z of K_0, and growth away from the
    base.

    Errors of the robot, of any family and its tolerance, may explain a part of the trend; the
    standard errors include this (`Unexplained`). The most significant of the four trends counts,
    with its p-value times four: an arm without drift is reported in at most 1 % of sets
    (benchmarks/drift.py), whatever the order of the rows. The order of the rows is tested as well,
    because most drifts depend on time.
    """
    if auxiliary.temperature_c is None or np.ptp(auxiliary.temperature_c) < 0.1:
        return None
    outward = transform_points(
        measurements.robot.mechanism.forward(measurements.q), fit.setup.targets
    )
    slopes, sizes = _trends(measurements, fit, outward, auxiliary.temperature_c)
    order_sizes = _trends(measurements, fit, outward, np.arange(float(len(measurements))))[1]
    strongest, span = int(np.argmax(sizes)), float(np.ptp(auxiliary.temperature_c))
    slopes[3] *= float(np.linalg.norm(outward, axis=-1).mean())
    freedom = max(measurements.equations - 1, 1)
    p, change = (
        min(1.0, 8 * float(stdtr(freedom, -sizes[strongest]))),
        abs(float(slopes[strongest])) * span,
    )
    numbers: Numbers = {
        "range_k": span,
        "drift_mm_per_k": [float(slope) * 1e3 for slope in slopes[:3]],
        "growth_mm_per_k": float(slopes[3]) * 1e3,
        "standard_errors": float(sizes[strongest]),
        "standard_errors_by_row_order": float(order_sizes.max()),
        "p_value": p,
    }
    place = (
        f"between {auxiliary.temperature_c.min():.1f} and {auxiliary.temperature_c.max():.1f} °C"
    )
    if p > _RARE:
        message = f"no trend with temperature {place} (p = {p:.2g})"
        return Finding("temperature_trend", "note", message, numbers)
    kind = "the arm grows" if strongest == 3 else "the points drift"
    message = f"{kind} with temperature, by {millimetres(change)} {place} (p = {p:.1g})"
    if order_sizes.max() > sizes[strongest]:
        message += "; the order of the rows explains more than that: something drifts with time"
    return Finding(
        "temperature_trend", severity(change > measurements.noise_position), message, numbers
    )


def _trends(
    measurements: Measurements, fit: Fit, outward: Array, values: Array
) -> tuple[Array, Array]:
    """Slopes (4,) of the residual over values (N,) along x, y, z and outward, and in std errors."""
    unexplained = Unexplained.of(measurements, fit.setup)
    slopes, sizes = np.empty(4), np.empty(4)
    directions = [*np.broadcast_to(np.eye(3)[:, None, None], (3, *outward.shape)), outward]
    for k, direction in enumerate(directions):
        trend = ((values - values.mean())[:, None, None] * direction).reshape(fit.residual.shape)
        trend *= measurements.seen.repeat(3, axis=-1)
        slopes[k], error = unexplained.slope(trend, fit.residual)
        sizes[k] = abs(slopes[k]) / max(error, 1e-300)
    return slopes, sizes


def _commanded_or_read(measurements: Measurements, auxiliary: AuxiliaryReadings) -> Finding | None:
    """Where the points show the robot between the commanded (0) and the read (1) positions."""
    commanded, read = auxiliary.q_commanded, auxiliary.q_read
    if commanded is None or read is None:
        commanded = measurements.q if commanded is None else commanded
        read = measurements.q if read is None else read
    if np.abs(commanded - read).max() < 1e-9:
        return None
    fits = [
        nominal_fit(replace(measurements, q=readonly(q)), free=False) for q in (commanded, read)
    ]
    if not all(np.isfinite(fit.rms) for fit in fits):
        return None
    apart = fits[0].residual - fits[1].residual
    power = float((apart**2).sum())
    if power < 1e-30:
        return None
    unexplained = Unexplained.of(measurements.points_alone(), fits[0].setup)
    share, error = unexplained.slope(apart, fits[0].residual)
    used_read = np.abs(measurements.q - read).max() < np.abs(measurements.q - commanded).max()
    better_read = share > 0.5
    clear = abs(share - 0.5) > _CLEAR * error
    names = ("commanded", "read")
    verdict = (
        f"the {names[int(better_read)]} ones explain the points better"
        if clear
        else "neither explains the points better"
    )
    message = (
        "commanded and read joint positions differ by up to "
        f"{_size(measurements, commanded - read)}; {verdict} "
        f"({fits[0].rms * 1e3:.4g} mm rms commanded, {fits[1].rms * 1e3:.4g} mm read)"
    )
    if clear and better_read != used_read:
        message += f"; the file holds the {names[int(used_read)]} ones"
    numbers: Numbers = {
        "commanded_rms_mm": fits[0].rms * 1e3,
        "read_rms_mm": fits[1].rms * 1e3,
        "share_of_read": share,
        "share_standard_error": error,
    }
    importance = severity(clear and better_read != used_read)
    return Finding("commanded_or_read", importance, message, numbers)


def _size(measurements: Measurements, difference: Array) -> str:
    """The largest difference of the joints that turn, and of those that slide."""
    largest = np.abs(difference).max(axis=0)
    sliding = np.array(measurements.robot.prismatic)
    parts = [
        f"{1e3 * largest[which].max():.3g} {unit}"
        for which, unit in ((~sliding, "mrad"), (sliding, "mm"))
        if which.any()
    ]
    return " and ".join(parts)
