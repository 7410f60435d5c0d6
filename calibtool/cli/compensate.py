"""calibtool compensate: poses or joints in, corrected joints out."""

from collections.abc import Iterator
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from calibtool.cli.calibration_options import CalibrationOptions
from calibtool.cli.files import (
    STREAM,
    check_output,
    input_stream,
    message,
    one_stdin,
    output_stream,
    read_text,
    shown,
    text_lines,
    wrote,
)
from calibtool.cli.options import (
    EXACT,
    CalibrationFile,
    CompensationMethod,
    Force,
    JointValuesOption,
    LargestChange,
    Output,
    Outside,
    TakeUpBacklash,
    check_solving,
    comma_numbers,
    joint_values_of,
)
from calibtool.cli.options import largest_change as in_rad
from calibtool.cli.program_files import (
    ProgramTask,
    check_not_input,
    compensate_file,
    compensate_folder,
    recognised,
)
from calibtool.cli.program_flags import ROWS, ProgramFlags, controller_mechanism
from calibtool.cli.progress import counted
from calibtool.errors import InputError, NoSolutionError, UsageError
from calibtool.units import count_of, three_digits

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.compensation.stream import RowFormat, StreamOptions
    from calibtool.compensation.weighted_error import Weights


def compensate(
    *,
    calibration: CalibrationFile,
    targets: Annotated[
        str,
        typer.Argument(
            metavar="[TARGETS]",
            help="CSV with joints (j1_deg …) or poses (x_mm … qw …), a program, or a folder of "
            "programs; '-' is stdin.",
        ),
    ] = "-",
    output: Output = "-",
    method: CompensationMethod = EXACT,
    outside: Outside = "mark",
    joint_values: JointValuesOption = None,
    uncertainty: Annotated[
        bool,
        typer.Option(
            "--uncertainty", help="Add predicted standard deviations of the tool: sd_mm, sd_mrad."
        ),
    ] = False,
    verify: Annotated[
        bool,
        typer.Option(
            "--verify",
            help="Drive the calibrated model to every corrected row; add left_mm, left_mrad.",
        ),
    ] = False,
    largest_change_deg: LargestChange = None,
    weights: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z,RX,RY,RZ",
            help="Fewer than six joints: weights of the tool's components, a trade in place of "
            "those that can be corrected.",
        ),
    ] = None,
    backlash: TakeUpBacklash = True,
    conditions: CalibrationOptions,
    programs: ProgramFlags,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1, help="Processes that help with very many joint rows (default: one per core)."
        ),
    ] = None,
    line_buffered: Annotated[
        bool,
        typer.Option(
            "--line-buffered",
            help="Answer every row at once, for a program at the other end of a pipe.",
        ),
    ] = False,
    force: Force = False,
) -> None:
    """Correct a program, or a table of poses or joints.

    A table comes back with the corrected joints, its other columns and a status for every row. ok:
    corrected. jump: the correction changes faster than the command. outside: unlike the
    configurations of the training. partial, limited, near-singular, out-of-limits: a part of the
    error stays. uncorrected: the row is as commanded. unreachable: no joints; the exit code is 4,
    and the other rows are written. docs/numerics.md explains each.

    By the calibrated model no corrected row is worse than its command. Poses without joints are a
    path: each row starts from the one before. Backlash is taken up by the direction of motion, so
    rows must be in the order of motion.

    In a program only the numbers of joint and pose targets change. stderr reports how many
    changed, by how much, and which were left and why. If a target has no answer, nothing is written
    (--on-error). If the program moves to some corrected poses and to some that were left, it is
    written and the exit code is 4 (--partial: 0). The programs of a folder are corrected together:
    give a folder for -o. Poses are written for the controller's own model (--controller).
    docs/programs describes each language.

    Example: calibtool compensate calibration.h5 targets.csv -o corrected.csv
    """
    if not targets:
        raise UsageError("the name of the targets is empty; give a file, a folder or '-'")
    folder = targets != STREAM and Path(targets).is_dir()
    if not folder:
        check_output(output, force)
    report, others = programs.report, programs.with_ or []
    if report is not None:
        check_output(report, force, suffixes=(".csv",))
        if (report == output == STREAM) or Path(report).resolve() == Path(output).resolve():
            name = "stdout" if report == STREAM else report
            raise UsageError(f"{name}: is the output, too; give another file for --report")
    one_stdin(calibration, targets, programs.frames, programs.controller, *others)
    programs.check()
    from calibtool.calibration.frame_report import frame_report
    from calibtool.compensation.solve import Method
    from calibtool.compensation.stream import BATCH, RowFormat, StreamOptions
    from calibtool.compensation.targets import OutsidePolicy
    from calibtool.processes import processors

    check_solving(method, outside)
    solver, policy = cast(Method, method), cast(OutsidePolicy, outside)
    values = joint_values_of(joint_values)
    most, weighed = in_rad(largest_change_deg), _weights(weights)
    loaded = conditions.load(calibration)
    found_frame = frame_report(loaded)
    if found_frame is not None and found_frame.name == "fitted":
        message(f"frame fitted: every target moves by the common part, too: {found_frame.common}")
    bounds = _bounds(loaded, most, weighed)

    def task_of_programs() -> ProgramTask:
        from calibtool.programs.correction import ProgramOptions
        from calibtool.programs.frames import NamedFrames, read_frames

        frames = programs.frames
        options = ProgramOptions(
            method=solver,
            outside=policy,
            on_error=programs.on_error,
            joint_values=values,
            frames=NamedFrames()
            if frames is None
            else read_frames(read_text(frames), shown(frames)),
            backlash=backlash,
            ignore_external=programs.external == "ignore",
            largest_change=most,
            weights=weighed,
            controller_model=controller_mechanism(programs, loaded.robot),
        )
        return ProgramTask(loaded, options, programs, output, force, bounds)

    if folder:
        check_for_rows(f"{targets} is a folder", uncertainty, verify, line_buffered)
        compensate_folder(task_of_programs(), targets)
        return
    with input_stream(targets) as stream:
        if programs.kind == "auto":
            check_readable(shown(targets), stream.peek())
        found = recognised(targets, stream.peek()) if programs.kind == "auto" else programs.kind
        if found not in ROWS:
            check_for_rows(f"{shown(targets)} is {found}", uncertainty, verify, line_buffered)
            for path in (output, *([] if report is None else [report])):
                check_not_input(path, targets, calibration, *others)
            task = task_of_programs()
            compensate_file(task, targets, stream.read(), found)
            return
        if programs.given:
            raise UsageError(
                "--on-error, --frames, --with, --report, --partial and --controller are for "
                f"programs, but {shown(targets)} is read as rows; if it is one, --format names its "
                "language"
            )
        options = StreamOptions(
            method=solver,
            outside=policy,
            uncertainty=uncertainty,
            verify=verify,
            joint_values=values,
            backlash=backlash,
            largest_change=most,
            weights=weighed,
            batch=1 if line_buffered else BATCH,
            workers=1 if line_buffered else workers or processors(),
        )
        lines = text_lines(stream, shown(targets))
        compensate_rows(
            loaded, lines, shown(targets), cast(RowFormat, found), options, output, force, bounds
        )


