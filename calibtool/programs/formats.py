"""The languages of programs, and detection of the language of a file."""

from collections.abc import Sequence
from pathlib import PurePath
from typing import Protocol

import numpy as np

from calibtool.errors import check_choice
from calibtool.programs import abb, fanuc, kuka, ros2, ur
from calibtool.programs.motions import Program, ProgramText
from calibtool.programs.numbers import BYTE_ORDER_MARK
from calibtool.robot.coupling import JointValues, check_joint_values
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly


class Language(Protocol):
    """What the module of a language offers.

    coupling(robot) is optional: C (n, n) of q_serial = C · q_controller for programs of this
    language. The program then states the controller's joint values unless an option says otherwise.
    """

    NAME: str

    @property
    def SUFFIXES(self) -> tuple[str, ...]:
        """Suffixes of file names, lower case."""

    def matches(self, text: str) -> bool:
        """Whether a text, or its first part, is in this language."""

    def program(self, sources: Sequence[ProgramText], robot: Robot) -> Program:
        """The positions and motions of a program of one or several texts."""


_LANGUAGES: tuple[Language, ...] = (fanuc, kuka, abb, ur, ros2)
_MODULES = {module.NAME: module for module in _LANGUAGES}
PROGRAM_FORMATS = tuple(_MODULES)
_HEAD = 65536  # number of characters from which the format is recognised


def read_program(name: str, sources: Sequence[ProgramText], robot: Robot) -> Program:
    """The positions and motions of a program in the language called `name`."""
    check_choice(name, PROGRAM_FORMATS, "program format")
    program: Program = _MODULES[name].program(sources, robot)
    return program


def coupling_of(robot: Robot, name: str, joint_values: JointValues | None) -> Array:
    """C (n, n) of q_serial = C · q_program, which converts a program's joint values.

    `controller`: C of the language for this robot, otherwise that of the robot's description.
    `serial`: the identity. None: `controller` for languages that define a coupling, `serial` for
    the others. UsageError for another word.
    """
    if joint_values is not None:
        check_joint_values(joint_values)
    module = _MODULES[name]
    own = getattr(module, "coupling", None)
    if joint_values == "serial" or (joint_values is None and own is None):
        return readonly(np.eye(robot.n))
    return readonly(robot.coupling if own is None else own(robot))


def usual_suffix(name: str, language: str) -> bool:
    """Whether a file has a suffix of programs in the language called `language`."""
    return PurePath(name).suffix.lower() in _MODULES[language].SUFFIXES


def detected(text: str, name: str) -> str | None:
    """Format of a program by its contents, or by the suffix if ambiguous; None if unknown."""
    text = text.removeprefix(BYTE_ORDER_MARK)
    suffix = PurePath(name).suffix.lower()
    named = [module.NAME for module in _MODULES.values() if suffix in module.SUFFIXES]
    held = [module.NAME for module in _MODULES.values() if module.matches(text[:_HEAD])]
    both = [found for found in held if found in named]
    return next(iter(both + held + named), None)
