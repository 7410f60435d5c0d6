"""A description with closed loops → its tree of joints, cut frames and closed configuration,
checked and reduced.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from calibtool.errors import InputError, near_names
from calibtool.robot.chain import (
    LimitSource,
    SerialChain,
    build_chain,
    gravity_in_base,
    limits_of,
    opened,
    unit_twist,
)
from calibtool.robot.closed import ClosedMechanism
from calibtool.robot.closure import Closure
from calibtool.robot.continuation import Starts
from calibtool.robot.description import LoopTable, Source
from calibtool.robot.loops import FORBIDDEN, Follower, Loop, Tree
from calibtool.robot.mechanism import Bodies
from calibtool.robot.reduction import Sample, check_freedom, mobility, reduced
from calibtool.robot.se3 import Array, readonly
from calibtool.robot.tree import urdf_tree
from calibtool.robot.urdf import base_placement, frame_id, joint_name, mimic_joints

_SAMPLES = 6
_APART = 0.05  # rad, or lengths: how far samples are from the closed configuration
_OPEN = (
    0.05  # rad, or lengths: a closed_at that is farther from a closed configuration is a mistake
)
_STEPS = 60


@dataclass(frozen=True, eq=False)
class ClosedChain:
    """Joints with closed loops: n actuated ones first, in the order of `kinematics.actuated`, then
    passive, then idle ones.

    bodies       names, inertias and gravity, of all J joints
    placements   (J + 2L + 1, 4, 4): M_i of every joint on the one that carries it, the cut frames A
                 and B of every loop, tool
    twists       (J, 6) unit twists of the joints in their own frames
    lower, upper (n,) limits of the actuated joints, rad or m
    limited_by   (n,) where they come from
    tree         how they hang together
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
        """Closed configurations of the nominal mechanism, made when first asked for (a second or
        so).
        """
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
        """A name for each placement: those of joints, `loop.a` and `loop.b` of cut frames, that of
        the tool.
        """
        cuts = [f"{loop.name}.{side}" for loop in self.tree.loops for side in "ab"]
        return (*self.bodies.joints, *cuts, self.bodies.tool)


@dataclass(frozen=True, eq=False)
class _Read:
    """What a description says, joints in the order actuated, then the others as in the URDF; loops
    with all rows.
    """

    bodies: Bodies
    placements: Array
    twists: Array
    tree: Tree
    limited_by: tuple[LimitSource, ...]


def chain_of(source: Source) -> SerialChain | ClosedChain:
    """The chain of a description: a closed one where it has loops, or mimic joints between base and
    tool. A bare URDF with such joints is refused: it does not say whether a motor follows.
    """
    description = source.description
    follows = description.assumed is None and _mimics_before_tool(source)
    if description.kinematics.loops or follows:
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
    read = _read(source)
    tree, names = read.tree, read.bodies.joints
    mechanism = ClosedMechanism.closing(
        read.bodies, read.placements, read.twists, None, tree, _no_starts
    )
    theta = _closed_at(mechanism, tree, names, place)
    samples = _samples(mechanism, tree, theta)
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


def _no_starts() -> Starts:
    raise RuntimeError("the loops are not reduced yet")


