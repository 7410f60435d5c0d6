"""The tool of a URDF without a robot.toml, and the positions of locked joints."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite

from calibtool.errors import InputError, UsageError, near_names
from calibtool.robot.tree import SINGLE, Joint, Tree
from calibtool.robot.urdf_text import Converted, Cut

# What tools are called, the surest first. Names are compared by words: `link_TCP` is `link tcp`.
_TOOLS = tuple(
    re.compile(rf"\b(?:{words})\b")
    for words in (
        r"tool 0",
        r"tcp|tool cent(?:er|re)(?: point)?",
        r"flange|flansch",
        r"ee|eef|eff|endeff|endeffector|end effector",
        r"tool|werkzeug|outil|herramienta|utensile",
        r"grasp|grasping|pinch|tool mount|mount|attachment",
    )
)
# Links that are no tool: what grips, sees, or stands for a shape.
_NO_TOOL = re.compile(
    r"\b(?:fingers?|fingertips?|thumb|knuckles?|jaws?|claws?|pads?|"
    r"camera|kamera|caméra|cámara|telecamera|cam|realsense|kinect|sensors?|depth|optical|"
    r"rgb|color|infra|ir|laser|lidar|imu|"
    r"ft|force|torque|collision|visual|inertial?|com|cog|cable|hose|led|light|button|"
    r"display|screw|aruco|marker|contact|sc)\b"
)
_GRIPS = re.compile(
    r"\b(?:gripper|greifer|grip|fingers?|fingertips?|thumb|index|middle|ring|little|pinky|"
    r"phalanx|distal|proximal|knuckles?|jaws?|claws?|pincers?|tongs?|suction|"
    r"driver|coupler|follower|spring link)\b"
)
_PISTON = re.compile(r"\b(?:piston|cylinder|rod)\b")
_TURNS = re.compile(r"\b(?:rotation|rotate|rot|roll|pitch|yaw|wrist)\b")
_BASE = re.compile(r"\b(?:base|mobile|world|odom|virtual|theta|yaw|footprint)\b")
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_ARM = 4  # joints that must follow a slide without limits for it to be part of a moving base
_MANY = 2  # a link with this number of arm joints behind it, or more, is no tool


@dataclass(frozen=True)
class Choice:
    """tool_frame and locked_joints (rad or m) for a description without robot.toml.

    With closed loops also the loops on which the tool depends, the joints with a motor, and a
    closed configuration, rad or m.
    """

    tool: str
    locked: dict[str, float]
    loops: tuple[Cut, ...] = ()
    actuated: tuple[str, ...] | None = None
    closed_at: dict[str, float] = field(default_factory=dict)

    @property
    def toml(self) -> str:
        """The lines of [kinematics] that say the same."""
        lines = [f"tool_frame = {quoted(self.tool)}"]
        if self.locked:
            lines.append(f"locked_joints = {_table(self.locked)}")
        if self.loops:
            loops = (
                f"{{ name = {quoted(name)}, frames = [{quoted(a)}, {quoted(b)}], "
                f"joint = {quoted(kind)} }}"
                for name, a, b, kind in self.loops
            )
            lines.append(f"loops = [{', '.join(loops)}]")
        if self.actuated is not None:
            lines.append(f"actuated = [{', '.join(map(quoted, self.actuated))}]")
        if self.closed_at:
            lines.append(f"closed_at = {_table(self.closed_at)}")
        return "\n".join(lines)


def _table(values: dict[str, float]) -> str:
    return f"{{ {', '.join(f'{quoted(key)} = {value!r}' for key, value in values.items())} }}"


def quoted(text: str) -> str:
    """A text as TOML writes it."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def chosen(
    tree: Tree, name: str, tool: str | None = None, conversion: Converted | None = None
) -> Choice:
    """The tool of a URDF, `tool` or the one found by names and joints, and the joints to lock.

    conversion: the closed loops of the description; those that do not move the tool are left out.

    A tool is found by its name or, where no link has such a name, by the number of joints before
    it. A finger, a camera or a collision shape is not a tool. Joints that are not between base and
    tool are locked, and those of a base that moves freely: floating, planar, slides without limits.
    UsageError with a list where several links could be the tool; InputError for a loop from a link
    to itself.
    """
    loops = conversion.loops if conversion else ()
    if tool is None:
        tool = _tool(tree, name, {frame for _, a, b, _ in loops for frame in (a, b)})
    elif tool not in tree.links:
        raise UsageError(f"--tool: '{tool}' is no link of {name}; {near_names(tool, tree.links)}")
    _check_two_links(tree, loops, name)
    closing, moving = _closing(tree, tool, loops)
    motors = conversion.actuated if conversion else None
    closes = closing or (motors is not None and any(joint.follows for joint in moving))
    way = tree.ways[tool]
    in_loops = {joint for loop in closing for joint in _round(tree, loop)}
    base = {joint for joint in way if joint not in _arm(way)} - in_loops
    arm = moving - base if closes else set(_arm(way))
    locked = _locked([joint for joint in tree.joints if joint.moves and joint not in arm])
    if conversion is None or not closes:
        return Choice(tool, locked)
    names = {joint.name for joint in arm}
    actuated = None if motors is None else tuple(each for each in motors if each in names)
    closed_at = {joint: value for joint, value in conversion.closed_at.items() if joint in names}
    return Choice(tool, locked, closing, actuated, closed_at)


