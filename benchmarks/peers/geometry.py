"""Geometric identification beside figaroh, pybotics and robotkinecal, from the same measurements.

Run: python benchmarks/peers/geometry.py [--seeds 20] [--python PACKAGE=PYTHON]. A UR10 given as
modified Denavit–Hartenberg (MDH) parameters, which a URDF says exactly too; 50 configurations of
the whole joint range, 0.05 mm noise, judged at 1,000 fresh ones without noise. Base frame and
nominal targets are given to all. `with_<tool>.py` is what a user writes; every tool runs it in a
process of its own. pybotics takes one target; with three, the others see orientation as well:
robotkinecal as 6-D poses, to which its user fits the three points.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import contextlib
import importlib
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from process import Interpreters, PeerError, add_interpreters, interpreters, output, require

HERE = Path(__file__).resolve().parent
MDH = np.array(  # α rad, a mm, θ rad, d mm: pybotics.predefined_models.ur10()
    [
        [0, 0, 0, 118],
        [np.pi / 2, 0, np.pi, 0],
        [0, 612.7, 0, 0],
        [0, 571.6, 0, 163.9],
        [-np.pi / 2, 0, 0, 115.7],
        [np.pi / 2, 0, np.pi, 92.2],
    ]
)
TARGETS = np.array([[0.1, 0.0, 0.05], [-0.05, 0.0866, 0.05], [-0.05, -0.0866, 0.05]])
LENGTH, ANGLE, NOISE = 0.5e-3, 0.5e-3, 0.05e-3  # standard deviations of every error, m and rad
CONFIGURATIONS, FRESH = 50, 1000


CASES = {
    "all": "Actual robot with δζ, δξ and δq at every joint (all of Eq. 8, calibtool's own ground)",
    "mdh": "Actual robot with other MDH parameters and tool point (pybotics' own ground)",
    "placements": "Actual robot with other joint placements and tool (figaroh's own ground)",
}


@dataclass(frozen=True)
class Entry:
    """One row of the table: tool, module, settings of that module, number of targets."""

    tool: str
    package: str
    settings: dict[str, object]
    targets: int


ENTRIES = (
    Entry("calibtool `complete`", "calibtool", {}, 1),
    Entry("figaroh `structural`", "figaroh", {"METHOD": "structural"}, 1),
    Entry("figaroh `map`", "figaroh", {"METHOD": "map"}, 1),
    Entry("pybotics, chain and tool", "pybotics", {"WORLD": False}, 1),
    Entry("pybotics, chain, tool and world", "pybotics", {"WORLD": True}, 1),
    Entry("robotkinecal, points", "robotkinecal", {}, 1),
    Entry("calibtool `complete`", "calibtool", {}, 3),
    Entry("figaroh `structural`", "figaroh", {"METHOD": "structural"}, 3),
    Entry("figaroh `map`", "figaroh", {"METHOD": "map"}, 3),
    Entry("robotkinecal, poses", "robotkinecal", {}, 3),
)


def mdh_placements(mdh: np.ndarray) -> np.ndarray:
    """Rx(α) Tx(a) Rz(θ) Tz(d) of every row, the joint then turns about z: (n, 4, 4), m."""
    ca, sa, ct, st = np.cos(mdh[:, 0]), np.sin(mdh[:, 0]), np.cos(mdh[:, 2]), np.sin(mdh[:, 2])
    a, d = mdh[:, 1] / 1e3, mdh[:, 3] / 1e3
    zero, one = np.zeros(len(mdh)), np.ones(len(mdh))
    rows = [
        [ct, -st, zero, a],
        [st * ca, ct * ca, -sa, -d * sa],
        [st * sa, ct * sa, ca, d * ca],
        [zero, zero, zero, one],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def urdf(placements: np.ndarray) -> str:
    from scipy.spatial.transform import Rotation

    links = (
        '<link name="base"/>'
        + "".join(f'<link name="l{j}"/>' for j in range(1, 7))
        + '<link name="flange"/>'
    )
    joints = ""
    for j, M in enumerate(placements, 1):
        xyz = " ".join(f"{x:.17g}" for x in M[:3, 3])
        rpy = " ".join(f"{x:.17g}" for x in Rotation.from_matrix(M[:3, :3]).as_euler("xyz"))
        parent = "base" if j == 1 else f"l{j - 1}"
        joints += (
            f'<joint name="j{j}" type="revolute"><parent link="{parent}"/><child link="l{j}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>'
            '<limit lower="-3.141592653589793" upper="3.141592653589793" effort="1" '
            'velocity="1"/></joint>'
        )
    joints += '<joint name="mount" type="fixed"><parent link="l6"/><child link="flange"/></joint>'
    return f'<robot name="arm">{links}{joints}</robot>'


def geometric_errors(case: str, robot, rng: np.random.Generator):
    """The actual robot's errors: `all` δζ, δξ, δq; `mdh` the 24 parameters; `placements`
    δζ of the joints.
    """
    from calibtool.errormodel.robot_errors import RobotErrors
    from calibtool.robot.se3 import inverse, log6

    sizes = np.repeat([LENGTH, ANGLE], 3)
    n = robot.n
    placements, twists, offsets = np.zeros((n + 1, 6)), np.zeros((n, 6)), np.zeros(n)
    if case == "mdh":
        changed = MDH + rng.normal(size=MDH.shape) * [ANGLE, 1e3 * LENGTH, ANGLE, 1e3 * LENGTH]
        placements[:n] = log6(inverse(mdh_placements(MDH)) @ mdh_placements(changed))
        placements[n, :3] = rng.normal(size=3) * LENGTH
    else:
        placements = rng.normal(size=(n + 1, 6)) * sizes
    if case == "all":
        twists, offsets = rng.normal(size=(n, 6)) * sizes, rng.normal(size=n) * ANGLE
    return RobotErrors.of(robot, placements=placements, twists=twists, offsets=offsets)


def write_case(folder: Path, case: str, seed: int) -> None:
    """robot.urdf, mdh.csv, train.csv, and fresh.npz that no tool sees."""
    from calibtool.robot.catalogue import load_robot
    from calibtool.robot.se3 import transform_points

    (folder / "robot.urdf").write_text(urdf(mdh_placements(MDH)))
    np.savetxt(folder / "mdh.csv", MDH, delimiter=",", fmt="%.17g")
    rng = np.random.default_rng([seed, *case.encode()])
    robot = load_robot(str(folder / "robot.urdf"))
    errors = geometric_errors(case, robot, rng)
    q = rng.uniform(-np.pi, np.pi, (CONFIGURATIONS + FRESH, robot.n))
    points = transform_points(errors.frames(q).tool, TARGETS)
    nominal = transform_points(robot.mechanism.forward(q), TARGETS)
    train = points[:CONFIGURATIONS] + rng.normal(size=(CONFIGURATIONS, 3, 3)) * NOISE
    header = ",".join(
        [f"j{j}" for j in range(1, 7)] + [f"{c}{k}" for k in (1, 2, 3) for c in "xyz"]
    )
    table = np.hstack([q[:CONFIGURATIONS], train.reshape(CONFIGURATIONS, 9)])
    np.savetxt(folder / "train.csv", table, delimiter=",", header=header, comments="", fmt="%.12g")
    fresh = slice(CONFIGURATIONS, None)
    np.savez(folder / "fresh.npz", q=q[fresh], points=points[fresh], nominal=nominal[fresh])


def run_tool(entry: Entry, folders: list[Path], pythons: Interpreters) -> np.ndarray:
    """Mean and maximum position error in mm and CPU seconds, one row per folder.

    PeerError if missing or failed.
    """
    python = pythons[entry.package]
    require(entry.package, python)
    text = output([__file__, "--tool", str(ENTRIES.index(entry)), *map(str, folders)], python)
    return np.array([[float(x) for x in line.split()] for line in text.splitlines()])


def tool_process(entry: Entry, folders: list[Path]) -> None:
    """Inside the tool's process: calibrate in every folder, judge on its fresh configurations."""
    user = importlib.import_module(f"with_{entry.package}")
    for name, value in entry.settings.items():
        setattr(user, name, value)
    targets = TARGETS[: entry.targets]
    np.random.seed(0)  # noqa: NPY002 (robotkinecal draws from it)
    for folder in folders:
        fresh = np.load(folder / "fresh.npz")
        with contextlib.redirect_stdout(sys.stderr):
            start = time.process_time()
            predict = user.calibrate(folder, targets)
            seconds = time.process_time() - start
            errors = (
                np.linalg.norm(predict(fresh["q"]) - fresh["points"][:, : entry.targets], axis=-1)
                * 1e3
            )
        print(errors.mean(), errors.max(), seconds, flush=True)


