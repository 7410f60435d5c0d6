"""Values of a description that are probably wrong: units, missing limits, frames far away."""

from math import isfinite

import numpy as np

from calibtool.robot.chain import NO_LIMITS
from calibtool.robot.markup import parse_xml
from calibtool.robot.robot import Robot
from calibtool.robot.tree import SINGLE, Joint, urdf_tree

_MOST_TURN = 20.0  # rad: three turns and more are degrees
_LEAST_TURN, _SEVERAL = np.deg2rad(7.0), 3  # of several joints together: less are rad as degrees
_LONGEST = 50.0  # m, of one link or slide: longer ones are millimetres
_FARTHEST_REACH = 20.0  # m: largest length of all links together without slides
_NEAREST = 1e-3  # m: if all targets are nearer than this, points_mm was written in m
_FULL_TURN = 6.4  # rad: larger angles of a frame are taken for degrees
_SHORTEST = 1e-3  # m: smallest length of all links together
# kg of all links together over the cube of the arm's length in m: arms have 2 to 150
_LIGHTEST, _HEAVIEST = 0.02, 1000.0
_FARTHEST = 1e3  # m, of the base: 1e-13 of a micrometre is lost with every one beyond


def implausible(robot: Robot) -> list[str]:
    """One line per finding, with joint and remedy; none for a usual robot."""
    return [
        *_limits(robot),
        *_passive_limits(robot),
        *_lengths(robot),
        *_angles(robot),
        *_locked(robot),
        *_targets(robot),
        *_masses(robot),
    ]


def _limits(robot: Robot) -> list[str]:
    given = {name.split("_")[0] for name in robot.source.description.limits}
    found = []
    for source, what in NO_LIMITS.items():
        where = [
            f"j{j + 1}"
            for j, each in enumerate(robot.chain.limited_by)
            if each == source and f"j{j + 1}" not in given
        ]
        if where:
            joints = ", ".join(where)
            finding = f"no limits for {joints}" if source == "missing" else f"{joints} {what}"
            found.append(f"{finding}: ±180 deg are assumed; give them in [limits]")
    turning = ~np.array(robot.prismatic)
    widest = np.maximum(np.abs(robot.lower), np.abs(robot.upper))
    wide = [f"j{j + 1}" for j in np.flatnonzero(turning & (widest > _MOST_TURN))]
    if wide:
        turns = widest[turning].max() / (2 * np.pi)
        found.append(
            f"the limits of {', '.join(wide)} look like degrees: up to {turns:.0f} turns; a URDF "
            "has them in rad"
        )
    if turning.sum() >= _SEVERAL and widest[turning].max() < _LEAST_TURN:
        found.append(
            f"the limits are at most {np.rad2deg(widest[turning].max()):.3g} deg, which look like "
            'rad: write them in the unit of the file (an MJCF has degrees unless <compiler angle="'
            'radian"/> says otherwise)'
        )
    return found


def _passive_limits(robot: Robot) -> list[str]:
    if robot.chain.tree is None:
        return []
    joints = urdf_tree(robot.source.urdf_text, robot.source.place).named
    passive = robot.chain.bodies.joints[robot.n :]
    swapped = [f"'{name}'" for name in passive if joints[name].lower > joints[name].upper]
    if not swapped:
        return []
    return [
        f"the lower limit of the passive joint {', '.join(swapped[:3])} is above the upper one: it "
        "moves without limits; correct the URDF"
    ]


def _lengths(robot: Robot) -> list[str]:
    found = []
    base, *links = np.linalg.norm(robot.chain.placements[:, :3, 3], axis=-1).tolist()
    strokes = (robot.upper - robot.lower)[robot.prismatic]
    longest = max([*links, *strokes.tolist()])
    given = robot.source.description.kinematics.length
    if longest > _LONGEST:
        found.append(
            f"the lengths look like mm: a link or slide of {longest:.6g} m; a URDF has them in m"
        )
    elif (given or 0.0) > _FARTHEST_REACH:
        found.append(f"kinematics.length = {given:g} looks like mm: it is in m")
    elif sum(links) > _FARTHEST_REACH:
        found.append(
            f"the lengths look like mm, cm or inches: the links are {sum(links):.4g} m long "
            "together; a URDF has them in m"
        )
    elif base > _FARTHEST:
        found.append(
            f"joint 1 stands {base:.6g} m from the base frame: digits of every pose are lost; "
            "name a base_frame near the arm"
        )
    if robot.n > 1 and 0 < sum(links) + strokes.sum() < _SHORTEST:  # 0: all axes meet in a point
        found.append(
            f"the links are {(sum(links) + strokes.sum()) * 1e3:.3g} mm long together: check the "
            "unit of the lengths, m in a URDF"
        )
    return found