def _read(source: Source) -> _Read:
    place, kinematics = source.place, source.description.kinematics
    model = opened(source)
    names = [joint_name(model, j) for j in range(model.njoints)]
    tool = model.frames[frame_id(model, kinematics.tool_frame, place)]
    base = base_placement(model, kinematics.base_frame, place)
    pairs = [_cut_frames(model, k, loop, place) for k, loop in enumerate(kinematics.loops)]
    ends = [tool, *(frame for pair in pairs for frame in pair)]
    mimics = mimic_joints(source.urdf_text, place)
    used: set[int] = set()
    waiting = [frame.parentJoint for frame in ends]
    while waiting:
        joint = waiting.pop()
        if joint == 0 or joint in used:
            continue
        used.add(joint)
        waiting.append(model.parents[joint])
        if names[joint] in mimics:
            waiting.append(_leader(names, names[joint], mimics[names[joint]][0], place))
    if beside := [names[j] for j in range(1, model.njoints) if j not in used]:
        raise InputError(
            f"{place}: joints {', '.join(beside)} move neither the tool nor a frame of a loop; "
            "lock them in [kinematics]"
        )
    order, n = _actuated_first(source, names, sorted(used), set(mimics))
    number = {j: k for k, j in enumerate(order)} | {0: -1}
    followers = tuple(
        Follower(number[j], number[names.index(mimics[names[j]][0], 1)], *mimics[names[j]][1:])
        for j in order
        if names[j] in mimics
    )
    twists = np.array([unit_twist(model.joints[j], names[j], place) for j in order])
    slides = np.linalg.norm(twists[:, 3:], axis=1) < 0.5
    described = urdf_tree(source.urdf_text, place).named
    limits = [
        limits_of(described[names[j]], prismatic=bool(slide))
        for j, slide in zip(order, slides, strict=True)
    ]
    lower, upper = (np.array([limit[k] for limit in limits], dtype=float) for k in (0, 1))
    free = np.array([limit[2] != "urdf" for limit in limits]) & (np.arange(len(order)) >= n)
    lower[free], upper[free] = -np.inf, np.inf
    carriers = tuple(number[frame.parentJoint] for frame in ends[1:])
    placements = [_on(model.jointPlacements[j], model.parents[j], base) for j in order]
    placements += [_on(frame.placement, frame.parentJoint, base) for frame in (*ends[1:], tool)]
    placements_array = readonly(placements)
    loops = tuple(
        Loop(loop.name or f"loop{k + 1}", loop.joint, FORBIDDEN[loop.joint])
        for k, loop in enumerate(kinematics.loops)
    )
    if len({loop.name for loop in loops}) < len(loops):
        raise InputError(f"{place}: kinematics.loops: two loops have the same name")
    tree = Tree(
        parents=tuple(number[model.parents[j]] for j in order),
        carriers=carriers,
        tool=number[tool.parentJoint],
        n=n,
        p=len(order) - n,
        loops=loops,
        followers=followers,
        closed_at=_given_closed(source, [names[j] for j in order], (lower, upper), slides, n),
        lower=lower,
        upper=upper,
        slides=slides,
        length=_length(source, placements_array),
    )
    bodies = Bodies(
        robot=source.description.name,
        joints=tuple(names[j] for j in order),
        tool=kinematics.tool_frame,
        inertias=tuple(model.inertias[j].copy() for j in order),
        gravity=gravity_in_base(source, base, model),
    )
    sources = tuple(limit[2] for limit in limits)
    return _Read(bodies, placements_array, readonly(twists), tree, sources)


def _on(placement: pin.SE3, carrier: int, base: pin.SE3) -> Array:
    """A placement on a joint, or on the base in K_0."""
    pose: Array = (base.actInv(placement) if carrier == 0 else placement).homogeneous
    return pose


def _cut_frames(
    model: pin.Model, k: int, loop: LoopTable, place: str
) -> tuple[pin.Frame, pin.Frame]:
    """The frames of a loop, which must be on two different moving parts."""
    name = loop.name or f"loop{k + 1}"
    a, b = (model.frames[frame_id(model, f, f"{place}: loop '{name}'")] for f in loop.frames)
    if a.parentJoint == b.parentJoint:
        raise InputError(
            f"{place}: loop '{name}': frames '{loop.frames[0]}' and '{loop.frames[1]}' are on the "
            "same link: nothing moves "
            "between them; name a frame of each of the two links that the joint joins"
        )
    return a, b


def _leader(names: list[str], joint: str, leader: str, place: str) -> int:
    if leader not in names[1:]:
        raise InputError(
            f"{place}: joint '{joint}' mimics '{leader}', which is locked or not in the URDF; lock "
            f"'{joint}' too"
        )
    return names.index(leader, 1)


