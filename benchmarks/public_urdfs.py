"""Robots as they come: every URDF of a folder, read without a robot.toml.

Run: python benchmarks/public_urdfs.py FOLDER [--no-arm REGEX] [--list].
Every .urdf file below FOLDER (URDFs with the same text count once) is read as `calibtool robots
FILE` would: it is loaded, the tool is asked for (`--tool`), or it is refused. Files whose path
matches --no-arm (hands, vehicles, humanoids: name them yourself) are counted apart. Each that is
loaded is compared at 50 random configurations with Pinocchio's reading of the original file, or,
where Pinocchio refuses the file, of its links and joints alone.
`--list` prints a line per file.
"""

import argparse
import os
import re
from collections import Counter
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pinocchio as pin

from calibtool.errors import CalibtoolError, UsageError
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.urdf import joint_name, parse_urdf

ROWS = 50


def original(path: Path, robot: Robot) -> tuple[pin.Model, bool]:
    """Pinocchio's model of a file, and whether Pinocchio reads the file as it is."""
    kept = os.dup(2)
    with open(os.devnull, "wb") as nothing:
        os.dup2(nothing.fileno(), 2)  # urdfdom prints its warnings
        try:
            return pin.buildModelFromUrdf(str(path)), True
        except (ValueError, RuntimeError):
            return parse_urdf(robot.source.urdf_text, str(path)), False
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def difference(path: Path, robot: Robot) -> tuple[float, bool]:
    """Largest difference of an element of T_base_tool (m or 1) from Pinocchio's, see `original`."""
    model, own = original(path, robot)
    data, kinematics = model.createData(), robot.source.description.kinematics
    low, high = np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0)
    q = low + (high - low) * np.random.default_rng(0).random((ROWS, robot.n))
    names = [joint_name(model, j) for j in range(model.njoints)]
    tool = next(
        k
        for k, frame in enumerate(model.frames)
        if frame.type == pin.FrameType.BODY and frame.name == kinematics.tool_frame
    )
    found = []
    for row, pose in zip(q, robot.mechanism.forward(q), strict=True):
        full = pin.neutral(model)
        values = dict(zip(robot.chain.bodies.joints, row, strict=True)) | kinematics.locked_joints
        for name, value in values.items():
            joint = model.joints[names.index(name, 1)]
            if joint.nq == 1:
                full[joint.idx_q] = value
            elif joint.nv == 1:
                full[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
        pin.framesForwardKinematics(model, data, full)
        found.append(np.abs(data.oMf[tool].homogeneous - pose).max())
    return float(max(found)), own


def outcome(path: Path) -> tuple[str, str, Robot | None]:
    """loaded, asked or refused; why; and the robot."""
    try:
        robot = load_robot(str(path))
    except UsageError as error:
        return "asked", str(error), None
    except CalibtoolError as error:
        return "refused", str(error), None
    tool = robot.source.description.kinematics.tool_frame
    return "loaded", f"{robot.n} joints, tool {tool}", robot


def reason(why: str) -> str:
    """A refusal without names and numbers."""
    return re.sub(r"'[^']*'|\d+", "…", why.split(": ", 1)[-1]).split(";")[0][:90]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--no-arm", default="$^")
    parser.add_argument("--list", action="store_true")
    options = parser.parse_args()
    seen: set[bytes] = set()
    counts: dict[bool, Counter[str]] = {True: Counter(), False: Counter()}
    reasons: Counter[tuple[bool, str, str]] = Counter()
    worst, compared, refused_by_pinocchio = 0.0, 0, 0
    for path in sorted(options.folder.rglob("*")):
        if path.suffix.lower() != ".urdf" or not path.is_file() or path.read_bytes() in seen:
            continue
        seen.add(path.read_bytes())
        place = str(path.relative_to(options.folder))
        arm = not re.search(options.no_arm, place, re.IGNORECASE)
        found, why, robot = outcome(path)
        counts[arm][found] += 1
        if robot is not None:
            off, own = difference(path, robot)
            worst, compared = max(worst, off), compared + 1
            refused_by_pinocchio += not own
            why += f", {off:.1e}"
        else:
            reasons[arm, found, reason(why)] += 1
        if options.list:
            print("arm  " if arm else "other", f"{found:8}", place, "|", why[:300])
    for arm, name in ((True, "arms"), (False, "others")):
        total = counts[arm].total()
        share = "".join(f", {kind} {count}" for kind, count in counts[arm].most_common())
        print(f"{name}: {total}{share}; loaded {100 * counts[arm]['loaded'] / max(total, 1):.1f} %")
        for (which, kind, why), count in reasons.most_common():
            if which == arm:
                print(f"  {kind} {count}: {why}")
    print(
        f"T_base_tool against Pinocchio, {compared} robots: at most {worst:.1e} m or 1 "
        f"({refused_by_pinocchio} files that Pinocchio refuses were compared by links and joints)"
    )


if __name__ == "__main__":
    main()