def _angles(robot: Robot) -> list[str]:
    joints = urdf_tree(robot.source.urdf_text, robot.source.place).joints
    turned = [joint.name for joint in joints if any(abs(a) > _FULL_TURN for a in joint.rpy)]
    if not turned:
        return []
    more = f" and {len(turned) - 3} more" if len(turned) > 3 else ""
    return [
        f"the rpy of {', '.join(turned[:3])}{more} looks like degrees: more than a full turn; "
        "a URDF has it in rad"
    ]


def _locked(robot: Robot) -> list[str]:
    joints = urdf_tree(robot.source.urdf_text, robot.source.place).named
    locked = robot.source.description.kinematics.locked_joints
    outside = [
        f"{name} at {value:g} (limits {joints[name].lower:g} to {joints[name].upper:g})"
        for name, value in locked.items()
        if name in joints and _beyond(joints[name], value)
    ]
    return [f"locked beyond their limits: {', '.join(outside)}; rad or m"] if outside else []


def _beyond(joint: Joint, value: float) -> bool:
    """Whether a position is outside of limits, where there are any."""
    if joint.kind not in SINGLE or joint.kind == "continuous" or not joint.lower < joint.upper:
        return False
    return not joint.lower - 1e-9 <= value <= joint.upper + 1e-9


def _targets(robot: Robot) -> list[str]:
    farthest = float(np.linalg.norm(robot.targets, axis=-1).max(initial=0.0))
    if not 0.0 < farthest < _NEAREST:
        return []
    return [
        f"the targets are within {farthest * 1e3:.3g} mm of the tool frame: points_mm looks like m"
    ]


def _masses(robot: Robot) -> list[str]:
    """Links with an implausible mass or centre of mass, on which gravity depends."""
    remedy = "correct <inertial>, from which gravity is computed"
    unread = _unread_masses(robot)
    if unread:
        return [f"the mass or its place of link {', '.join(unread)} is no number: {remedy}"]
    names, inertias = list(robot.chain.model.names), robot.chain.model.inertias
    masses = np.array([inertia.mass for inertia in inertias])
    below = [f"'{names[k]}'" for k in np.flatnonzero(masses < 0)]
    if below:
        return [f"the link after joint {', '.join(below)} has a mass below zero: {remedy}"]
    strokes = float((robot.upper - robot.lower)[np.array(robot.prismatic)].sum())
    length = float(np.linalg.norm(robot.chain.placements[:, :3, 3], axis=-1).sum()) + strokes
    away = np.array([float(np.linalg.norm(inertia.lever)) for inertia in inertias]) * (masses > 0)
    far, total = np.flatnonzero(away > max(length, 0.3)), float(masses.sum())
    found = []
    if len(far):
        joints = ", ".join(f"'{names[k]}'" for k in far)
        found.append(
            f"the link after joint {joints} has its centre of mass {away[far].max():.4g} m away, "
            f"and the whole arm is {length:.3g} m long: {remedy}"
        )
    if total > _HEAVIEST * max(length, 0.3) ** 3:
        heaviest = int(masses.argmax())
        found.append(
            f"the links weigh {total:.3g} kg together, and the arm is {length:.3g} m long; the one "
            f"after joint '{names[heaviest]}' weighs {masses[heaviest]:.4g} kg: {remedy}"
        )
    elif 0 < total < _LIGHTEST * length**3:
        found.append(
            f"the links weigh {total:.3g} kg together, and the arm is {length:.3g} m long: {remedy}"
        )
    return found


def _unread_masses(robot: Robot) -> list[str]:
    """Links whose mass or centre of mass is no finite number."""
    found = []
    for link in parse_xml(robot.source.urdf_text, robot.source.place, "URDF").iter("link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        mass, origin = inertial.find("mass"), inertial.find("origin")
        texts = [] if mass is None else [mass.get("value", "")]
        texts += [] if origin is None else origin.get("xyz", "").split()
        if not all(map(_finite, texts)):
            found.append(f"'{link.get('name', '')}'")
    return found


def _finite(text: str) -> bool:
    try:
        return isfinite(float(text))
    except ValueError:
        return False