def _actuated_first(
    source: Source, names: list[str], used: list[int], mimics: set[str]
) -> tuple[list[int], int]:
    """Joint ids: the actuated ones as the description names them, then the others; and the number
    of the former.
    """
    place, given = source.place, source.description.kinematics.actuated
    if given is None:
        if source.description.kinematics.loops:
            raise InputError(
                f"{place}: kinematics.actuated is missing: name the joints that have a motor, in "
                "their order"
            )
        n = sum(names[j] not in mimics for j in used)
        return sorted(used, key=lambda j: (names[j] in mimics, j)), n
    for k, joint in enumerate(given):
        inside = [names[j] for j in used]
        if joint not in inside:
            raise InputError(
                f"{place}: kinematics.actuated: '{joint}' is no movable joint of the URDF; "
                f"{near_names(joint, inside)}"
            )
        if joint in given[:k]:
            raise InputError(f"{place}: kinematics.actuated names '{joint}' twice")
        if joint in mimics:
            raise InputError(
                f"{place}: kinematics.actuated: '{joint}' mimics another joint; leave it out"
            )
    first = [names.index(joint, 1) for joint in given]
    return first + [j for j in used if j not in first], len(first)


def _given_closed(
    source: Source, names: list[str], limits: tuple[Array, Array], slides: np.ndarray, n: int
) -> Array:
    """`closed_at` (J,), rad or m: 0 where nothing is said, or the limit nearest to it for an
    actuated joint.
    """
    place, given = source.place, source.description.kinematics.closed_at
    for joint in given:
        if joint not in names:
            raise InputError(
                f"{place}: kinematics.closed_at: '{joint}' is no movable joint; "
                f"{near_names(joint, names)}"
            )
    theta = np.array([given.get(joint, 0.0) for joint in names])
    for j in range(n):
        low, high = limits[0][j], limits[1][j]
        if names[j] not in given:
            theta[j] = np.clip(0.0, *(np.nan_to_num([low, high])))
        elif not low - 1e-9 <= theta[j] <= high + 1e-9:
            unit = "m" if slides[j] else "rad"
            raise InputError(
                f"{place}: kinematics.closed_at: '{names[j]}' = {theta[j]:g} {unit} is outside its "
                "limits "
                f"{low:g} to {high:g}"
            )
    return theta


def _length(source: Source, placements: Array) -> float:
    """Characteristic length: as given, or half of the sum of distances between neighbouring joint
    frames.
    """
    given = source.description.kinematics.length
    if given is not None:
        return given
    return max(float(np.linalg.norm(placements[1:, :3, 3], axis=-1).sum()) / 2, 1e-3)


def _closed_at(mechanism: ClosedMechanism, tree: Tree, names: tuple[str, ...], place: str) -> Array:
    """The closed configuration next to the given one, actuated joints as given; InputError if it is
    not next to it.
    """
    start = tree.closed_at.copy()
    for follower in tree.followers:
        start[follower.joint] = follower.factor * start[follower.leader] + follower.offset
    free = np.arange(tree.joints) >= tree.n
    theta, left = _nearest_closed(mechanism, tree, start, free)
    scale = tree.joint_scale
    if not left < 1e-10:
        anywhere, still = _nearest_closed(mechanism, tree, start, np.ones(tree.joints, dtype=bool))
        if still < 1e-10:
            check_freedom(tree, _samples(mechanism, tree, anywhere), names, place)
        raise InputError(
            f"{place}: {_worst_loop(mechanism, tree, start)} at kinematics.closed_at, and does not "
            "come together while the "
            "actuators stay there; correct link lengths and frames, or give positions at which the "
            "mechanism is closed"
        )
    moved = np.abs((theta - start) / scale)
    if moved.max(initial=0.0) > _OPEN:
        values = ", ".join(
            f"{names[j]} = {theta[j]:.6g}" for j in np.flatnonzero(free & (moved > 1e-6))[:8]
        )
        raise InputError(
            f"{place}: {_worst_loop(mechanism, tree, start)} at kinematics.closed_at, which "
            "chooses the assembly mode; a "
            f"closed configuration from there is {values}: write it there if that is the one"
        )
    return theta


