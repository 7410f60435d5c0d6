"""Descriptions with closed loops, changed: the texts of a built-in robot, or a URDF of few
joints.
"""

from pathlib import Path

from calibtool.robot.catalogue import shipped
from calibtool.robot.robot import Robot
from calibtool.robot.source import parse_source


def texts(name: str) -> tuple[str, str]:
    """robot.toml and robot.urdf of a built-in robot."""
    folder = shipped("robots") / name
    return (folder / "robot.toml").read_text(), (folder / "robot.urdf").read_text()


def changed(name: str, *pairs: tuple[str, str]) -> Robot:
    """A built-in robot with texts replaced, each of which must be there."""
    toml, urdf = texts(name)
    for old, new in pairs:
        assert old in toml or old in urdf, old
        toml, urdf = toml.replace(old, new), urdf.replace(old, new)
    return Robot.from_source(parse_source(toml, urdf, "mine"))


def written(folder: Path, name: str, *pairs: tuple[str, str]) -> str:
    """The same as a folder on disk, and its path."""
    toml, urdf = texts(name)
    for old, new in pairs:
        assert old in toml or old in urdf, old
        toml, urdf = toml.replace(old, new), urdf.replace(old, new)
    (folder / "robot.toml").write_text(toml)
    (folder / "robot.urdf").write_text(urdf)
    return str(folder)


def joint(
    name: str,
    parent: str,
    child: str,
    xyz: str = "0 0 0",
    kind: str = "revolute",
    axis: str = "0 0 1",
    more: str = "",
) -> str:
    """A joint of a URDF and its child."""
    limit = "" if kind == "fixed" else '<limit lower="-3" upper="3" effort="1" velocity="1"/>'
    axis = "" if kind == "fixed" else f'<axis xyz="{axis}"/>'
    return (
        f'<link name="{child}"/><joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{xyz}"/>{axis}{limit}{more}</joint>'
    )


def robot_of(urdf: str, kinematics: str) -> Robot:
    """A robot of joints behind a link `base`."""
    toml = (
        'name = "mine"\ntitle = "mine"\n[kinematics]\nurdf = "robot.urdf"\ntool_frame = "tool"\n'
        f"{kinematics}\n"
        "[targets]\npoints_mm = [[100, 0, 0], [0, 100, 0], [0, 0, 100]]\n"
    )
    return Robot.from_source(
        parse_source(toml, f'<robot name="mine"><link name="base"/>{urdf}</robot>', "mine")
    )
