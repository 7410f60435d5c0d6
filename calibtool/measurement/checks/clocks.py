"""Time offset between a stream of joints and measurements with own stamps, for a moving arm."""

from dataclasses import dataclass, replace

import numpy as np

from calibtool.measurement.checks.finding import Finding, Numbers
from calibtool.measurement.checks.nominal_fit import nominal_fit
from calibtool.measurement.checks.unexplained import Unexplained
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import observation_matrix
from calibtool.measurement.streams import JointStream
from calibtool.robot.se3 import readonly
from calibtool.units import millimetres

_WIDEST = 0.5  # s: largest offset that is looked for
_STEPS = 51
_ROUNDS = 6
_CLEAR = 5.0  # standard errors at which an offset is named
_SMALL = 0.1e-3  # s: smaller offsets do not matter


@dataclass(frozen=True)
class ClockOffset:
    """The offset to add to the stamps of the measurements, its standard error, both in s, and the
    rms without and with it, m.
    """

    offset: float
    error: float
    before: float
    after: float


def clock_offset(measurements: Measurements, stream: JointStream) -> ClockOffset | None:
    """The offset up to ±0.5 s with which the joints explain the points best; None where the arm
    stands still.

    Effects that errors of the robot could explain do not count. A backlash moves the joints with
    the sign of their rates, an offset with the rates themselves.
    """
    if np.abs(stream.at(0.0)[1]).max() < 1e-3:
        return None

    def at(offset: float) -> Measurements:
        there = replace(stream, offset=offset)
        direction = readonly(there.directions())
        conditions = replace(measurements.conditions, direction=direction)
        return replace(measurements, q=readonly(there.at(offset)[0]), conditions=conditions)

    tried = np.linspace(-_WIDEST, _WIDEST, _STEPS)
    sizes = [nominal_fit(at(offset), free=False).rms for offset in tried]
    if not np.isfinite(sizes).any():
        return None
    offset, error = float(tried[int(np.argmin(sizes))]), np.inf
    for _ in range(_ROUNDS):
        moved = at(offset)
        fit = nominal_fit(moved, free=False)
        rates = stream.at(offset)[1]
        T, jacobian = moved.robot.mechanism.forward_and_jacobian(moved.q)
        columns = observation_matrix(fit.setup, T) @ (jacobian @ rates[..., None])
        moving = columns[..., 0] * moved.seen.repeat(3, axis=-1)
        step, error = Unexplained.of(moved, fit.setup).slope(moving, fit.residual)
        offset += float(np.clip(step, -0.05, 0.05))
        if abs(step) < 1e-7:
            break
    return ClockOffset(
        offset,
        error,
        nominal_fit(at(stream.offset), free=False).rms,
        nominal_fit(at(offset), free=False).rms,
    )


def clock_finding(measurements: Measurements, stream: JointStream | None) -> Finding | None:
    """Whether the two clocks agree."""
    if stream is None or (found := clock_offset(measurements.points_alone(), stream)) is None:
        return None
    difference = found.offset - stream.offset
    clear = abs(difference) > max(_CLEAR * found.error, _SMALL) and found.after < found.before
    numbers: Numbers = {
        "clock_offset_s": found.offset,
        "used_s": stream.offset,
        "standard_error_s": found.error,
        "rms_mm": found.before * 1e3,
        "repaired_rms_mm": found.after * 1e3,
    }
    if not clear:
        return Finding(
            "clock_offset", "note", f"the clocks agree to {found.error * 1e3:.2g} ms", numbers
        )
    message = (
        f"the joints are those of another instant: with {found.offset:+.4g} s added to the stamps "
        f"of the points the nominal robot fits them to {millimetres(found.after)} rms, now to "
        f"{millimetres(found.before)}; import with --clock-offset {found.offset:.4f}"
    )
    return Finding("clock_offset", "warning", message, numbers)
