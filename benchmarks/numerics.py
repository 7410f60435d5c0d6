"""Figures at the edges of floating point: singularities, sizes, many turns, targets almost on a
line, extreme noise.

Run: python benchmarks/numerics.py [--json]

The cases are those of tests/test_numerics.py; docs/numerics.md shows the tables.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

import numpy as np
from drawn import DrawnChain
from test_numerics import (
    ARM,
    DISTANCES,
    SINGULAR,
    SLIDES,
    TARGETS,
    TOOL,
    WRIST,
    calibrated,
    seen_with,
)
from test_numerics import towards_singularity as towards

from calibtool.calibration import identify
from calibtool.compensation.solve import compensate_joints
from calibtool.compensation.status import OK
from calibtool.errormodel.actual import ErrorScales
from calibtool.errors import InputError
from calibtool.evaluation.compare import evaluate
from calibtool.measurement.setup import check_targets
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array
from calibtool.robot.singularity import MIN_SINGULARITY_DISTANCE

Table = list[list[str]]  # a header and rows


def singularities() -> Table:
    """17 configurations, the joint 10⁻¹ … 10⁻⁸ rad to either side of its singularity and on it."""
    rows = [
        [
            "robot, joint",
            "method",
            "largest change rad",
            "left where ok mm",
            "left elsewhere mm",
            "not `ok` below",
        ]
    ]
    for name, joint in SINGULAR:
        calibration = calibrated(name)
        q = towards(calibration.robot, joint)
        for method in ("exact", "one-step"):
            result = compensate_joints(calibration, q, method)
            ok = result.status == OK
            left = [
                f"{result.position[rows_].max() * 1e3:.1e}" if rows_.any() else "–"
                for rows_ in (ok, ~ok)
            ]
            below = f"{np.abs(DISTANCES)[~ok].max():.0e} rad" if (~ok).any() else "–"
            rows.append(
                [f"{name}, j{joint + 1}", method, f"{np.abs(result.q - q).max():.3f}", *left, below]
            )
    return rows


def sizes() -> Table:
    """Errors and noise in proportion to the arm; judged at fresh configurations without noise,
    those corrected in full.
    """
    rows = [
        [
            "robot",
            "factor",
            "reach about",
            "largest error mm",
            "per factor mm",
            "largest rotation mrad",
        ]
    ]
    for name, first in (("arm, 6 revolute", ARM), ("gantry, 3 slides and a wrist", SLIDES)):
        for scale in (0.005, 1.0, 50.0):
            robot = DrawnChain(tuple(first + WRIST), TOOL, TARGETS).robot(
                scale=scale, tolerance_mm=scale
            )
            errors = ErrorScales(length=0.5e-3 * scale)
            data = simulate(
                robot,
                Simulation(
                    seed=1,
                    configurations=50,
                    scales=errors,
                    noise=0.05e-3 * scale,
                    workspace="full",
                ),
            )
            fresh = simulate(
                robot,
                Simulation(
                    seed=2, configurations=60, noise=0.0, same_robot=data.truth, workspace="full"
                ),
            )
            calibration = identify(data, "complete")
            fresh = fresh.rows(np.flatnonzero(compensate_joints(calibration, fresh.q).status == OK))
            found = evaluate([("complete", calibration)], fresh).methods[1]
            worst, turned = found.position_size.max() * 1e3, found.orientation_size
            assert turned is not None
            reach = np.linalg.norm(robot.mechanism.forward(fresh.q)[:, :3, 3], axis=1).max()
            told = [f"{worst:.3g}", f"{worst / scale:.3f}", f"{turned.max() * 1e3:.3f}"]
            rows.append(
                [
                    name,
                    f"{scale:g}",
                    f"{reach * 1e3:.0f} mm" if reach < 0.1 else f"{reach:.1f} m",
                    *told,
                ]
            )
    return rows


def turns() -> Table:
    """The last three joints of a FANUC M-1000iA turned further by whole turns:
    digits that are lost.
    """
    rows = [["turned by rad", "nominal pose", "calibrated pose", "corrected joints rad"]]
    calibration = calibrated("fanuc-m1000ia")
    robot, q = calibration.robot, calibration.q[:10]
    steady = calibration.base.errors.without("twists")
    plain = replace(calibration, base=replace(calibration.base, errors=steady), networks=())
    for turned in (1e3, 1e4, 1e5, 1e6):
        far = q + np.array([0, 0, 0, 1, 1, 1]) * round(turned / (2 * np.pi)) * 2 * np.pi
        nominal = robot.mechanism.forward(far) - robot.mechanism.forward(q)
        told = plain.forward(far) - plain.forward(q)
        joints = (compensate_joints(plain, far).q - far) - (compensate_joints(plain, q).q - q)
        rows.append(
            [f"{turned:.0e}", *(f"{np.abs(lost).max():.0e}" for lost in (nominal, told, joints))]
        )
    return rows


def collinear() -> Table:
    """Three targets on 0.2 m, the middle one `width` times 0.2 m off the line; 40
    configurations, noise 0.05 mm.
    """
    rows = [["off the line", "when read", "largest error of the complete model, forced, mm"]]
    fanuc = load_robot("fanuc-m1000ia")
    data = simulate(fanuc, Simulation(seed=1))
    data = data.rows(np.arange(40))
    for width in 10.0 ** -np.arange(1, 10):
        targets = np.array([[-0.1, 0, 0.05], [0.1, 0, 0.05], [0, 0.2 * width, 0.05]])
        try:
            check_targets(targets, "targets")
            verdict = "accepted"
        except InputError:
            verdict = "refused: collinear"
        rows.append([f"{0.2e3 * width:.0e} mm", verdict, f"{_off(data, targets) * 1e3:.3f}"])
    return rows


def _off(data, targets: Array) -> float:
    found = identify(seen_with(data, targets), "complete")
    return float(
        np.linalg.norm(
            (data.truth.actual.forward(data.q) - found.forward(data.q))[:, :3, 3], axis=1
        ).max()
    )


def noise() -> Table:
    """FANUC M-1000iA, 40 configurations: the largest error at the measured
    ones, before and after.
    """
    rows = [["noise", "nominal mm", "complete mm"]]
    fanuc = load_robot("fanuc-m1000ia")
    for size in (0.0, 1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6):
        simulation = Simulation(seed=1, configurations=40, noise=size)
        data = simulate(fanuc, simulation)
        assert data.truth is not None
        true = data.truth.actual.forward(data.q)
        poses = fanuc.mechanism.forward(data.q), identify(data, "complete").forward(data.q)
        worst = [np.linalg.norm((true - pose)[:, :3, 3], axis=1).max() * 1e3 for pose in poses]
        rows.append(
            [
                f"{size:g} m",
                f"{worst[0]:.3f}",
                f"{worst[1]:.2g}" if worst[1] < 0.01 else f"{worst[1]:.3f}",
            ]
        )
    return rows


TABLES = {
    "singularities": singularities,
    "sizes": sizes,
    "turns": turns,
    "collinear": collinear,
    "noise": noise,
}


def main() -> None:
    parser = argparse.ArgumentParser(description="Figures at the edges of floating point.")
    parser.add_argument("--json", action="store_true")
    tables = {name: made() for name, made in TABLES.items()}
    tables["limits"] = [
        ["quantity", "value"],
        ["MIN_SINGULARITY_DISTANCE", f"{MIN_SINGULARITY_DISTANCE:g}"],
    ]
    if parser.parse_args().json:
        print(json.dumps(tables))
        return
    for name, (header, *rows) in tables.items():
        print(f"\n{name}\n")
        for row in (header, ["---"] * len(header), *rows):
            print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main()
