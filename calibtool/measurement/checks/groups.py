"""Rows that fit in separate groups: the instrument, targets or touched object was moved."""

from dataclasses import dataclass

import numpy as np

from calibtool.measurement.checks.finding import Finding, Numbers
from calibtool.measurement.checks.nominal_fit import nominal_fit
from calibtool.measurement.measurements import Measurements
from calibtool.units import millimetres

_MOST = 8  # number of groups
_REFINED = 6  # number of rows on either side of a border among which it is looked for


@dataclass(frozen=True, eq=False)
class Groups:
    """Consecutive rows [start, end), the rms of each group's fit, m, and the rms over all."""

    borders: list[tuple[int, int]]
    sizes: list[float]
    rms: float

    def finding(self, before: float) -> Finding:
        """Which rows belong together."""
        groups = [
            f"{start + 1}-{end} ({millimetres(size)})"
            for (start, end), size in zip(self.borders, self.sizes, strict=True)
        ]
        message = (
            f"the nominal robot fits all points to {millimetres(before)} rms, but groups of rows "
            f"much better: {', '.join(groups)}; the instrument or its target was moved in between; "
            "name the groups in a column station"
        )
        numbers: Numbers = {
            "first_rows": [start + 1 for start, _ in self.borders],
            "rms_mm": before * 1e3,
            "repaired_rms_mm": self.rms * 1e3,
        }
        return Finding("groups_of_rows", "warning", message, numbers)


def groups_of_rows(measurements: Measurements, explained: float) -> Groups | None:
    """Two to eight groups of consecutive rows that fit to an rms of `explained` m, or None."""
    if measurements.place is not None:
        return None
    points = measurements.points_alone()
    unknowns = 6 + 3 * len(points.setup.targets)
    least = -(-(unknowns + 6) // (3 * len(points.setup.targets)))
    count = len(points)

    def squares(start: int, end: int) -> float:
        rows = np.arange(start, end)
        fit = nominal_fit(points.rows(rows), free=True) if end - start >= least else None
        return np.inf if fit is None or not np.isfinite(fit.rms) else float(fit.rms**2 * len(rows))

    def fits(start: int, end: int) -> bool:
        return bool(np.sqrt(squares(start, end) / (end - start)) < explained)

    ends: list[int] = []
    start = 0
    while start < count:
        low, high = start + least, count
        if low > count or not fits(start, low) or len(ends) == _MOST:
            return None
        while low < high:
            middle = (low + high + 1) // 2
            low, high = (middle, high) if fits(start, middle) else (low, middle - 1)
        ends.append(low)
        start = low
    if len(ends) < 2:
        return None
    for i in range(len(ends) - 1):  # a few rows too many still fit
        before, after = ([0, *ends][i], ends[i + 1])
        borders = range(
            max(before + least, ends[i] - _REFINED), min(after - least, ends[i] + 2) + 1
        )
        ends[i] = min(
            borders, key=lambda b: squares(before, b) + squares(b, after), default=ends[i]
        )
    spans = list(zip([0, *ends[:-1]], ends, strict=True))
    total = [squares(a, b) for a, b in spans]
    if not np.isfinite(total).all():
        return None
    sizes = [float(np.sqrt(t / (b - a))) for t, (a, b) in zip(total, spans, strict=True)]
    return Groups(spans, sizes, float(np.sqrt(sum(total) / count)))
