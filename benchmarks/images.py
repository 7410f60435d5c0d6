"""From images to a calibration: rendered boards against ideal corners, and how long it takes.

    python benchmarks/images.py [--seeds 5] [--images 60]

As benchmarks/instruments.py with a camera on the tool: a ur10 with geometric errors, 60 images of
1600 × 1200 px rendered from the actual robot (lens with distortion, sensor noise, blur), detected,
the lens calibrated from them and the complete model identified. `ideal` has the corners where they
really are, with normal noise as large as that of the detection. Needs OpenCV (the extra `camera`).
"""

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from instruments import ROBOT, SIZE, mean_error

from calibtool.calibration import identify
from calibtool.errormodel.actual import ErrorScales
from calibtool.measurement.images.image_import import images_in, import_images
from calibtool.measurement.images.rendering_boards import rendered
from calibtool.measurement.instruments.image_corners import BOARD, LENS
from calibtool.measurement.instruments.image_corners import SIZE as PIXELS
from calibtool.measurement.kinds.projection import project
from calibtool.measurement.measurements import Truth
from calibtool.measurement.registration import register
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.planning.joint_table import joint_table
from calibtool.robot.se3 import inverse, readonly, transform_points


def robot_without_pitch(seed: int) -> Truth:
    scales = ErrorScales(length=SIZE, angle=SIZE)
    drawn = Simulation(seed=seed, configurations=4, scales=scales, workspace="full")
    truth = simulate(ROBOT, drawn).truth
    assert truth is not None
    errors = truth.actual.errors.without("twists")
    return replace(truth, actual=replace(truth.actual, errors=errors))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--images", type=int, default=60)
    options = parser.parse_args()
    header = ("images", "noise px", "import s", "images mm", "ideal mm")
    print("seed" + "".join(f"{word:>11}" for word in header))
    both = []
    for seed in range(options.seeds):
        truth = robot_without_pitch(seed)
        seen = simulate(
            ROBOT,
            Simulation(
                seed=seed,
                configurations=options.images,
                same_robot=truth,
                instrument="corners",
                workspace="full",
            ),
        )
        assert seen.truth is not None
        setup, actual = seen.truth.setup, seen.truth.actual
        board = inverse(actual.forward(seen.q) @ setup.T_tool_camera) @ setup.T_base_boards[0]
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            rng = np.random.default_rng(seed)
            for k, image in enumerate(rendered(BOARD, board, LENS, PIXELS, rng)):
                cv2.imwrite(str(folder / f"img{k}.png"), image)
            text = joint_table(ROBOT, seen.q)
            begun = time.perf_counter()
            imported = import_images(images_in(folder), text, "joints.csv", ROBOT, BOARD)
            measured = imported.measurements
            measured = replace(measured, setup=register(measured))
            took = time.perf_counter() - begun
        kept = [int(path.stem[3:]) for path in imported.paths]
        true = project(transform_points(board[kept], BOARD.corners), LENS)
        noise = float(np.sqrt(np.nanmean((imported.pixels - true) ** 2)))
        ideal = np.where(np.isfinite(imported.pixels), true, np.nan)
        ideal = ideal + rng.normal(size=ideal.shape) * noise
        exact = replace(measured, values=readonly(ideal.reshape(len(kept), -1)))
        rng = np.random.default_rng(1000 + seed)
        q = ROBOT.lower + (ROBOT.upper - ROBOT.lower) * rng.random((300, ROBOT.n))
        errors = [
            mean_error(actual.forward(q), identify(data).forward(q)) for data in (measured, exact)
        ]
        both.append(errors)
        print(
            f"{seed:>4}{len(kept):>11}{noise:>11.3f}{took:>11.1f}{errors[0]:>11.4f}"
            f"{errors[1]:>11.4f}",
            flush=True,
        )
    means = np.mean(both, axis=0)
    print(f"mean: {means[0]:.4f} mm, {means[0] / means[1]:.2f} times that of ideal corners")


if __name__ == "__main__":
    main()
