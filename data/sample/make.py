"""The sample of docs/get-started.md: what a tracker would write of a simulated FANUC M-1000iA.

    python data/sample/make.py data/sample

The robot, with the errors of KINDS, is that of `calibtool simulate fanuc-m1000ia --seed 5
--unregistered`: the tracker stands anywhere, and the three targets are not where the description
has them. driven.csv is no output but an input: the corrected joints of before.csv, as step 2 of
docs/how-to/prove-it.md gave them, to which the arm was driven for after.csv.
"""

import csv
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calibtool.errormodel.actual import ErrorScales
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.planning.constraints import Constraints
from calibtool.planning.iso9283_poses import plan_test
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

KINDS = ("geometric", "gear", "gravity", "backlash", "thermal")
ROBOT, SEED = "fanuc-m1000ia", 5
CUBE, CYCLES = 0.8, 6  # m
DRIVEN = Path(__file__).with_name("driven.csv")

PROGRAM = """/PROG  SEAM
/ATTR
COMMENT		= "two joint targets, two poses";
DEFAULT_GROUP	= 1,*,*,*,*;
/MN
   1:  UFRAME_NUM=0 ;
   2:  UTOOL_NUM=0 ;
   3:J P[1:home] 50% FINE    ;
   4:L P[2] 200mm/sec FINE    ;
   5:L P[3] 200mm/sec CNT20    ;
   6:J P[4] 20% FINE    ;
   7:J P[1:home] 50% FINE    ;
/POS
{positions}/END
"""


def files() -> dict[str, str]:
    """Every file by its name."""
    robot = load_robot(ROBOT)
    simulation = Simulation(
        seed=SEED,
        configurations=60,
        scales=ErrorScales(kinds=KINDS),
        unregistered=True,
    )
    tracker = simulate(robot, simulation)
    verification = simulate(robot, replace(simulation, configurations=20, same_robot=tracker.truth))
    return {
        "tracker.csv": _table(tracker),
        "verification.csv": _table(verification),
        "before.csv": _table(_cycles(robot, tracker)),
        "after.csv": _table(_driven(robot, tracker), joints=False),
        "targets.csv": _targets(robot),
        "seam.ls": _program(robot),
    }


def _cycles(robot: Robot, tracker: Measurements) -> Measurements:
    """The five poses of ISO 9283 in cycles, P5 to P1, measured before any correction."""
    cube = plan_test(robot, robot.workspace(), Constraints(), robot.targets, CUBE)
    q = np.tile(cube.q[::-1], (CYCLES, 1))
    return simulate(robot, Simulation(seed=SEED + 1, at=q, same_robot=tracker.truth))


def _driven(robot: Robot, tracker: Measurements) -> Measurements:
    """The same cycles measured while the arm was driven to driven.csv."""
    with DRIVEN.open(encoding="utf-8") as stream:
        rows = [[float(row[f"j{j}_deg"]) for j in range(1, 7)] for row in csv.DictReader(stream)]
    q = robot.to_serial(np.deg2rad(rows))
    return simulate(robot, Simulation(seed=SEED + 2, at=q, same_robot=tracker.truth))


def _table(measurements: Measurements, joints: bool = True) -> str:
    """Joints as the controller shows them, targets in the tracker's frame, to the micrometre."""
    header = [f"t{t}_{axis}_mm" for t in (1, 2, 3) for axis in "xyz"]
    points = measurements.points.reshape(len(measurements), -1) * 1e3
    rows = [[f"{v:.3f}" for v in p] for p in points]
    if joints:
        header = [*(f"j{j}_deg" for j in range(1, 7)), *header]
        shown = np.rad2deg(measurements.robot.to_controller(measurements.q))
        rows = [[*(f"{v:.4f}" for v in q), *row] for q, row in zip(shown, rows, strict=True)]
    return "\n".join([",".join(row) for row in [header, *rows]]) + "\n"


def _poses(robot: Robot, shifts: list[tuple[float, float, float]]) -> np.ndarray:
    """The pose at the workspace's home, moved by metres along the axes of the base
    frame: (N, 4, 4).
    """
    T = np.repeat(robot.mechanism.forward(robot.workspace().home[None]), len(shifts), axis=0)
    T[:, :3, 3] += shifts
    return T


def _targets(robot: Robot) -> str:
    """A square of 400 mm, eight poses of one orientation."""
    square = [(-1, -1), (0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0)]
    lines = ["point,x_mm,y_mm,z_mm,roll_deg,pitch_deg,yaw_deg"]
    for k, T in enumerate(_poses(robot, [(0.2 * x, 0.2 * y, 0.0) for x, y in square])):
        angles = Rotation.from_matrix(T[:3, :3]).as_euler("xyz", degrees=True)
        values = [*(T[:3, 3] * 1e3), *angles]
        lines.append(",".join([f"A{k + 1}", *(f"{v + 0.0:.3f}" for v in values)]))
    return "\n".join(lines) + "\n"


def _program(robot: Robot) -> str:
    """Home and an approach as joints, a seam of two poses."""
    home = np.rad2deg(robot.to_controller(robot.workspace().home[None])[0])
    texts = [_joints('1:"home"', home)]
    for k, T in enumerate(_poses(robot, [(0.1, -0.3, -0.2), (0.1, 0.3, -0.2)])):
        x, y, z = T[:3, 3] * 1e3
        w, p, r = Rotation.from_matrix(T[:3, :3]).as_euler("xyz", degrees=True)
        texts.append(
            f"P[{k + 2}]{{\n   GP1:\n\tUF : 0, UT : 0,\t\tCONFIG : 'N U T, 0, 0, 0',\n"
            f"\tX = {x:9.3f}  mm,\tY = {y:9.3f}  mm,\tZ = {z:9.3f}  mm,\n"
            f"\tW = {w:9.3f} deg,\tP = {p:9.3f} deg,\tR = {r:9.3f} deg\n}};\n"
        )
    texts.append(_joints("4", home + np.array([15.0, -5.0, 5.0, 10.0, 10.0, -20.0])))
    return PROGRAM.format(positions="".join(texts))


def _joints(name: str, q: np.ndarray) -> str:
    j = [f"J{k + 1}= {value:9.3f} deg" for k, value in enumerate(q)]
    first, second = ",\t".join(j[:3]), ",\t".join(j[3:])
    return f"P[{name}]{{\n   GP1:\n\tUF : 0, UT : 0,\t\n\t{first},\n\t{second}\n}};\n"


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    for name, text in files().items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
