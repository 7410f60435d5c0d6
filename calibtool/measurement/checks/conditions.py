"""What happened while measuring: drift, temperature, scatter of repeated configurations, commanded and read positions."""

from dataclasses import replace

import numpy as np
from scipy.stats import t as student

from calibtool.measurement.checks.design import repeated_groups
from calibtool.measurement.checks.finding import Finding, severity
from calibtool.measurement.checks.nominal import Fit, nominal_fit
from calibtool.measurement.companions import Companions
from calibtool.measurement.measurements import Measurements
from calibtool.robot.se3 import Array, readonly

_LOUD = 3.0  # repeated configurations may scatter by so many times the stated noise
_RARE = 1e-3  # probability below which a trend is not chance
_CLEAR = 5.0  # standard errors at which a drift or the better joint positions are named


def condition_findings(measurements: Measurements, fit: Fit, companions: Companions) -> list[Finding]:
    """Repeatability, drift of reference points, trend with temperature, and which joint positions explain more.

    fit: the nominal robot registered to the measurements.
    """
    found = [_drift(measurements, companions)]
    if np.isfinite(fit.rms):
        found += [
            _repeatability(measurements, fit),
            _temperature(measurements, fit, companions),
            _commanded_or_read(measurements, companions),
        ]
    return [finding for finding in found if finding is not None]


def _repeatability(measurements: Measurements, fit: Fit) -> Finding | None:
    """Scatter within repeated configurations; of the residuals, so that small differences of the joints do not count."""
    groups = repeated_groups(measurements.q)
    seen = measurements.seen.repeat(3, axis=-1)
    size = np.zeros((int(groups.max()) + 1, seen.shape[1]))
    total = np.zeros_like(size)
    np.add.at(size, groups, seen)
    np.add.at(total, groups, np.where(seen, fit.left, 0.0))
    freedom = float(np.maximum(size - 1, 0).sum())
    if not freedom:
        return None
    own = np.where(seen, fit.left - (total / np.maximum(size, 1))[groups], 0.0)
    scatter, noise = float(np.sqrt((own**2).sum() / freedom)), measurements.noise_position
    rows = len(groups) - len(size)
    message = (
        f"{rows} rows repeat the joint positions of another row: they scatter by {scatter * 1e3:.3g} mm per coordinate, "
        f"stated noise {noise * 1e3:.3g} mm"
    )
    numbers = {"rows": rows, "scatter_mm": scatter * 1e3, "stated_noise_mm": noise * 1e3, "degrees_of_freedom": freedom}
    return Finding("repeatability", severity(scatter > _LOUD * noise), message, numbers)