def lines(package: str) -> int:
    """Non-blank lines of what the user writes, without docstring and comments."""
    text = (HERE / f"with_{package}.py").read_text(encoding="utf-8").split('"""', 2)[2]
    return sum(1 for line in text.splitlines() if line.strip() and not line.strip().startswith("#"))


def cells(values: np.ndarray) -> str:
    median, worst = np.median(values, axis=0), values.max(axis=0)
    return " | ".join(f"{m:.3f} ({w:.3f})" for m, w in zip(median[:2], worst[:2], strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    add_interpreters(parser)
    parser.add_argument("--tool", type=int, help=argparse.SUPPRESS)
    parser.add_argument("folders", nargs="*", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.tool is not None:
        tool_process(ENTRIES[arguments.tool], arguments.folders)
        return
    print(f"Median of {arguments.seeds} actual robots (worst); time is that of one CPU.")
    for case, title in CASES.items():
        print(
            f"\n**{title}**\n\n| targets | tool | mean mm | max mm | calibtool nearer (mean) | "
            "time | lines |"
        )
        print("|---|---|---|---|---|---|---|")
        with tempfile.TemporaryDirectory() as place:
            folders = [Path(place, str(seed)) for seed in range(arguments.seeds)]
            for seed, folder in enumerate(folders):
                folder.mkdir()
                write_case(folder, case, seed)
            for count in (1, 3):
                table(folders, count, interpreters(arguments))


def table(folders: list[Path], count: int, pythons: Interpreters) -> None:
    """The rows of one case with `count` targets."""
    before = []
    for folder in folders:
        fresh = np.load(folder / "fresh.npz")
        size = np.linalg.norm(fresh["nominal"] - fresh["points"], axis=-1)[:, :count] * 1e3
        before.append([size.mean(), size.max()])
    print(f"| {count} | nominal | {cells(np.array(before))} | | | |")
    own = None
    for entry in (e for e in ENTRIES if e.targets == count):
        start = f"| {count} | {entry.tool} |"
        try:
            results = run_tool(entry, folders, pythons)
        except PeerError as error:
            print(f"{start} {error} | | | | |", flush=True)
            continue
        own = results[:, 0] if entry.package == "calibtool" else own
        nearer = (
            ""
            if own is None or entry.package == "calibtool"
            else f"{int((own < results[:, 0]).sum())} of {len(own)}"
        )
        median = np.median(results[:, 2])
        print(
            f"{start} {cells(results)} | {nearer} | {median:.2f} s | {lines(entry.package)} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
