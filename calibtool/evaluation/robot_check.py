"""Check of a description: joints, reach, singularities, and what its targets can determine."""

from dataclasses import dataclass

import numpy as np

from calibtool.equivalent.joints import equivalent_robot
from calibtool.errors import InputError, NoSolutionError
from calibtool.identification.design_rank import Observability, observability
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.setup import Setup, determines_orientation
from calibtool.robot.catalogue import robot_names
from calibtool.robot.chain import NO_LIMITS
from calibtool.robot.closed_chain import ClosedChain
from calibtool.robot.plausibility import implausible
from calibtool.robot.robot import Robot, is_path
from calibtool.robot.se3 import Array, readonly
from calibtool.robot.singularity import (
    MIN_SINGULARITY_DISTANCE,
    at_point,
    singularity_distance,
)
from calibtool.units import rounded

_REACH_SAMPLES = 5000
_DESIGN_SAMPLES = 100


@dataclass(frozen=True)
class WorkspaceCheck:
    """A workspace: tool position at home (m, K_0), singularity distance of home and 200 poses."""

    name: str
    home: Array
    home_position: Array
    singularity_distance: float
    smallest_distance: float


@dataclass(frozen=True)
class RobotCheck:
    """Result of checking a description.

    limit_sources   per joint: `robot.toml`, `urdf`, `continuous` (±180°) or `assumed`
                    (none given, ±180°)
    reach           largest distance of the tool origin from K_0 and from joint 1 over random
                    configurations, m
    extent          (2, 3) smallest and largest tool position over them, K_0, m
    designs         the models' ranks over the whole joint range and in the default workspace:
                    (where, observability)
    loops           of a robot with closed loops: the loops, mobility, joints; else None
    """

    robot: Robot
    limit_sources: list[str]
    reach: tuple[float, float]
    extent: Array
    workspaces: list[WorkspaceCheck]
    virtual_joints: tuple[str, ...]
    virtual_reason: str
    designs: list[tuple[str, Observability]]
    warnings: list[str]
    loops: dict[str, object] | None = None

    def as_json(self) -> dict[str, object]:
        """The object that `robots --check --json` prints; units in the keys."""
        robot = self.robot
        joints = []
        for j, prismatic in enumerate(robot.prismatic):
            factor, unit = robot.display_unit(j)
            twist = robot.chain.twists[j]
            joints.append(
                {
                    "joint": f"j{j + 1}",
                    "name": robot.chain.bodies.joints[j],
                    "kind": "prismatic" if prismatic else "revolute",
                    "axis": rounded(twist[:3] if prismatic else twist[3:], 9),
                    f"lower_{unit}": round(float(robot.lower[j]) * factor, 6),
                    f"upper_{unit}": round(float(robot.upper[j]) * factor, 6),
                    "limits_from": self.limit_sources[j],
                }
            )
        return {
            "schema": "calibtool/robot-check",
            "schema_version": 1,
            "name": robot.name,
            "place": robot.source.place,
            "joints": "".join("P" if p else "R" for p in robot.prismatic),
            "joint_table": joints,
            "coupled_joints": robot.coupled,
            "tool_frame": robot.source.description.kinematics.tool_frame,
            "reach_mm": {
                "from_base": round(self.reach[0] * 1e3, 1),
                "from_joint_1": round(self.reach[1] * 1e3, 1),
            },
            "tool_range_mm": [rounded(corner * 1e3, 1) for corner in self.extent],
            "targets_mm": [rounded(point * 1e3, 6) for point in robot.targets],
            "workspaces": [
                {
                    "name": each.name,
                    "home_tool_position_mm": rounded(each.home_position * 1e3, 3),
                    "home_singular": each.singularity_distance < MIN_SINGULARITY_DISTANCE,
                    "home_singularity_distance": float(f"{each.singularity_distance:.3g}"),
                    "smallest_singularity_distance": float(f"{each.smallest_distance:.3g}"),
                }
                for each in self.workspaces
            ],
            "virtual_joints": list(self.virtual_joints),
            "virtual_joints_because": self.virtual_reason,
            "identifiable": [
                {
                    "model": design.model,
                    "workspace": where,
                    "parameters": design.parameters,
                    "rank": design.rank,
                    "possible": design.possible,
                    "unobservable": list(design.unobservable),
                }
                for where, design in self.designs
            ],
            **({} if self.loops is None else {"closed_loops": self.loops}),
            "warnings": list(self.warnings),
        }


