"""How often `import` calls a steady arm drifting: planned rows in order of short travel, while a
thermometer rises.

    python benchmarks/drift.py [--seeds 100]

The stated rate is 1 % of sets (docs/file-formats.md). Arms with geometric errors alone, and with
gear, gravity and backlash errors too, 0.05 mm noise, 30 rows, one target or three. `seen` is how
often a true drift of 0.2 mm over the rows is named.
"""

import argparse
from dataclasses import replace

import numpy as np

from calibtool.errormodel.actual import ErrorScales
from calibtool.measurement.auxiliary import AuxiliaryReadings
from calibtool.measurement.checks import check_measurements
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.planning.visiting_order import short_order
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import readonly

ROWS = 30


def warned(measurements: Measurements) -> bool:
    """Whether a trend with temperature is a warning."""
    rising = AuxiliaryReadings(temperature_c=21.4 + 0.4 * np.linspace(0, 1, len(measurements)))
    found = check_measurements(measurements, rising)
    return any(f.name == "temperature_trend" and f.severity == "warning" for f in found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    seeds = parser.parse_args().seeds
    drift = np.linspace(0, 0.2e-3, ROWS)[:, None, None] * [0.0, 0.6, 0.8]
    for name in ("ur10", "fanuc-m1000ia"):
        robot = load_robot(name)
        space = robot.workspace()
        for kinds in (("geometric",), ("geometric", "gear", "gravity", "backlash")):
            for targets in (1, 3):
                false = true = 0
                for seed in range(seeds):
                    q = sample_configurations(robot, space, ROWS, np.random.default_rng(seed))
                    q = q[short_order(robot, q, space.home)]
                    scales = ErrorScales(kinds=kinds)
                    steady = simulate(
                        robot, Simulation(seed=seed, at=q, scales=scales, unregistered=True)
                    )
                    setup = replace(steady.setup, targets=steady.setup.targets[:targets])
                    points = steady.points[:, :targets]
                    steady = replace(steady, points=readonly(points), setup=setup, truth=None)
                    false += warned(steady)
                    true += warned(replace(steady, points=readonly(points + drift)))
                print(
                    f"{name:<14} {'+'.join(kinds):<32} {targets} targets: "
                    f"false {false} of {seeds}, seen {true} of {seeds}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
