"""How well the offset between two clocks is found on a moving arm, and what its rest becomes.

    python benchmarks/clocks.py [--seeds 5] [--backlash]

A ur10 whose joints all move at up to 1.6 rad/s for 60 s: a tracker at 10 Hz with 0.05 mm, joints
at 125 Hz, to 1e-5 rad, an offset drawn within ±0.5 s, errors of geometry (0.5 mm, 0.5 mrad) and of
gears (0.3 mrad). `--backlash`: half widths of 0.3 mrad beside them. `half width` is the largest
that the complete model finds; without `--backlash` there is none to find.
"""

import argparse
from dataclasses import replace

import numpy as np

from calibtool.calibration import identify
from calibtool.errormodel.actual import ErrorScales
from calibtool.measurement.checks.clocks import clock_offset
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.measurement.streams import JointStream
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array, readonly

ROBOT = load_robot("ur10")
SECONDS, TRACKER, JOINTS, ENCODER = 60.0, 0.1, 0.008, 1e-5  # s, s, s, rad
FINER = 10


def recorded(seed: int, kinds: tuple[str, ...]) -> tuple[Measurements, JointStream, float]:
    """Measurements whose stamps are early by an offset, joints by their clock, the offset, s."""
    rng = np.random.default_rng(seed)
    rates = 2 * np.pi * rng.uniform(0.1, 0.35, ROBOT.n)
    phase = rng.uniform(0, 2 * np.pi, ROBOT.n)
    middle = np.array([0.2, -1.2, 1.3, -1.4, -1.2, 0.3])

    def at(times: Array) -> Array:
        found: Array = middle + 0.7 * np.sin(times[:, None] * rates + phase)
        return found

    offset = float(rng.uniform(-0.5, 0.5))
    stamps = np.arange(0.0, SECONDS, TRACKER)
    known = np.arange(-2.0, SECONDS + 2.0, JOINTS)
    scales = ErrorScales(kinds, sizes={"gear": 0.3e-3, "backlash": 0.3e-3})
    driven = at(np.arange(0.0, SECONDS, TRACKER / FINER) + offset)  # joints turn between stamps
    seen = simulate(ROBOT, Simulation(seed, at=driven, scales=scales, unregistered=True))
    seen = seen.rows(np.arange(0, len(driven), FINER))
    stream = JointStream.of(known, np.round(at(known) / ENCODER) * ENCODER, stamps)
    return seen, stream, offset


def taken_at(seen: Measurements, stream: JointStream, offset: float) -> Measurements:
    """The measurements with the joints of their stamps plus an offset, s."""
    moved = replace(stream, offset=offset)
    conditions = replace(seen.conditions, direction=readonly(moved.directions()))
    return replace(seen, q=readonly(moved.at(offset)[0]), conditions=conditions)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--backlash", action="store_true")
    parser.add_argument("--fast", action="store_true", help="without the complete model")
    options = parser.parse_args()
    kinds = ("geometric", "gear", *(["backlash"] if options.backlash else []))
    print("seed  offset s  error ms  stated ms  half width mrad: true  at the truth  as found")
    for seed in range(options.seeds):
        seen, stream, offset = recorded(seed, kinds)
        found = clock_offset(taken_at(seen, stream, 0.0), stream)
        assert found is not None
        widths = (
            [0.0, 0.0]
            if options.fast
            else [
                np.abs(identify(taken_at(seen, stream, o)).errors["backlash"]).max() * 1e3
                for o in (offset, found.offset)
            ]
        )
        assert seen.truth is not None
        true = np.abs(seen.truth.actual.errors["backlash"]).max() * 1e3
        print(
            f"{seed:>4}{offset:>10.3f}{(found.offset - offset) * 1e3:>10.4f}"
            f"{found.error * 1e3:>11.4f}{true:>23.3f}{widths[0]:>14.3f}{widths[1]:>10.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
