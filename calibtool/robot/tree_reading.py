"""A description with closed loops → a tree of joints and cut frames, as it is written."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from calibtool.errors import InputError, near_names
from calibtool.robot.chain import LimitSource, gravity_in_base, limits_of, opened, unit_twist
from calibtool.robot.description import LoopTable
from calibtool.robot.loops import FORBIDDEN, Follower, Loop, Tree
from calibtool.robot.mechanism import Bodies
from calibtool.robot.se3 import Array, readonly
from calibtool.robot.source import Source
from calibtool.robot.tree import urdf_tree
from calibtool.robot.urdf import base_placement, frame_id, joint_name, mimic_joints

_NAMED = 12  # joints in a message


@dataclass(frozen=True, eq=False)
class TreeReading:
    """The contents of a description; actuated joints first; loops with all rows."""

    bodies: Bodies
    placements: Array
    twists: Array
    tree: Tree
    limited_by: tuple[LimitSource, ...]


def read_tree(source: Source) -> TreeReading:
    """Joints, cut frames and limits of a description. InputError for contradictions."""
    place, kinematics = source.place, source.description.kinematics
    model = opened(source)
    names = [joint_name(model, j) for j in range(model.njoints)]
    tool = model.frames[frame_id(model, kinematics.tool_frame, place)]
    base = base_placement(model, kinematics.base_frame, place)
    if tool.parentJoint == 0:
        raise InputError(
            f"{place}: no joint moves the tool frame '{kinematics.tool_frame}'; name a frame on a "
            "moving link as kinematics.tool_frame"
        )
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
            waiting.append(_leader(names, names[joint], mimics, place))
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
    _check_different(kinematics.loops, [loop.name for loop in loops], place)
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
    return TreeReading(bodies, placements_array, readonly(twists), tree, sources)


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


def _check_different(loops: list[LoopTable], names: list[str], place: str) -> None:
    """InputError for two loops of one name, or between the same frames."""
    first: dict[frozenset[str], str] = {}
    for k, (loop, name) in enumerate(zip(loops, names, strict=True)):
        if name in names[:k]:
            raise InputError(f"{place}: kinematics.loops: two loops have the name '{name}'")
        other = first.setdefault(frozenset(loop.frames), name)
        if other != name:
            raise InputError(
                f"{place}: loop '{name}' joins the same frames as loop '{other}'; leave one out"
            )


def _leader(
    names: list[str], joint: str, mimics: dict[str, tuple[str, float, float]], place: str
) -> int:
    """The id of the joint that `joint` mimics, which must not follow `joint` itself."""
    leader = mimics[joint][0]
    if leader not in names[1:]:
        raise InputError(
            f"{place}: joint '{joint}' mimics '{leader}', which is locked or not in the URDF; lock "
            f"'{joint}' too"
        )
    if leader == joint:
        raise InputError(f"{place}: joint '{joint}' mimics itself")
    ring = [joint]
    while ring[-1] in mimics and mimics[ring[-1]][0] not in ring:
        ring.append(mimics[ring[-1]][0])
    if ring[-1] in mimics:
        raise InputError(
            f"{place}: joints {', '.join(map(repr, ring))} mimic each other: take <mimic> from "
            "the one that has a motor"
        )
    return names.index(leader, 1)


def _actuated_first(
    source: Source, names: list[str], used: list[int], mimics: set[str]
) -> tuple[list[int], int]:
    """Joint ids, the actuated ones first in the description's order, and their number."""
    place, given = source.place, source.description.kinematics.actuated
    if given is None:
        if source.description.kinematics.loops:
            joints = [names[j] for j in used if names[j] not in mimics]
            of = f"{', '.join(joints[:_NAMED])}{' …' * (len(joints) > _NAMED)}"
            remedy = "name the joints that have a motor, in their order"
            if assumed := source.description.assumed:
                remedy += ", in a robot.toml with urdf = this file and its loops"
                if "MJCF" in assumed:
                    remedy += ', or give each an actuator here (<position joint="…"/>)'
            raise InputError(f"{place}: kinematics.actuated is missing: {remedy}; joints: {of}")
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
    """`closed_at` (J,), rad or m: by default 0, or for an actuated joint the limit nearest to 0."""
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
                f"limits {low:g} to {high:g}"
            )
    return theta


def _length(source: Source, placements: Array) -> float:
    """Characteristic length: as given, or half the sum of distances of neighbouring joints."""
    given = source.description.kinematics.length
    if given is not None:
        return given
    return max(float(np.linalg.norm(placements[1:, :3, 3], axis=-1).sum()) / 2, 1e-3)
