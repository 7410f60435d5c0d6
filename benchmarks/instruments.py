"""What instruments beside a tracker give: mean position error on unseen poses over the whole range.

    python benchmarks/instruments.py [--seeds 20] [--only NAME] [--bounds]

A ur10 with geometric errors (without pitch, 0.169 mm and 0.169 mrad: about 0.63 mm of the nominal
robot), contacts and wires to 0.05 mm, boards to 0.04, 0.04, 0.07 mm and 0.21 mrad. The complete
model is identified from the readings alone, and judged at 300 configurations of the whole joint
range by the description's three targets, base and tool frame fitted for either robot. `bound` is
the mean error at the Cramér–Rao bound of the same rows, with the true families of errors and their
true size as the prior (which no estimate knows); `of it` is the mean error over that, `predicted`
over what the posterior predicts (median). `--bounds`: these alone, without any estimate.
"""

import argparse
from dataclasses import replace

import numpy as np

from calibtool.calibration import identify
from calibtool.calibration.uncertainty import predicted_uncertainty
from calibtool.errormodel.actual import ErrorScales
from calibtool.errors import NoSolutionError
from calibtool.identification.equations import normal_equations
from calibtool.identification.parameters import Parameters, State
from calibtool.measurement.measurements import Measurements, Truth
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


def expected_error(seen: Measurements, truth: Truth, q: Array, rng: np.random.Generator) -> float:
    """Mean error of the targets at q (N, n) at the Cramér–Rao bound, mm: errors drawn from its
    covariance, less what the best base and the best targets take up.
    """
    assert seen.truth is not None
    setup, errors = seen.truth.setup, truth.actual.errors
    parameters = Parameters.of(ROBOT, setup).without("twists")
    information = normal_equations(
        seen, parameters, State(errors, setup), np.ones(len(seen))
    ).information
    own = parameters.blocks["base"].start  # parameters of the arm
    prior = np.where(np.arange(parameters.count) < own, SIZE, 1.0)
    covariance = np.linalg.inv(information + np.diag(prior**-2.0))[:own, :own]
    context = errors.context(q)
    T = context.frames.tool
    points = transform_points(T, ROBOT.targets)
    free = np.eye(points[0].size).reshape(-1, 3, points[0].size)
    of_targets = np.einsum("nij,mjk->nmik", T[:, :3, :3], free).reshape(points.size, -1)
    of_base = _moved(points, np.broadcast_to(np.eye(6), (len(q), 6, 6)))
    F = np.concatenate([of_base, of_targets], axis=1)
    D = _moved(points, parameters.pose_columns(context)[:, :, :own])
    D -= F @ np.linalg.lstsq(F, D, rcond=1e-10)[0]
    drawn = D @ np.linalg.cholesky(covariance) @ rng.normal(size=(own, 200))
    return float(np.linalg.norm(drawn.reshape(-1, 3, 200), axis=1).mean()) * 1e3


def _moved(points: Array, columns: Array) -> Array:
    """What twists (N, 6, p) in K_0 do to points (N, m, 3): (3 N m, p)."""
    turned = np.cross(columns[:, None, 3:], points[..., None], axisa=2, axisb=2, axisc=2)
    found: Array = (columns[:, None, :3] + turned).reshape(points.size, -1)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--only", default="", help="instruments whose name holds this")
    parser.add_argument("--bounds", action="store_true", help="the bounds alone")
    options = parser.parse_args()
    columns = ("nominal", "mean", "median", "max", "bound", "of it", "predicted")
    print(f"{'instrument':<43}" + "".join(f"{c:>10}" for c in columns) + "  asked")
    for name, (instrument, places, rows, gauge, asked) in CASES.items():
        if options.only not in name:
            continue
        found, failed = [], 0
        for seed in range(options.seeds):
            truth = actual_robot(seed)
            simulation = Simulation(
                seed=seed,
                configurations=rows,
                same_robot=truth,
                instrument=instrument,
                places=places,
                workspace="full",
                gauge=gauge,
            )
            try:
                seen = simulate(ROBOT, simulation)
                calibration = None if options.bounds else identify(seen)
            except NoSolutionError:
                failed += 1
                continue
            rng = np.random.default_rng(1000 + seed)
            q = ROBOT.lower + (ROBOT.upper - ROBOT.lower) * rng.random((300, ROBOT.n))
            actual, after, predicted = truth.actual.forward(q), np.nan, np.nan
            if calibration is not None:
                after = mean_error(actual, calibration.forward(q))
                predicted = float(predicted_uncertainty(calibration, q).position.mean()) * 1e3
            before = mean_error(actual, ROBOT.mechanism.forward(q))
            bound = expected_error(seen, truth, q, rng)
            found.append((before, after, bound, after / predicted))
        before, after, bound, ratio = np.array(found).T
        numbers = (before.mean(), after.mean(), np.median(after), after.max(), bound.mean())
        numbers += (after.mean() / bound.mean(), np.median(ratio))
        print(
            f"{name:<43}" + "".join(f"{number:>10.3f}" for number in numbers) + f"  {asked or ''}"
            f"{f'  {failed} of {options.seeds} seeds without a solution' if failed else ''}",
            flush=True,
        )


def actual_robot(seed: int) -> Truth:
    """A robot with errors of placements and offsets."""
    scales = ErrorScales(length=SIZE, angle=SIZE)
    drawn = Simulation(seed=seed, configurations=4, scales=scales, workspace="full")
    truth = simulate(ROBOT, drawn).truth
    assert truth is not None
    errors = truth.actual.errors.without("twists")
    return replace(truth, actual=replace(truth.actual, errors=errors))


if __name__ == "__main__":
    main()
