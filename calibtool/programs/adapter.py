"""Programs whose language still reports targets in the order of the text, as one routine of motions."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from calibtool.programs.motions import (
    BASE,
    FLANGE,
    FRAME,
    JOINT,
    TOOL,
    Aim,
    Frame,
    Literal,
    Move,
    Program,
    Routine,
    Source,
    frame_of,
)
from calibtool.programs.targets import Program as TargetProgram
from calibtool.robot.se3 import Array


def adapted(texts: Sequence[TargetProgram], sources: Sequence[Source]) -> Program:
    """A program in which each target of each text is a motion, in the order of the text."""
    literals: list[Literal] = []
    routines = [
        Routine(f"{number}", tuple(_moves(read, number, literals)), number)
        for number, read in enumerate(texts)
    ]
    return Program(
        tuple(sources),
        tuple(literals),
        tuple(routines),
        remarks=tuple(
            replace(remark, source=number)
            for number, read in enumerate(texts)
            for remark in read.remarks
        ),
        notes=tuple(dict.fromkeys(note for read in texts for note in read.notes)),
    )


def _moves(read: TargetProgram, source: int, literals: list[Literal]) -> Iterator[Move]:
    for target in read.targets:
        near = None
        if target.joints:
            literals.append(Literal(JOINT, target.joints, target.line, target.name, source=source))
            near = len(literals) - 1
        frame = _frame(FRAME, target.frame, read.frames)
        tool = _frame(TOOL, target.tool, read.tools)
        aim = Aim(len(literals), frame, tool, near=near)
        if target.kind == JOINT:
            aim = replace(aim, frame=BASE, tool=FLANGE)
        yield Move(target.line, target.name, (aim,))
        literals.append(
            Literal(
                target.kind,
                target.numbers,
                target.line,
                target.name,
                target.orientation,
                target.configuration,
                source,
            )
        )


def _frame(kind: str, name: str | None, known: dict[str, Array]) -> Frame:
    T = None if name is None else known.get(name)
    return Frame(kind, name) if T is None else frame_of(kind, name, T)