def _nearest_closed(
    mechanism: ClosedMechanism, tree: Tree, theta: Array, free: np.ndarray
) -> tuple[Array, float]:
    """Least-squares steps of the free joints (J,) to r = 0 from θ (J,), and the largest |r| left,
    in rad.
    """
    theta = theta.copy()
    scale = np.where(free, tree.joint_scale, 0.0)
    left = np.inf
    for _ in range(_STEPS):
        at = _equations(mechanism, theta)
        r = at.residual[0] * tree.row_scale
        left = float(np.abs(r).max(initial=0.0))
        if left < 1e-14:
            break
        step = -np.linalg.lstsq(at.columns[0] * tree.row_scale[:, None] * scale, r, rcond=1e-9)[0]
        size = float(np.abs(step).max(initial=0.0))
        theta += step * scale * min(1.0, 0.2 / max(size, 1e-300))
        if size < 1e-13:
            break
    return theta, left


def _equations(mechanism: ClosedMechanism, theta: Array) -> Closure:
    """Equations of one row, θ (J,)."""
    row = np.zeros(1, dtype=int)
    return mechanism.equations(theta[None], row)(row, theta[None, mechanism.tree.passive])[2]


def _worst_loop(mechanism: ClosedMechanism, tree: Tree, theta: Array) -> str:
    """The loop that is farthest from closed at θ (J,), and by how much, in words."""
    at = _equations(mechanism, theta)
    r = at.residual[0]
    sizes = [float(np.abs((r * tree.row_scale)[rows]).max()) for rows in tree.row_blocks]
    if not sizes:
        return "a mimic joint is not where it should be"
    k = int(np.argmax(sizes))
    rows, kept = r[tree.row_blocks[k]], np.array(tree.loops[k].rows)
    apart = np.linalg.norm(rows[kept < 3]) * 1e3
    turned = np.rad2deg(np.linalg.norm(rows[kept >= 3]))
    text = f"loop '{tree.loops[k].name}' does not close: its frames are {apart:.3g} mm apart"
    return text + (f" and {turned:.3g} deg turned" if turned > 1e-3 else "")


def _samples(mechanism: ClosedMechanism, tree: Tree, theta: Array) -> list[Sample]:
    """Derivatives at closed configurations near θ (J,), which are found by moving along what C
    leaves free.
    """
    rng, row = np.random.default_rng(0), np.zeros(1, dtype=int)
    everything, scale = np.ones(tree.joints, dtype=bool), tree.joint_scale
    samples = []
    for k in range(_SAMPLES):
        at = theta
        if k:
            C = _equations(mechanism, theta).columns[0] * tree.row_scale[:, None] * scale
            sizes, vt = np.linalg.svd(C)[1:]
            rank = int((sizes > 1e-7 * sizes.max(initial=1e-300)).sum())
            null = vt[rank:]
            move = rng.uniform(-1.0, 1.0, len(null)) @ null
            move *= _APART / max(float(np.abs(move).max(initial=0.0)), 1e-300)
            at, left = _nearest_closed(mechanism, tree, theta + move * scale, everything)
            if not left < 1e-9:
                continue
        passive = at[None, tree.passive]
        ends, jacobian, equations = mechanism.equations(at[None], row)(row, passive)
        at_tool = (jacobian[0] * tree.tool_support[:, None] * scale[:, None]).T
        at_tool[:3] -= np.cross(ends[0, -1, 3], at_tool[3:].T).T
        at_tool[:3] /= tree.length
        samples.append(Sample(equations.columns[0] * tree.row_scale[:, None] * scale, at_tool))
    return samples