def _drift(measurements: Measurements, companions: Companions) -> Finding | None:
    """Movement of fixed points: von Neumann's ratio of successive differences to variance tells drift from noise."""
    if companions.reference_points is None:
        return None
    points = companions.reference_points
    z_sum, columns, paths = 0.0, 0, []
    for i in range(points.shape[1]):
        rows = np.flatnonzero(np.isfinite(points[:, i]).all(axis=-1))
        count = len(rows)
        if count < 6:
            continue
        path = points[rows, i] - points[rows, i].mean(axis=0)
        ratio = (np.diff(path, axis=0) ** 2).sum(axis=0) / np.maximum((path**2).sum(axis=0), 1e-24)
        z_sum += float(((1 - ratio / 2) * np.sqrt((count**2 - 1) / (count - 2))).sum())
        columns += 3
        part = max(count // 5, 2)
        means = np.array([chunk.mean(axis=0) for chunk in np.array_split(path, max(count // part, 2))])
        paths.append((rows, means))
    if not columns:
        return None
    z = z_sum / np.sqrt(columns)
    spans = [float(np.linalg.norm(np.ptp(means, axis=0))) for _, means in paths]
    rows, means = paths[int(np.argmax(spans))]
    span, noise = max(spans), measurements.noise_position
    numbers: dict[str, float | int | list] = {"moved_mm": span * 1e3, "standard_errors": z}
    if z < _CLEAR:
        message = f"the reference points do not drift: {span * 1e3:.3g} mm between parts of the file"
        return Finding("reference_drift", "note", message, numbers)
    way = means[-1] - means[0]
    numbers["first_to_last_mm"] = [float(v) * 1e3 for v in way]
    speed = ""
    if companions.time_s is not None and (hours := float(np.ptp(companions.time_s[rows])) / 3600) > 0:
        numbers["mm_per_hour"] = span * 1e3 / hours
        speed = f" in {hours:.3g} h"
    message = (
        f"the reference points move by {span * 1e3:.3g} mm{speed} against the instrument: the base or the instrument "
        "drifts; bring each row back by its reference points, or measure faster"
    )
    return Finding("reference_drift", severity(span > noise), message, numbers)


def _temperature(measurements: Measurements, fit: Fit, companions: Companions) -> Finding | None:
    """Trend of the residual with temperature: drift along x, y, z of K_0, and growth along the way from the base.

    Significance by Student's t, with the rows counted as n (1 − ρ_a ρ_b)/(1 + ρ_a ρ_b) of them where both series are
    correlated from row to row (Bretherton et al. 1999); the smallest of four p-values, times four.
    """
    if companions.temperature_c is None or np.ptp(companions.temperature_c) < 0.1:
        return None
    temperature = companions.temperature_c - companions.temperature_c.mean()
    seen = measurements.seen
    left = np.where(seen[..., None], fit.left.reshape(len(seen), -1, 3), 0.0)
    moved = left.sum(axis=1) / seen.sum(axis=-1, keepdims=True)
    outward = measurements.robot.mechanism.forward(measurements.q)[:, :3, 3]
    reach = np.linalg.norm(outward, axis=-1)
    grown = (moved * outward).sum(axis=-1) / np.maximum(reach, 1e-6)
    trends = [_trend(temperature, series) for series in (*moved.T, grown)]
    slopes = [slope for slope, _ in trends]
    p = min(1.0, 4 * min(p for _, p in trends))
    span = float(np.ptp(temperature))
    strongest = slopes[int(np.argmin([p for _, p in trends]))]
    change = abs(strongest) * span
    numbers = {
        "range_k": span,
        "drift_mm_per_k": [slope * 1e3 for slope in slopes[:3]],
        "growth_mm_per_k": slopes[3] * 1e3,
        "p_value": p,
    }
    low, high = companions.temperature_c.min(), companions.temperature_c.max()
    place = f"between {low:.1f} and {high:.1f} °C"
    if p > _RARE:
        message = f"no trend with temperature {place} (p = {p:.2g})"
        return Finding("temperature_trend", "note", message, numbers)
    message = f"the residual changes with temperature, by {change * 1e3:.3g} mm {place} (p = {p:.1g})"
    importance = severity(change > measurements.noise_position)
    return Finding("temperature_trend", importance, message, numbers)


def _trend(x: Array, y: Array) -> tuple[float, float]:
    """Slope of y over a centred x, and its p-value."""
    y = y - y.mean()
    slope = float(x @ y / (x @ x))
    left = y - slope * x

    def correlation(series: Array) -> float:
        return float(series[1:] @ series[:-1] / max(float(series @ series), 1e-300))

    both = np.clip(correlation(x) * correlation(left), 0.0, 0.999)
    freedom = len(x) * (1 - both) / (1 + both) - 2
    if freedom < 1:
        return slope, 1.0
    error = np.sqrt((left @ left) / freedom / (x @ x))
    return slope, float(2 * student.sf(abs(slope) / max(error, 1e-300), freedom))


def _commanded_or_read(measurements: Measurements, companions: Companions) -> Finding | None:
    """How far from the commanded (0) to the read (1) positions the robot really was, as the points say it."""
    commanded, read = companions.q_commanded, companions.q_read
    if commanded is None or read is None:
        commanded = measurements.q if commanded is None else commanded
        read = measurements.q if read is None else read
    if np.abs(commanded - read).max() < 1e-9:
        return None
    fits = [nominal_fit(replace(measurements, q=readonly(q)), free=False) for q in (commanded, read)]
    if not all(np.isfinite(fit.rms) for fit in fits):
        return None
    apart = fits[0].left - fits[1].left
    power = float((apart**2).sum())
    if power < 1e-30:
        return None
    share = float((apart * fits[0].left).sum() / power)
    left = fits[0].left - share * apart
    error = float(np.sqrt(((apart * left).sum(axis=-1) ** 2).sum()) / power)
    used_read = np.abs(measurements.q - read).max() < np.abs(measurements.q - commanded).max()
    better_read = share > 0.5
    clear = abs(share - 0.5) > _CLEAR * error
    names = ("commanded", "read")
    verdict = (
        f"the {names[better_read]} ones explain the points better" if clear else "neither explains the points better"
    )
    message = (
        f"commanded and read joint positions differ by up to {_size(measurements, commanded - read)}; {verdict} "
        f"({fits[0].rms * 1e3:.4g} mm rms commanded, {fits[1].rms * 1e3:.4g} mm read)"
    )
    if clear and better_read != used_read:
        message += f"; the file holds the {names[used_read]} ones"
    numbers = {
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