def check_robot(robot: Robot, given_as: str) -> RobotCheck:
    """Check a description that could be built. given_as is the name or path that the user gave.

    Raises InputError, with place and remedy, for a home outside the limits, a workspace that cannot
    be reached, or joints that are singular everywhere.
    """
    rng = np.random.default_rng(0)
    place = robot.source.place
    anywhere = robot.closing(robot.anywhere(_REACH_SAMPLES, rng))
    if not len(anywhere):
        raise InputError(
            f"{place}: no configuration of the joint range closes, but for closed_at; check link "
            "lengths, loops and limits"
        )
    tools = robot.mechanism.forward(anywhere)[:, :3, 3]
    first = robot.chain.placements[0, :3, 3]
    if robot.singularity_distance(anywhere).max() < MIN_SINGULARITY_DISTANCE:
        probably = "".join(f": {finding}" for finding in implausible(robot)[:1])
        raise InputError(
            f"{place}: every configuration is singular, two joints move the tool alike or hardly "
            "at all; lock one of them in [kinematics], or check axes and link lengths" + probably
        )
    workspaces = [_workspace(robot, name, place) for name in robot.workspace_names[:-1]]
    equivalent = equivalent_robot(robot)
    pose, jacobian = equivalent.forward_and_jacobian(robot.mechanism, anywhere)
    apart = singularity_distance(at_point(jacobian, pose[:, :3, 3]), robot.length)
    if apart.max() < MIN_SINGULARITY_DISTANCE:
        raise InputError(
            f"{place}: equivalent.virtual_joints: {', '.join(equivalent.virtual_joints)} and the "
            "joints move the tool alike; name what the joints cannot do, or leave it out"
        )
    design = anywhere[:_DESIGN_SAMPLES]
    setup = Setup(readonly(np.eye(4)), robot.targets)
    default = robot.workspace_names[0]
    inside = sample_configurations(robot, robot.workspace(), _DESIGN_SAMPLES, rng)
    models = ("local-poe", "complete")
    designs = [("full", observability(robot, setup, design, design, model)) for model in models]
    if default != "full":
        designs += [
            (default, observability(robot, setup, inside, design, model)) for model in models
        ]
    sources = _limit_sources(robot)
    return RobotCheck(
        robot=robot,
        limit_sources=sources,
        reach=(
            float(np.linalg.norm(tools, axis=-1).max()),
            float(np.linalg.norm(tools - first, axis=-1).max()),
        ),
        extent=readonly([tools.min(axis=0), tools.max(axis=0)]),
        workspaces=workspaces,
        virtual_joints=equivalent.virtual_joints,
        virtual_reason=_virtual_reason(robot),
        designs=designs,
        warnings=_warnings(robot, given_as, workspaces, designs),
        loops=_loops(robot, len(anywhere) / _REACH_SAMPLES),
    )


def _loops(robot: Robot, closes: float) -> dict[str, object] | None:
    """The loops, passive and idle joints; closes: part of the joint range in which they close."""
    tree = robot.chain.tree
    if tree is None or not isinstance(robot.chain, ClosedChain):
        return None
    joints, described = robot.chain.bodies.joints, robot.source.description.kinematics.loops
    return {
        "loops": [
            {
                "name": loop.name,
                "frames": list(table.frames),
                "joint": loop.joint,
                "equations": len(loop.rows),
            }
            for loop, table in zip(tree.loops, described, strict=True)
        ],
        "mimic_joints": [joints[follower.joint] for follower in tree.followers],
        "mobility": robot.chain.mobility,
        "actuated_joints": list(joints[: tree.n]),
        "passive_joints": list(joints[tree.passive]),
        "idle_joints": list(joints[tree.n + tree.p :]),
        "joint_range_that_closes_percent": round(100.0 * closes, 1),
    }


