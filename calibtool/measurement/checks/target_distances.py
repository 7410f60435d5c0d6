"""Checks of the measured points alone: distances between targets on one body are constant."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calibtool.measurement.checks.design import equal_columns
from calibtool.measurement.checks.finding import Finding, Numbers, listed, severity
from calibtool.measurement.measurements import Measurements
from calibtool.robot.se3 import Array
from calibtool.units import millimetres

_STEP = 50.0  # squared standard errors of a change of the mean distances, summed over all pairs
_OUTLIER = 8.0  # standard deviations of a distance from that of the rows around it
_MANY = 20  # rows that show how the distances scatter; with less, the stated noise counts as well
_FLOOR = 1e-6  # m: smallest standard deviation of a distance, for exact data


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Distances (N, P) between targets, their scatter (P,), and unit vectors (P, 3) along them."""

    index: list[tuple[int, int]]
    distances: Array
    scatter: Array
    along: Array

    def moved(self, change: Array) -> tuple[str, Array]:
        """The target whose displacement explains changes (P,) of the distances best, and the
        smallest such displacement, m.
        """
        answers = []
        for i in range(max(b for _, b in self.index) + 1):
            sign = np.array([(a == i) * 1.0 - (b == i) * 1.0 for a, b in self.index])
            A = sign[:, None] * self.along
            shift = np.linalg.lstsq(A, change, rcond=1e-6)[0].astype(float)
            answers.append((float(np.sum(((change - A @ shift) / self.scatter) ** 2)), i, shift))
        answers.sort(key=lambda answer: answer[0])
        least = answers[0][0]
        alike = sorted(i for remaining, i, _ in answers if remaining <= 2 * least + 1e-9)
        return " or ".join(str(i + 1) for i in alike), answers[0][2]


def shape_findings(measurements: Measurements, wrong_rows: np.ndarray) -> list[Finding]:
    """Targets that were displaced, rows with a target out of place, scatter of the distances, and
    coordinates that occur twice.

    wrong_rows: indices (k,) of rows that are not checked because they are explained (swapped
    targets).
    """
    return [*_equal_coordinates(measurements), *_distances(measurements, wrong_rows)]


def _equal_coordinates(measurements: Measurements) -> list[Finding]:
    if len(measurements) < 3:
        return []
    names = [f"t{i + 1}_{axis}" for i in range(measurements.points.shape[1]) for axis in "xyz"]
    pairs = equal_columns(measurements.points.reshape(len(measurements), -1))
    return [
        Finding(
            "duplicate_columns",
            "warning",
            f"coordinates {names[a]} and {names[b]} hold the same numbers in every row; a column "
            "was taken twice",
            {"targets": [a // 3 + 1, b // 3 + 1]},
        )
        for a, b in pairs
    ]


def _distances(measurements: Measurements, wrong_rows: np.ndarray) -> list[Finding]:
    noise = measurements.noise_position
    rows = np.setdiff1d(np.flatnonzero(measurements.seen.all(axis=-1)), wrong_rows)
    if measurements.points.shape[1] < 2 or len(rows) < 6:
        return []
    pairs = _pairs(measurements.points[rows])
    found: list[Finding] = []
    numbers: Numbers

    centre = _running_median(pairs.distances)
    scatter = np.maximum(pairs.scatter, np.sqrt(2) * noise if len(rows) < _MANY else 0.0)
    off = (np.abs(pairs.distances - centre) > _OUTLIER * scatter).any(axis=-1)
    if off.any():
        named = [pairs.moved(change) for change in (pairs.distances - centre)[off]]
        largest = max(float(np.linalg.norm(shift)) for _, shift in named)
        targets = ", ".join(sorted({target for target, _ in named}))
        message = (
            f"row {listed(rows[off])}: target {targets}, up to {millimetres(largest)} from where "
            "the other targets say; measure these rows again or leave them out"
        )
        numbers = {"rows": [int(row) + 1 for row in rows[off]], "shift_mm": largest * 1e3}
        found.append(Finding("target_out_of_place", severity(largest > noise), message, numbers))
    rows, distances = rows[~off], pairs.distances[~off].copy()

    for _ in range(measurements.points.shape[1]):
        at, change, strength = _step(distances, pairs.scatter)
        if strength < _STEP:
            break
        distances[at:] -= change
        target, shift = pairs.moved(change)
        row, size = int(rows[at]) + 1, float(np.linalg.norm(shift))
        message = (
            f"target {target} has moved on the tool from row {row} on, by at least "
            f"{millimetres(size)} (its distances to the other targets change); calibrate only with "
            "the rows before, or only with the rows from there on"
        )
        numbers = {
            "row": row,
            "shift_mm": size * 1e3,
            "targets": [int(name) for name in target.split(" or ")],
        }
        found.append(Finding("target_moved", severity(size > noise), message, numbers))

    estimate = float(np.sqrt(distances.var(axis=0, ddof=1).mean() / 2))
    if estimate > 3 * noise:
        message = (
            f"the distances between targets scatter as if the noise were {millimetres(estimate)} "
            f"per coordinate, but {millimetres(noise)} are stated"
        )
        numbers = {"estimated_noise_mm": estimate * 1e3, "stated_noise_mm": noise * 1e3}
        found.append(Finding("noise_of_distances", "warning", message, numbers))
    return found


def _pairs(points: Array) -> _Pairs:
    index = list(combinations(range(points.shape[1]), 2))
    a, b = np.transpose(index)
    apart = points[:, a] - points[:, b]
    distances = np.linalg.norm(apart, axis=-1)
    steps = np.diff(distances, axis=0)
    scatter = 1.4826 * np.median(np.abs(steps - np.median(steps, axis=0)), axis=0) / np.sqrt(2)
    usual = np.argmin(np.abs(distances - np.median(distances, axis=0)).max(axis=-1))
    towards = apart[usual] / np.maximum(distances[usual], _FLOOR)[:, None]
    return _Pairs(index, distances, np.maximum(scatter, _FLOOR), towards)


def _running_median(values: Array) -> Array:
    """Median of five rows around each (N, P), at the ends the outer five; it keeps steps."""
    middle = np.clip(np.arange(len(values)), 2, len(values) - 3)
    result: Array = np.median(values[middle[:, None] + np.arange(-2, 3)], axis=1)
    return result


def _step(values: Array, scatter: Array) -> tuple[int, Array, float]:
    """First row after the largest change of the means, the change (P,), its significance."""
    count = len(values)
    before = np.arange(1, count)[:, None]
    total = np.cumsum(values - values[0], axis=0)
    change = (total[-1] - total[:-1]) / (count - before) - total[:-1] / before
    strength = (change**2 * before * (count - before) / count / scatter**2).sum(axis=-1)
    strength[:2] = strength[-2:] = 0.0  # at least three rows on either side
    at = int(np.argmax(strength))
    return at + 1, change[at], float(strength[at])
