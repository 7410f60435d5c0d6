"""Poses of an acceptance test after ISO 9283: five on a diagonal plane of a cube,
visited in cycles.
"""

from dataclasses import dataclass

import numpy as np

from calibtool.errors import NoSolutionError
from calibtool.planning.constraints import Constraints
from calibtool.planning.joint_table import as_written, in_columns, joint_table
from calibtool.robot.coupling import JointValues
from calibtool.robot.inverse import inverse_kinematics
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly
from calibtool.robot.workspace import Workspace

POSES = ("P1", "P2", "P3", "P4", "P5")
_VISITED = (4, 3, 2, 1, 0)  # a cycle runs P5 → P1, and so reaches every pose from the same side
# Corners of the plane C1 C2 C7 C8 in half edges: its lower edge is near in x, its upper one far.
_CORNERS = np.array([[0, 0, 0], [-1, -1, -1], [-1, 1, -1], [1, 1, 1], [1, -1, 1]], dtype=float)
_INWARD = 0.8  # P2 … P5 stand a tenth of the diagonal inside the corners
_SMALLEST = 0.01  # m
_HALVINGS = 12


@dataclass(frozen=True, eq=False)
class TestCube:
    """A cube with edges along K_0 and the five poses on its inclined plane.

    edge  m
    pose  (5, 4, 4) T_base_tool of P1 … P5, the orientation that of the centre
    q     (5, n) joint positions of P1 … P5 on the branch of the workspace's home, rad or m
    joint_values  whose joint values `table` and `as_json` hold (q is always the serial chain's)
    """

    __test__ = False  # for pytest: no test class

    robot: Robot
    edge: float
    pose: Array
    q: Array
    joint_values: JointValues = "serial"

    def table(self, cycles: int) -> str:
        """CSV of the joints for a number of cycles, with columns `pose` (P1 … P5) and
        `cycle` (from 1).
        """
        order = np.tile(_VISITED, cycles)
        extra = {
            "pose": [POSES[k] for k in order],
            "cycle": [str(1 + k // len(POSES)) for k in range(len(order))],
        }
        return joint_table(self.robot, self.q[order], extra, self.joint_values)

    def as_json(self, cycles: int) -> dict[str, object]:
        """The object `iso9283` of `plan --json`: joints and position of every pose."""
        values = in_columns(self.robot, self.q, self.joint_values).tolist()
        joints = [
            dict(zip(self.robot.columns(self.joint_values), row, strict=True)) for row in values
        ]
        places = [
            {"pose": name, **dict(zip(("x_mm", "y_mm", "z_mm"), point, strict=True)), **row}
            for name, point, row in zip(
                POSES, (self.pose[:, :3, 3] * 1e3).tolist(), joints, strict=True
            )
        ]
        return {"cube_mm": self.edge * 1e3, "cycles": cycles, "poses": places}


def five_poses(T_base_centre: Array, edge: float) -> Array:
    """P1 … P5 (5, 4, 4) of a cube of an edge in m round the position of a pose (4, 4), with
    its orientation.
    """
    pose = np.tile(T_base_centre, (5, 1, 1))
    pose[:, :3, 3] += _INWARD * edge / 2 * _CORNERS
    return pose


def plan_test(
    robot: Robot,
    workspace: Workspace | str | None,
    constraints: Constraints,
    targets: Array,
    edge: float | None = None,
) -> TestCube:
    """The cube of an edge in m, or the largest one, around the home of a workspace (of the default
    one for the joint range).

    The largest has at most the shortest edge of the workspace's box, and poses that satisfy the
    constraints; targets (m, 3) in the tool frame, m. Raises NoSolutionError with a pose that cannot
    be reached.
    """
    workspace = robot.workspace(workspace)
    home = (workspace if workspace.bounded else robot.workspace()).home
    centre = robot.mechanism.forward(home[None])[0]

    def tried(size: float) -> tuple[TestCube, str | None]:
        pose = five_poses(centre, size)
        first = inverse_kinematics(robot, pose[:1], home, starts=0)
        solved = inverse_kinematics(robot, pose, first.q[0], starts=0)
        q = readonly(as_written(robot, solved.q))
        cube = TestCube(robot, size, pose, q)
        for option, good in [("the reach", solved.reached), *constraints.checks(robot, targets, q)]:
            if not good.all():
                return (
                    cube,
                    f"{POSES[int(np.argmin(good))]} of a {size * 1e3:.4g} mm cube fails {option}",
                )
        return cube, None

    if edge is not None:
        cube, failure = tried(edge)
        if failure:
            raise NoSolutionError(
                f"{robot.name}: {failure}; give a smaller --cube-mm or another --workspace"
            )
        return cube
    largest = float(workspace.box.min()) if workspace.bounded else 2.0 * robot.length
    best, failure = tried(max(largest, _SMALLEST))
    if failure is None:
        return best
    low, high = _SMALLEST, largest
    best, failure = tried(low)
    if failure:
        raise NoSolutionError(
            f"{robot.name}: {failure}; choose another --workspace, or loosen the constraint"
        )
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        cube, failure = tried(middle)
        best, low, high = (cube, middle, high) if failure is None else (best, low, middle)
    return best