def _weights(text: str | None) -> "Weights | None":
    """`--weights` as numbers; UsageError for anything else."""
    if text is None:
        return None
    weights = comma_numbers(text)
    if not weights:
        raise UsageError(f"--weights is '{text}'; expected six numbers, for example 1,1,1,0,0,1")
    return tuple(weights)


def _bounds(
    calibration: "Calibration", largest_change: float | None, weights: "Weights | None"
) -> str:
    """How far joints may be changed, in words. UsageError for weights that do not fit the robot."""
    from calibtool.compensation.one_step import default_bounds

    robot = calibration.robot
    most = default_bounds(calibration, largest_change, weights).largest_change
    turn, slide = f"{degrees(most):.3g} deg", f"{most * robot.length * 1e3:.3g} mm"
    both = f"{turn}, of a slide {slide}" if any(robot.prismatic) else turn
    limit = slide if all(robot.prismatic) else both
    return f"limit of the change of a joint: {limit} (--largest-change-deg)"


def check_readable(name: str, head: bytes) -> None:
    """InputError for a program in a language that is not read."""
    from calibtool.programs.unread import unread_program

    if what := unread_program(head):
        raise InputError(f"{name}: {what}")


def check_for_rows(what: str, uncertainty: bool, verify: bool, line_buffered: bool) -> None:
    """UsageError for options that programs do not have."""
    if uncertainty or verify or line_buffered:
        raise UsageError(f"--uncertainty, --verify and --line-buffered are for rows, but {what}")


def compensate_rows(
    calibration: "Calibration",
    lines: Iterator[str],
    name: str,
    row_format: "RowFormat",
    options: "StreamOptions",
    output: str,
    force: bool,
    bounds: str,
) -> None:
    """Write corrected rows in batches, then a summary on stderr."""
    from calibtool.compensation.stream import StreamReport, compensate_stream

    report = StreamReport()
    texts = compensate_stream(calibration, lines, name, options, report, row_format)
    with output_stream(output, force) as write:
        for text in counted(texts, "rows", options.batch):
            write(text.encode())
    for line in report.remarks:
        message(line, important=True)
    if report.others:
        message(f"… and {report.others} more rows; see the column status", important=True)
    if report.both:
        message(
            f"note: {name}: joints and poses in every row: the poses are corrected, the joints "
            "choose the branch"
        )
    message(bounds)
    if options.backlash and calibration.base.errors["backlash"].any():
        message(
            "backlash is taken up along the rows, in their order; --no-backlash where "
            "they are no path"
        )
    if options.verify:
        kept = (
            f"{report.rows} rows verified, none is corrected in full"
            if not report.in_full
            else f"{report.rows} rows verified: the calibrated model stays within "
            f"{three_digits(max(report.remaining_position * 1e3, 1e-4))} mm and "
            f"{three_digits(max(report.remaining_orientation * 1e3, 1e-4))} mrad of the command "
            "where the status is ok, jump or outside"
        )
        message(kept)
    wrote(output, count_of(report.rows, "corrected row"))
    if report.without_joints:
        raise NoSolutionError(
            f"{name}: {report.without_joints} of {report.rows} rows have no joints, unreachable or "
            "refused; the others are written"
        )
