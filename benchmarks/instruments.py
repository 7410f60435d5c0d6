"""What instruments beside a tracker give: mean position error on unseen poses over the whole range.

    python benchmarks/instruments.py [--seeds 20] [--only NAME]

A ur10 with geometric errors (without pitch, 0.169 mm and 0.169 mrad: about 0.63 mm of the nominal
robot), contacts and wires to 0.05 mm, boards to 0.04, 0.04, 0.07 mm and 0.21 mrad. The complete
model is identified from the readings alone, and judged at 300 configurations of the whole joint
range by the description's three targets, base and tool frame fitted for either robot. `bound` is
the error over the one that the posterior predicts (1: the Cramér–Rao bound with the tolerances).
"""

import argparse
from dataclasses import replace

import numpy as np

from calibtool.calibration import identify
from calibtool.calibration.uncertainty import predicted_uncertainty
from calibtool.errormodel.actual import ErrorScales
from calibtool.errors import NoSolutionError
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.registration import register
from calibtool.measurement.setup import Setup
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array, transform_points

ROBOT = load_robot("ur10")
SIZE = 0.169e-3
CASES = {  # instrument, places, rows, length of its gauge in m, what to reach in mm
    "two sockets 50 mm apart, 1 placement": ("contact", 1, 80, None, None),
    "two sockets 50 mm apart, 2 placements": ("contact", 2, 80, None, None),
    "two sockets 50 mm apart, 4 placements": ("contact", 4, 80, None, 0.08),
    "the same, 160 contacts": ("contact", 4, 160, None, 0.08),
    "the same, 320 contacts (80 per placement)": ("contact", 4, 320, None, 0.08),
    "two sockets 200 mm apart, 4 placements": ("contact", 4, 80, 0.2, 0.08),
    "camera on the tool, board poses": ("board", 1, 60, None, 0.24),
    "camera on the tool, corners": ("corners", 1, 60, None, 0.24),
    "camera beside the arm, board poses": ("camera", 1, 60, None, 0.16),
    "camera beside the arm, corners": ("corners-beside", 1, 60, None, 0.16),
    "one wire": ("distance", 1, 80, None, 0.08),
    "three wires": ("distance", 3, 80, None, 0.04),
    "probe on 3 planes": ("plane", 3, 80, None, 0.15),
    "probe on 3 planes, 240 rows (80 per plane)": ("plane", 3, 240, None, 0.15),
    "probe on 3 planes, block of 200 mm": ("plane", 3, 80, 0.2, 0.15),
    "probe on 3 spheres": ("sphere", 3, 80, None, None),
    "tool seen from a second arm": ("second-arm", 1, 80, None, 0.1),
}


def mean_error(actual: Array, poses: Array) -> float:
    """Of the targets, after the best base and tool frame, mm."""
    points = transform_points(actual, ROBOT.targets)
    blank = Setup(np.eye(4), np.zeros_like(ROBOT.targets), frame_known=False, targets_known=False)
    q = np.zeros((len(poses), ROBOT.n))
    setup = register(Measurements(ROBOT, q, points, None, blank, 1e-4, 1e-4), poses)
    predicted = transform_points(setup.T_instrument_base @ poses, setup.targets)
    return float(np.linalg.norm(points - predicted, axis=-1).mean()) * 1e3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--only", default="", help="instruments whose name holds this")
    options = parser.parse_args()
    seeds = options.seeds
    print(f"{'instrument':<40}{'nominal':>9}{'mean':>8}{'median':>8}{'max':>8}{'bound':>7}  asked")
    for name, (instrument, places, rows, gauge, asked) in CASES.items():
        if options.only not in name:
            continue
        found, failed = [], 0
        for seed in range(seeds):
            scales = ErrorScales(length=SIZE, angle=SIZE)
            truth = simulate(
                ROBOT, Simulation(seed=seed, configurations=4, scales=scales, workspace="full")
            ).truth
            assert truth is not None
            errors = truth.actual.errors.without("twists")
            truth = replace(truth, actual=replace(truth.actual, errors=errors))
            try:
                seen = simulate(
                    ROBOT,
                    Simulation(
                        seed=seed,
                        configurations=rows,
                        same_robot=truth,
                        instrument=instrument,
                        places=places,
                        workspace="full",
                        gauge=gauge,
                    ),
                )
                calibration = identify(seen)
            except NoSolutionError:
                failed += 1
                continue
            rng = np.random.default_rng(1000 + seed)
            q = ROBOT.lower + (ROBOT.upper - ROBOT.lower) * rng.random((300, ROBOT.n))
            actual = truth.actual.forward(q)
            after = mean_error(actual, calibration.forward(q))
            expected = float(predicted_uncertainty(calibration, q).position.mean()) * 1e3
            found.append((mean_error(actual, ROBOT.mechanism.forward(q)), after, after / expected))
        table = np.array(found)
        print(
            f"{name:<40}{table[:, 0].mean():>9.3f}{table[:, 1].mean():>8.3f}"
            f"{np.median(table[:, 1]):>8.3f}{table[:, 1].max():>8.3f}"
            f"{np.median(table[:, 2]):>7.2f}  {asked or '':<6}"
            + (f"{failed} of {seeds} seeds without a solution" if failed else ""),
            flush=True,
        )


if __name__ == "__main__":
    main()
