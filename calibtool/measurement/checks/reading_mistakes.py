"""Single mistakes with readings other than points: rows shifted, lengths in another unit, an offset
of a wire's zero, poses of a board inverted or mirrored.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from calibtool.measurement.checks.finding import Finding
from calibtool.measurement.checks.mistakes import LENGTHS, Mistake, inverse_poses
from calibtool.measurement.checks.nominal_fit import rms_of_lengths
from calibtool.measurement.measurements import Measurements
from calibtool.robot.se3 import Array, readonly
from calibtool.units import millimetres

_BETTER = 3.0  # how much better the readings must be explained before a mistake is named
_GOOD = 1e-2  # of the length of the arm: largest residual of the nominal robot without the mistake
_MIRROR = np.array([-1.0, 1.0, 1.0])


def reading_findings(measurements: Measurements, before: float) -> list[Finding]:
    """The mistake without which the nominal robot explains the readings best, if it does so by far;
    before: the rms with it, m.
    """
    tried = [(rms_of_lengths(m.repaired)[1], m) for m in _mistakes(measurements)]
    after, mistake = min(tried, key=lambda pair: pair[0], default=(np.inf, None))
    if mistake is None or after * _BETTER > before or after > _GOOD * measurements.robot.length:
        return []
    now = f"{millimetres(before)} rms" if np.isfinite(before) else "not at all"
    message = (
        f"the nominal robot explains the readings {now if now == 'not at all' else 'to ' + now}, "
        f"but to {millimetres(after)} if {mistake.text}"
    )
    numbers = {"rms_mm": before * 1e3, "repaired_rms_mm": after * 1e3}
    return [Finding(mistake.name, "warning", message, dict(numbers))]


def _mistakes(measurements: Measurements) -> Iterator[Mistake]:
    count, q = len(measurements), measurements.q
    for by in (1, -1):
        rows = np.arange(count)[max(by, 0) : count + min(by, 0)]
        repaired = replace(measurements.rows(rows), q=readonly(q[rows - by]))
        which = "before" if by > 0 else "after"
        text = f"they belong to the joints of the row {which} (shifted by 1)"
        yield Mistake("row_shift", text, repaired)
    values = measurements.values
    if values is not None and measurements.kind == "distance":
        for factor, text in LENGTHS:
            repaired = replace(measurements, values=readonly(values * factor))
            yield Mistake("length_unit", f"the lengths are in {text}", repaired)
    if measurements.rotations is not None:
        yield Mistake(
            "inverse_poses",
            "the poses are inverted: those of the camera in the board",
            inverse_poses(measurements),
        )
        yield Mistake(
            "left_handed_axes",
            "the images are mirrored (left and right exchanged)",
            _mirrored(measurements, measurements.rotations),
        )


def _mirrored(measurements: Measurements, rotations: Array) -> Measurements:
    points = measurements.points * _MIRROR
    turned = _MIRROR[:, None] * rotations * _MIRROR
    return replace(measurements, points=readonly(points), rotations=readonly(turned))
