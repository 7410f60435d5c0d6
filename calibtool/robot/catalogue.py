"""The built-in robots, and robots by name or path."""

from functools import lru_cache
from pathlib import Path

from calibtool.errors import UsageError, near_names
from calibtool.robot.robot import Robot, is_path
from calibtool.robot.shipped import shipped
from calibtool.robot.source import read_source


def robot_names() -> list[str]:
    """Names of the built-in robots, sorted."""
    return sorted(path.parent.name for path in shipped("robots").glob("*/robot.toml"))


def load_robot(name: str, tool: str | None = None, allowed: tuple[Path, ...] = ()) -> Robot:
    """A robot by its name in the catalogue, or by the path of a folder or of a description.

    tool: the tool frame of a description that does not name it. allowed: folders, besides that of
    the description, whose files it may name. Raises UsageError for an unknown name or path,
    InputError for a description that is wrong.
    """
    names = robot_names()
    if name in names:
        if tool is not None:
            raise UsageError(f"--tool: the robot {name} of the catalogue has its tool")
        return _built_in(name)
    if not is_path(name):
        raise UsageError(
            f"unknown robot '{name}'; {near_names(name, names)} (or the path of a "
            "robot.toml or URDF)"
        )
    if not Path(name).exists():
        raise UsageError(f"{name}: no such file or folder")
    return Robot.from_source(read_source(Path(name), tool, allowed))


@lru_cache
def _built_in(name: str) -> Robot:
    return Robot.from_source(read_source(shipped("robots") / name / "robot.toml"))
