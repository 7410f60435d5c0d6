"""Correction of a controller program: the corrected program and a summary."""

import gc
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from calibtool.calibration import Calibration
from calibtool.errors import InputError, UsageError
from calibtool.programs.branches import Controller
from calibtool.programs.correction import Correction, ProgramOptions
from calibtool.programs.formats import coupling_of, read_program
from calibtool.programs.motions import EXTERNAL, Literal, ProgramText
from calibtool.programs.program_summary import CompensatedProgram

LARGEST = 250_000  # number of positions that a program may have


def compensate_program(
    calibration: Calibration,
    data: bytes,
    name: str,
    program_format: str,
    options: ProgramOptions | None = None,
) -> CompensatedProgram:
    """Correct every joint and pose target of a program.

    A joint target gets the joints with which the calibrated robot reaches the pose that the nominal
    one would reach. A pose target is solved on the branch that the controller takes there. It gets
    the pose that the controller's model has at the corrected joints, in the target's own frame and
    tool.

    program_format: one of docs/programs; name: for messages; options: by default the exact method,
    which stops at the first target without a solution.

    Raises InputError for bad data and NoSolutionError for targets without a solution, both with the
    line. With on_error `skip` such targets are not changed, and they are listed.
    """
    return compensate_texts(calibration, [(name, data, True)], program_format, options)


@contextmanager
def _without_collector() -> Iterator[None]:
    """No garbage collection: there are no reference cycles, and it takes a quarter of the time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@_without_collector()
def compensate_texts(
    calibration: Calibration,
    texts: Iterable[tuple[str, bytes, bool]],
    program_format: str,
    options: ProgramOptions | None = None,
) -> CompensatedProgram:
    """The same for several texts: name, bytes and whether the text is corrected."""
    options = options or ProgramOptions()
    sources = [_source(*text) for text in texts]
    robot = calibration.robot
    program = read_program(program_format, sources, robot)
    if len(program.literals) > LARGEST:
        raise InputError(
            f"{sources[0].name}: holds {len(program.literals):,} positions; at most {LARGEST:,} "
            "are corrected together: give its parts one by one"
        )
    if options.ignore_external:
        program = replace(program, literals=tuple(map(_alone, program.literals)))
    controller = Controller(robot, coupling_of(robot, program_format, options.joint_values))
    return Correction(calibration, program, controller, options, program_format).result()


def _source(name: str, data: bytes, edited: bool) -> ProgramText:
    if not isinstance(data, bytes):
        raise UsageError(f"{name}: a program is bytes; read the file as bytes, or encode the text")
    if b"\0" in data:
        raise InputError(f"{name}: holds zero bytes; expected a program in ASCII, UTF-8 or Latin-1")
    return ProgramText(name, data.decode("latin-1"), edited)


def _alone(literal: Literal) -> Literal:
    """A literal without its external axes."""
    return (
        replace(literal, not_corrected="")
        if literal.not_corrected == EXTERNAL and literal.numbers
        else literal
    )
