"""Programs whose language still reports targets in the order of the text, as one routine of motions."""

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


def adapted(read: TargetProgram, source: Source) -> Program:
    """A program in which each target is a motion, in the order of the text."""
    literals: list[Literal] = []
    moves: list[Move] = []
    for target in read.targets:
        near = None
        if target.joints:
            literals.append(Literal(JOINT, target.joints, target.line, target.name))
            near = len(literals) - 1
        frame = _frame(FRAME, target.frame, read.frames)
        tool = _frame(TOOL, target.tool, read.tools)
        aim = Aim(len(literals), frame, tool, near=near)
        if target.kind == JOINT:
            aim = replace(aim, frame=BASE, tool=FLANGE)
        moves.append(Move(target.line, target.name, (aim,)))
        literals.append(
            Literal(
                target.kind,
                target.numbers,
                target.line,
                target.name,
                target.orientation,
                target.configuration,
            )
        )
    return Program(
        (source,),
        tuple(literals),
        (Routine("", tuple(moves)),),
        remarks=read.remarks,
        notes=read.notes,
    )


def _frame(kind: str, name: str | None, known: dict[str, Array]) -> Frame:
    T = None if name is None else known.get(name)
    return Frame(kind, name) if T is None else frame_of(kind, name, T)
