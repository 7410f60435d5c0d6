"""FANUC programs in ASCII (.LS), and listings of the controller's frames."""

import re
from collections.abc import Sequence

from calibtool.programs.configurations import has_postures
from calibtool.programs.motions import FRAME, TOOL, Frame, Literal, Program, ProgramText, Routine
from calibtool.programs.multibyte import beyond_ascii_blanked
from calibtool.programs.numbers import LineNumbers
from calibtool.programs.tp import sections
from calibtool.programs.tp_frames import Listed, Selection, is_listing
from calibtool.programs.tp_instructions import Instructions
from calibtool.programs.tp_positions import Positions, turn_axes
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

NAME = "fanuc-ls"
SUFFIXES = (".ls",)
_START = re.compile(r"(?:^|[\r\n])[ \t]*/(?:PROG\b|POS[ \t]*(?:[\r\n]|$))")


def matches(text: str) -> bool:
    """Whether this is a FANUC program."""
    return _START.search(text) is not None


def coupling(robot: Robot) -> Array:
    """C (n, n) of q_serial = C · q_controller: that of the description, otherwise q3 = J3 + J2 for
    six-joint arms.

    Their controllers state J3 against the horizontal.
    """
    matrix = robot.coupling.copy()
    if not robot.coupled and has_postures(robot):
        matrix[2, 1] = 1.0
    return matrix


def program(sources: Sequence[ProgramText], robot: Robot) -> Program:
    """The positions of motion group 1 and the motions to them; listings of variables give
    frames and tools.
    """
    listed = Listed()
    texts: dict[int, str] = {}
    for number, source in enumerate(sources):
        text = re.sub(r"\r(?!\n)", "\n", source.text)
        if is_listing(text):
            listed.read(text, number)
        else:
            texts[number] = beyond_ascii_blanked(text)
    axes = listed.turn_axes or turn_axes(list(texts.values()), robot)
    literals: list[Literal] = []
    remarks = listed.remarks
    programs: list[Instructions] = []
    for number, code in texts.items():
        lines = LineNumbers(code)
        reader = Positions(
            sources[number].text, code, number, lines, robot, axes, literals, remarks
        )
        programs += [Instructions(code, section, lines, reader) for section in sections(code)]
    changed = {key: why for one in reversed(programs) for key, why in one.changed()}
    frame, tool = (Selection(kind, listed.frames, changed) for kind in (FRAME, TOOL))
    names = {one.name: one.key for one in reversed(programs)}
    for one in programs:
        one.select_from(frame, tool)
        one.alone(literals)
    return Program(
        tuple(sources),
        tuple(literals),
        tuple(Routine(one.key, tuple(one.steps(names)), one.source) for one in programs),
        {selection.variable: Frame(selection.kind, None) for selection in (frame, tool)},
        tuple(remarks),
        tuple(note for one in programs for note in one.notes()),
    )
