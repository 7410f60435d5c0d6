"""A description with closed loops → its chain: joints, cut frames and a closed configuration."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from calibtool.robot.assembly import closed_configuration, closed_samples, first_closed
from calibtool.robot.chain import LimitSource, SerialChain, build_chain, opened
from calibtool.robot.closed import ClosedMechanism
from calibtool.robot.continuation import Starts
from calibtool.robot.loops import Tree
from calibtool.robot.mechanism import Bodies
from calibtool.robot.reduction import mobility, reduced
from calibtool.robot.se3 import Array, readonly
from calibtool.robot.source import Source
from calibtool.robot.tree_reading import read_tree
from calibtool.robot.urdf import frame_id, joint_name, mimic_joints


@dataclass(frozen=True, eq=False)
class ClosedChain:
    """Joints with closed loops: n actuated ones first, in the order of `kinematics.actuated`, then
    passive, then idle ones.

    bodies       names, inertias and gravity, of all J joints
    placements   (J + 2L + 1, 4, 4): M_i of every joint on its parent, the cut frames A and B of
                 every loop, tool
    twists       (J, 6) unit twists of the joints in their own frames
    lower, upper (n,) limits of the actuated joints, rad or m
    limited_by   (n,) source of the limits
    tree         how the joints are connected
    mobility     independent motions of all joints together
    """

    bodies: Bodies
    placements: Array
    twists: Array
    lower: Array
    upper: Array
    limited_by: tuple[LimitSource, ...]
    tree: Tree
    mobility: int

    @property
    def n(self) -> int:
        """Number of actuated joints."""
        return self.tree.n

    @property
    def n_all(self) -> int:
        """Number of joints, passive ones included."""
        return self.tree.joints

    @cached_property
    def mechanism(self) -> ClosedMechanism:
        """The nominal kinematics."""
        return self.mechanism_of(self.placements, self.twists)

    @property
    def model(self) -> pin.Model:
        """The nominal tree as a Pinocchio model, its loops open."""
        return self.mechanism.model

    @cached_property
    def starts(self) -> Starts:
        """Closed configurations of the nominal mechanism, computed at first use."""
        return Starts.of(self.mechanism.equations, self.tree)

    def mechanism_of(
        self, placements: Array, twists: Array, offsets: Array | None = None
    ) -> ClosedMechanism:
        """The kinematics with other placements, twists (J, 6) and offsets (n,)."""
        return ClosedMechanism.closing(
            self.bodies, placements, twists, offsets, self.tree, lambda: self.starts
        )

    @property
    def model_joints(self) -> dict[int, int]:
        """The number of each joint, and of the base (−1), in `model`."""
        joints = {j: int(k) + 1 for j, k in enumerate(self.mechanism.model_joints)}
        return {-1: 0} | joints

    @cached_property
    def placed_on(self) -> tuple[int, ...]:
        """The joint that carries each placement, −1 for the base."""
        return self.tree.placed_on

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """A name for each placement: joints, `loop.a` and `loop.b` of cut frames, the tool."""
        cuts = [f"{loop.name}.{side}" for loop in self.tree.loops for side in "ab"]
        return (*self.bodies.joints, *cuts, self.bodies.tool)


def chain_of(source: Source) -> SerialChain | ClosedChain:
    """The chain of a description: a closed one where it has loops, or mimic joints between base and
    tool. A bare URDF with such joints is refused: it does not say whether a motor follows.
    """
    description, kinematics = source.description, source.description.kinematics
    stated = description.assumed is None or kinematics.actuated is not None
    if kinematics.loops or (stated and _mimics_before_tool(source)):
        return build_closed_chain(source)
    return build_chain(source)


def _mimics_before_tool(source: Source) -> bool:
    mimics = mimic_joints(source.urdf_text, source.place)
    if not mimics:
        return False
    model = opened(source)
    tool = model.frames[frame_id(model, source.description.kinematics.tool_frame, source.place)]
    joint = tool.parentJoint
    while joint > 0:
        if joint_name(model, joint) in mimics:
            return True
        joint = model.parents[joint]
    return False


def build_closed_chain(source: Source) -> ClosedChain:
    """The chain of a description with `loops`, or with mimic joints before the tool.

    Raises InputError, with the loop's name, for frames on one link, loops that do not close at
    `closed_at`, or leave the actuators no freedom; for joints outside of everything, unknown names,
    and motions that no actuator commands.
    """
    place = source.place
    read = read_tree(source)
    tree, names = read.tree, read.bodies.joints
    mechanism = ClosedMechanism.closing(
        read.bodies, read.placements, read.twists, None, tree, _no_starts
    )
    theta = closed_configuration(mechanism, tree, names, place)
    samples = closed_samples(mechanism, tree, theta)
    kept = reduced(tree, samples, names, place)
    passive = [j for j in range(tree.n, tree.joints) if j not in kept.idle]
    order = [*range(tree.n), *passive, *kept.idle]
    number = {j: k for k, j in enumerate(order)} | {-1: -1}
    cuts = slice(tree.joints, None)
    tree = replace(
        tree,
        parents=tuple(number[tree.parents[j]] for j in order),
        carriers=tuple(number[j] for j in tree.carriers),
        tool=number[tree.tool],
        p=len(passive),
        loops=kept.loops,
        followers=tuple(
            replace(f, joint=number[f.joint], leader=number[f.leader]) for f in tree.followers
        ),
        closed_at=readonly(theta[order]),
        lower=readonly(tree.lower[order]),
        upper=readonly(tree.upper[order]),
        slides=tree.slides[order],
    )
    bodies = replace(
        read.bodies,
        joints=tuple(names[j] for j in order),
        inertias=tuple(read.bodies.inertias[j] for j in order),
    )
    return ClosedChain(
        bodies=bodies,
        placements=readonly(np.concatenate([read.placements[order], read.placements[cuts]])),
        twists=readonly(read.twists[order]),
        lower=readonly(tree.lower[: tree.n]),
        upper=readonly(tree.upper[: tree.n]),
        limited_by=read.limited_by[: tree.n],
        tree=tree,
        mobility=mobility(samples, tree.joints) - len(kept.idle),
    )


def configuration_found(source: Source) -> dict[str, float]:
    """Where a description without `closed_at` closes, rad or m by joint, see `first_closed`.

    Nothing where it does so at 0, and where no such configuration is found.
    """
    read = read_tree(source)
    tree = read.tree
    mechanism = ClosedMechanism.closing(
        read.bodies, read.placements, read.twists, None, tree, _no_starts
    )
    theta = first_closed(mechanism, tree)
    if theta is None or not np.abs(theta - tree.closed_at).max() > 1e-9:
        return {}
    return dict(zip(read.bodies.joints, (round(float(v), 9) + 0.0 for v in theta), strict=True))


def _no_starts() -> Starts:
    raise RuntimeError("the loops are not reduced yet")