def _workspace(robot: Robot, name: str, place: str) -> WorkspaceCheck:
    workspace = robot.workspace(name)
    home = workspace.home
    within = robot.joints_within_limits(home)
    if not within.all():
        j = int(np.argmin(within))
        factor, _ = robot.display_unit(j)
        low, value, high = (f"{v * factor:.6g}" for v in (robot.lower[j], home[j], robot.upper[j]))
        raise InputError(
            f"{place}: workspaces.{name}.home: {robot.columns(None)[j]} = {value} is outside its "
            f"limits {low} to {high}; move it, or correct [limits]"
        )
    try:
        q = sample_configurations(robot, workspace, 200, np.random.default_rng(0))
    except NoSolutionError as error:
        raise InputError(f"{place}: workspaces.{name}: {error}") from None
    return WorkspaceCheck(
        name=name,
        home=readonly(home),
        home_position=readonly(robot.mechanism.forward(home[None])[0, :3, 3]),
        singularity_distance=float(robot.singularity_distance(home[None])[0]),
        smallest_distance=float(robot.singularity_distance(q).min()),
    )


def _limit_sources(robot: Robot) -> list[str]:
    written = {name.split("_")[0] for name in robot.source.description.limits}
    return [
        "robot.toml" if f"j{j + 1}" in written else "assumed" if source in NO_LIMITS else source
        for j, source in enumerate(robot.chain.limited_by)
    ]


def _virtual_reason(robot: Robot) -> str:
    if robot.n >= 6:
        return f"none: {robot.n} joints" + (
            ", joint motion errors of minimum norm" if robot.n > 6 else ""
        )
    if robot.source.description.equivalent is not None:
        return "named in [equivalent]"
    return (
        f"{robot.n} joints need {6 - robot.n}; of all choices these keep the equivalent robot "
        f"farthest from a singularity in the workspace {robot.workspace_names[0]}"
    )


def _warnings(
    robot: Robot,
    given_as: str,
    workspaces: list[WorkspaceCheck],
    designs: list[tuple[str, Observability]],
) -> list[str]:
    assumed = robot.source.description.assumed
    found = [*([assumed] if assumed else []), *implausible(robot)]
    count = len(robot.targets)
    if not determines_orientation(robot.targets):
        what = "lie on one line" if count >= 3 else f"are {count}" if count > 1 else "are one point"
        found.append(
            f"the targets {what}: the tool's orientation is not seen; give three that "
            "span a triangle"
        )
    if not any(inertia.mass > 0 for inertia in robot.chain.model.inertias):
        found.append(
            "the URDF has no masses: gravity is that of uniform links of 1 kg/m, of which only "
            "the shape counts"
        )
    if is_path(given_as) and robot.name in robot_names():
        found.append(
            f"'{robot.name}' is also a robot of the catalogue; files tell them apart by their "
            "texts, people do not"
        )
    if not workspaces:
        found.append(
            "no [workspaces]: everything is drawn from the whole joint range; describe "
            "where you work"
        )
    found += [
        f"the home of workspace {each.name} is singular (distance {each.singularity_distance:.2g}, "
        f"at least {MIN_SINGULARITY_DISTANCE} is needed); bend the arm there"
        for each in workspaces
        if each.singularity_distance < MIN_SINGULARITY_DISTANCE
    ]
    for where, design in designs:
        if design.unobservable:
            found.append(
                f"{design.model}, {where}: {design.possible - design.rank} of {design.possible} "
                f"directions are not seen, such as {design.unobservable[0]}"
            )
    return found
