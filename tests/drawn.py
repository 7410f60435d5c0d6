"""Serial chains as data, written as URDF text: the robots of tests that
draw or make up their own.
"""

from dataclasses import dataclass

from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.source import parse_source

LIMITS = {
    "revolute": (-2.5, 2.8),
    "prismatic": (-0.1, 0.1),
}  # robot.toml has those of slides, which are scaled


@dataclass(frozen=True)
class DrawnJoint:
    """A joint of a drawn chain: origin in the joint before (m, rad), axis of any length."""

    kind: str
    xyz: tuple[float, float, float]
    rpy: tuple[float, float, float]
    axis: tuple[float, float, float]
    mass: float


@dataclass(frozen=True)
class DrawnChain:
    """Text of a chain can be written with other names, another base before it, or other lengths."""

    joints: tuple[DrawnJoint, ...]
    tool: DrawnJoint
    targets_mm: tuple[tuple[float, float, float], ...]

    def robot(
        self,
        *,
        tool_name: str = "tool0",
        base: Array | None = None,
        base_frame: str | None = None,
        scale: float = 1.0,
        tolerance_mm: float | None = None,
    ) -> Robot:
        """base: xyz and rpy (6,) of the chain on a further link `world`; scale: of every length,
        also the tolerance.
        """
        key = f'base_frame = "{base_frame}"\n' if base_frame else ""
        limits = "".join(
            f"j{i + 1}_mm = [{-400 * scale!r}, {600 * scale!r}]\n"
            for i, joint in enumerate(self.joints)
            if joint.kind == "prismatic"
        )
        points = [[float(c) * scale for c in point] for point in self.targets_mm]
        toml = (
            'name = "drawn"\ntitle = "drawn"\n[kinematics]\nurdf = "robot.urdf"\n'
            f'tool_frame = "{tool_name}"\n{key}'
            f"[targets]\npoints_mm = {points}\n[limits]\n{limits}"
            f"[tolerances]\nlength_mm = {scale if tolerance_mm is None else tolerance_mm!r}\n"
        )
        return Robot.from_source(parse_source(toml, self.urdf(tool_name, base, scale), "drawn"))

    def urdf(self, tool_name: str, base: Array | None, scale: float) -> str:
        """The text of a URDF: links base, l1 … ln, a link of a fixed joint, the tool."""
        links, joints = ['<link name="base"/>'], []
        if base is not None:
            links.append('<link name="world"/>')
            joints.append(
                _joint("stand", "fixed", "world", "base", tuple(base[:3]), tuple(base[3:]), None)
            )
        parent = "base"
        for i, joint in enumerate(self.joints, start=1):
            inertial = (
                f'<inertial><origin xyz="0 0 {0.1 * scale!r}"/><mass value="{joint.mass!r}"/>'
                '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
            )
            links.append(f'<link name="l{i}">{inertial if joint.mass else ""}</link>')
            xyz = tuple(scale * c for c in joint.xyz)
            joints.append(
                _joint(f"joint_{i}", joint.kind, parent, f"l{i}", xyz, joint.rpy, joint.axis)
            )
            parent = f"l{i}"
        links += ['<link name="flange"/>', f'<link name="{tool_name}"/>']
        xyz = tuple(scale * c for c in self.tool.xyz)
        joints.append(_joint("to_flange", "fixed", parent, "flange", xyz, (0.0, 0.0, 0.0), None))
        joints.append(
            _joint("to_tool", "fixed", "flange", tool_name, (0.0, 0.0, 0.0), self.tool.rpy, None)
        )
        return '<robot name="drawn">' + "".join(links + joints) + "</robot>"


def _joint(
    name: str, kind: str, parent: str, child: str, xyz: tuple, rpy: tuple, axis: tuple | None
) -> str:
    def words(values: tuple) -> str:
        return " ".join(repr(float(value)) for value in values)

    parts = (
        f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{words(xyz)}" '
        f'rpy="{words(rpy)}"/>'
    )
    if axis is not None:
        parts += f'<axis xyz="{words(axis)}"/>'
    if kind in LIMITS:
        parts += '<limit lower="{}" upper="{}" effort="0" velocity="0"/>'.format(*LIMITS[kind])
    return f'<joint name="{name}" type="{kind}">{parts}</joint>'