def _closing(tree: Tree, tool: str, loops: Sequence[Cut]) -> tuple[tuple[Cut, ...], set[Joint]]:
    """The loops on which the tool depends, and the joints that move it, mimicked ones included."""
    moving = {joint for joint in tree.ways[tool] if joint.moves}
    held: list[Cut] = []
    while True:
        leaders = {
            tree.named[j.follows[0]] for j in moving if j.follows and j.follows[0] in tree.named
        }
        moving |= {joint for leader in leaders for joint in (*tree.ways[leader.parent], leader)}
        moving = {joint for joint in moving if joint.moves}
        more = [loop for loop in loops if loop not in held and _round(tree, loop) & moving]
        if not more:
            return tuple(loop for loop in loops if loop in held), moving
        held += more
        moving |= {joint for loop in more for joint in _round(tree, loop)}


def _check_two_links(tree: Tree, loops: Sequence[Cut], name: str) -> None:
    """InputError for a loop from a moving link to itself."""
    for loop, a, b, _ in loops:
        moves = any(joint.moves for joint in tree.ways.get(a, ()))
        if moves and not _round(tree, (loop, a, b, "")):
            raise InputError(
                f"{name}: loop '{loop}': '{a}' and '{b}' are on the same link: nothing moves "
                "between them; name a frame of each of the two links that it joins"
            )


def _round(tree: Tree, loop: Cut) -> set[Joint]:
    """The joints of a loop: those that move one of its frames alone."""
    a, b = (set(tree.ways.get(frame, ())) for frame in loop[1:3])
    return {joint for joint in a ^ b if joint.moves}


def _arm(way: Sequence[Joint]) -> Sequence[Joint]:
    """The joints of the arm without those of a freely moving base, and without its rotation."""
    moving = [joint for joint in way if joint.moves]
    start = 0
    for k, joint in enumerate(moving):
        slides = joint.kind == "prismatic" and not joint.bounded and len(moving) - k > _ARM
        turns = joint.kind in ("continuous", "revolute") and not joint.bounded
        if joint.kind not in SINGLE or slides:
            start = k + 1
        elif not (turns and k < 3 and _BASE.search(_words(f"{joint.name} {joint.child}"))):
            break
        elif start:
            start = k + 1
    return moving[start:]


