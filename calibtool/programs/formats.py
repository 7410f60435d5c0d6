"""The formats of programs, and which one a file is in."""

from collections.abc import Callable
from pathlib import PurePath
from typing import Protocol

from calibtool.programs import abb, fanuc, kuka, ros2, ur
from calibtool.programs.targets import Program
from calibtool.robot.model import Robot


class Format(Protocol):
    """What the module of a format offers."""

    NAME: str

    @property
    def SUFFIXES(self) -> tuple[str, ...]:
        """Ends of file names, lower case."""

    def matches(self, text: str) -> bool:
        """Whether a text, or its first part, is of this format."""

    def read(self, text: str, robot: Robot) -> Program:
        """The targets of a program."""


_FORMATS: tuple[Format, ...] = (fanuc, kuka, abb, ur, ros2)
_MODULES = {module.NAME: module for module in _FORMATS}
PROGRAM_FORMATS = tuple(_MODULES)
_HEAD = 65536  # characters that tell a format


def reader(name: str) -> Callable[[str, Robot], Program]:
    """The function that finds the targets of a program in this format."""
    return _MODULES[name].read


def detected(text: str, name: str) -> str | None:
    """The format of a program: by what it holds, with the end of its name where that is not clear; None if nothing tells."""
    suffix = PurePath(name).suffix.lower()
    named = [module.NAME for module in _MODULES.values() if suffix in module.SUFFIXES]
    held = [module.NAME for module in _MODULES.values() if module.matches(text[:_HEAD])]
    both = [found for found in held if found in named]
    return next(iter(both + held + named), None)
