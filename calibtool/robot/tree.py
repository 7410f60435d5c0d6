"""Links and joints of a URDF as they are written: parents, limits, mimic joints."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import nan
from xml.etree.ElementTree import Element

from calibtool.errors import InputError
from calibtool.robot.markup import parse_xml

SINGLE = ("revolute", "continuous", "prismatic")  # kinds of joints with one degree of freedom
MOST_LINKS, DEEPEST = 2000, 500  # Pinocchio goes down the tree call by call: 10,000 crash it
UNBOUNDED = 1e3  # rad or m: larger limits mean that there is no limit
_OF_JOINTS = ("parent", "child", "origin", "axis", "limit", "mimic")


@dataclass(frozen=True)
class Joint:
    """One <joint>. lower, upper: rad or m, NaN where the URDF says nothing readable; of one limit
    alone the other is 0, as the format has it. rpy: of its origin, rad, as it is written.

    follows: the joint that it mimics, with multiplier and offset.
    """

    name: str
    kind: str
    parent: str
    child: str
    lower: float = nan
    upper: float = nan
    rpy: tuple[float, ...] = ()
    follows: tuple[str, float, float] | None = None

    @property
    def bounded(self) -> bool:
        """Whether it has limits: numbers in order, of no more than UNBOUNDED."""
        return self.lower < self.upper and max(abs(self.lower), abs(self.upper)) <= UNBOUNDED

    @property
    def moves(self) -> bool:
        """Whether it is anything but fixed."""
        return self.kind != "fixed"


@dataclass(frozen=True)
class Tree:
    """Links and joints in the order of the text; every link but the root has a joint before it."""

    links: tuple[str, ...]
    joints: tuple[Joint, ...]

    @cached_property
    def before(self) -> dict[str, Joint]:
        """The joint of a link, by the link's name; the root has none."""
        return {joint.child: joint for joint in self.joints}

    @cached_property
    def named(self) -> dict[str, Joint]:
        """The joints by name."""
        return {joint.name: joint for joint in self.joints}

    @cached_property
    def ways(self) -> dict[str, tuple[Joint, ...]]:
        """The joints from the root to each link, fixed ones too."""
        found: dict[str, tuple[Joint, ...]] = {}
        for link in self.links:
            way: list[Joint] = []
            while link in self.before and link not in found and len(way) < len(self.joints):
                way.insert(0, self.before[link])
                link = way[0].parent
            known = found.get(link, ())
            for k, joint in enumerate(way):
                found[joint.child] = (*known, *way[: k + 1])
            found.setdefault(link, ())
        return found


def urdf_root(text: str, name: str, *, comments: bool = False) -> Element:
    """The <robot> of a URDF text, without the prefixes that a namespace puts before its names.

    InputError, with `name`, for a text that is no URDF, and for a link with two parents.
    """
    root = parse_xml(text, name, "URDF", comments=comments)
    prefix, _, tag = root.tag.rpartition(":")
    if tag != "robot":
        raise InputError(f"{name}: no URDF: its root is <{root.tag}>, expected <robot>")
    for element in root.iter() if prefix else ():
        if isinstance(element.tag, str):
            element.tag = element.tag.removeprefix(f"{prefix}:")
    for joint in root.iterfind("joint"):
        for part in joint:
            tag = part.tag.rpartition(":")[2].lower() if isinstance(part.tag, str) else ""
            if tag in _OF_JOINTS:  # <Mimic> is meant as one, too
                part.tag = tag
    _check_parents(root, name)
    _check_size(root, name)
    return root


@lru_cache(maxsize=32)
def urdf_tree(text: str, name: str) -> Tree:
    """Links and joints of a URDF text; see `urdf_root` for what is refused."""
    root = urdf_root(text, name)
    links = (link.get("name", "") for link in root.iterfind("link"))
    return Tree(tuple(links), tuple(_joint(each) for each in root.iterfind("joint")))


def _check_parents(root: Element, name: str) -> None:
    """A link with two joints before it closes a loop: that is no tree."""
    parents: dict[str, str] = {}
    for joint in map(_joint, root.iterfind("joint")):
        if joint.child in parents:
            raise InputError(
                f"{name}: link '{joint.child}' has two parent joints, "
                f"'{parents[joint.child]}' and '{joint.name}': they close a loop; a URDF is a tree"
            )
        parents[joint.child] = joint.name


def _check_size(root: Element, name: str) -> None:
    """InputError for more links, or more of them in a row, than any robot has; and for a circle."""
    above = {joint.child: joint.parent for joint in map(_joint, root.iterfind("joint"))}
    if max(len(root.findall("link")), len(above)) > MOST_LINKS:
        raise InputError(f"{name}: the URDF has more than {MOST_LINKS} links")
    depth: dict[str, int] = {}
    for link in above:
        way: list[str] = []
        while link in above and link not in depth and len(way) <= DEEPEST:
            way.append(link)
            link = above[link]
        for step, passed in enumerate(reversed(way), start=depth.get(link, 0) + 1):
            depth[passed] = step
        if link in way:
            circle = ", ".join(way[way.index(link) : way.index(link) + 8])
            raise InputError(
                f"{name}: links stand on each other in a circle ({circle}); a URDF is a tree"
            )
        if way and depth[way[0]] > DEEPEST:
            raise InputError(f"{name}: the URDF has more than {DEEPEST} joints in a row")


def _joint(element: Element) -> Joint:
    def attribute(part: str, key: str) -> str:
        found = element.find(part)
        return "" if found is None else found.get(key, "")

    limit, followed = element.find("limit"), element.find("mimic")
    given = limit is not None and ("lower" in limit.attrib or "upper" in limit.attrib)
    lower, upper = (attribute("limit", key) or ("0" if given else "") for key in ("lower", "upper"))
    return Joint(
        name=element.get("name", ""),
        kind=element.get("type", ""),
        parent=attribute("parent", "link"),
        child=attribute("child", "link"),
        lower=_number(lower),
        upper=_number(upper),
        rpy=tuple(map(_number, attribute("origin", "rpy").split())),
        follows=None
        if followed is None
        else (
            followed.get("joint", ""),
            _number(followed.get("multiplier", "1")),
            _number(followed.get("offset", "0")),
        ),
    )


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return nan