def _tool(tree: Tree, name: str, cut: set[str]) -> str:
    ways = {
        link: [joint for joint in way if joint.kind in SINGLE] for link, way in tree.ways.items()
    }
    moved = {link: len(way) for link, way in ways.items() if way}
    if not moved:
        raise InputError(f"{name}: no joint of one degree of freedom; expected an arm")
    gripping = _gripping(tree)
    arm = {
        link: depth
        for link, depth in moved.items()
        if not any(joint.name in gripping for joint in ways[link])
    } or moved
    palms = {joint.parent for joint in tree.joints if joint.name in gripping}
    could = [
        link
        for link in arm
        if link not in cut
        and not _NO_TOOL.search(_words(link))
        and not (tree.ways[link][-1].parent in palms and _GRIPS.search(_words(link)))
    ]
    for tools in _TOOLS:
        named = [link for link in could if tools.search(_words(link))]
        found = _ends(tree, [link for link in named if _behind(ways[link][-1], ways, arm) < _MANY])
        if found:
            return _only(found, name, tools)
    deepest = [link for link in arm if arm[link] == max(arm.values())]
    found = _ends(tree, [link for link in deepest if link in could])
    return _only(found or [ways[link][-1].child for link in deepest[:1]], name)


def _only(found: Sequence[str], name: str, ends: re.Pattern[str] | None = None) -> str:
    """The only link, or the only one whose name says nothing but that it is a tool."""
    if ends is not None and len(found) > 1:
        ending = {link: ends.search(_words(link).removesuffix(" link")) for link in found}
        sure = [
            link for link, match in ending.items() if match and match.end() == len(match.string)
        ]
        found = sure or found
    if len(found) > 1:
        raise UsageError(
            f"{name}: several links could be the tool: {', '.join(found)}; "
            "say which with --tool, or write a robot.toml with its tool_frame"
        )
    return found[0]


def _words(name: str) -> str:
    return " ".join(_WORD.findall(name)).lower()


def _gripping(tree: Tree) -> set[str]:
    """Joints of a gripper or a rod, found by names, or because they follow a neighbouring joint."""
    found = set()
    for joint in (each for each in tree.joints if each.moves):
        words = f"{_words(joint.name)} / {_words(joint.child)}"
        named = _GRIPS.search(_words(joint.name)) or _PISTON.search(_words(joint.name))
        slides = _GRIPS.search(_words(joint.child)) and joint.kind == "prismatic"
        if (named and not _TURNS.search(words)) or slides:
            found.add(joint.name)
        if joint.follows is None:
            continue
        leader = tree.named.get(joint.follows[0])
        beside = leader is not None and joint not in tree.ways[leader.child]
        if leader is not None and beside and leader not in tree.ways[joint.parent]:
            found.add(joint.name)
            if leader.parent == joint.parent and not _moves_more(tree, leader):
                found.add(leader.name)
    return found


def _moves_more(tree: Tree, joint: Joint) -> bool:
    """Whether joints that do not follow others come after a joint."""
    return any(
        other.moves and other.follows is None and joint in tree.ways[other.parent]
        for other in tree.joints
    )


def _behind(joint: Joint, ways: dict[str, list[Joint]], arm: dict[str, int]) -> int:
    """The largest number of joints of the arm that come after a joint."""
    way = next(way for way in ways.values() if joint in way)
    return max(arm[link] for link in arm if joint in ways[link]) - way.index(joint) - 1


def _ends(tree: Tree, links: list[str]) -> list[str]:
    """The links that carry none of the others."""
    carriers = {joint.parent for link in links for joint in tree.ways[link]}
    return [link for link in links if link not in carriers]


def _locked(joints: list[Joint]) -> dict[str, float]:
    """Positions of locked joints: 0, the limit next to it, or that of a leading joint."""
    free = {joint.name: _nearest_to_zero(joint) for joint in joints}

    def position(joint: Joint) -> float:
        if joint.follows is None or joint.follows[0] not in free:
            return free[joint.name]
        leader, multiplier, offset = joint.follows
        value = free[leader] * multiplier + offset
        return value + 0.0 if isfinite(value) else free[joint.name]

    return {joint.name: position(joint) for joint in joints}


def _nearest_to_zero(joint: Joint) -> float:
    if joint.kind not in SINGLE or joint.kind == "continuous" or not joint.lower <= joint.upper:
        return 0.0
    return min(max(0.0, joint.lower), joint.upper) + 0.0
