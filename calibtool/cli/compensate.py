"""calibtool compensate: poses or joints in, corrected joints out."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.files import check_output, input_stream, message, one_stdin, output_stream, shown, text_lines
from calibtool.cli.load import load_calibration
from calibtool.cli.options import (
    EXACT,
    CalibrationFile,
    CompensationMethod,
    Force,
    FrameOption,
    JointValuesOption,
    LargestChange,
    Output,
    Outside,
    PayloadKg,
    TemperatureC,
    choice,
    under,
)
from calibtool.cli.options import largest_change as in_rad
from calibtool.cli.programs import (
    FORMATS,
    ROWS,
    Format,
    FramesFile,
    OnError,
    check_not_input,
    compensate_file,
    program_options,
    recognised,
)
from calibtool.cli.progress import counted
from calibtool.errors import UsageError

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.compensation.stream import RowFormat, StreamOptions
    from calibtool.compensation.weighed import Weights


def compensate(
    calibration: CalibrationFile,
    targets: Annotated[
        str,
        typer.Argument(metavar="[TARGETS]", help="CSV with joints (j1_deg …) or poses (x_mm … qw …); '-' is stdin."),
    ] = "-",
    output: Output = "-",
    method: CompensationMethod = EXACT,
    outside: Outside = "mark",
    joint_values: JointValuesOption = None,
    uncertainty: Annotated[
        bool, typer.Option("--uncertainty", help="Add predicted standard deviations of the tool: sd_mm, sd_mrad.")
    ] = False,
    verify: Annotated[
        bool,
        typer.Option("--verify", help="Drive the calibrated model to every corrected row; add left_mm, left_mrad."),
    ] = False,
    largest_change_deg: LargestChange = None,
    weights: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z,RX,RY,RZ",
            help="Fewer than six joints: weights of the tool's components, a trade in place of those that can be corrected.",
        ),
    ] = None,
    backlash: Annotated[
        bool, typer.Option("--backlash/--no-backlash", help="Take up backlash; --no-backlash: the rows are no path.")
    ] = True,
    payload_kg: PayloadKg = None,
    temperature_c: TemperatureC = None,
    frame: FrameOption = None,
    kind: Format = "auto",
    on_error: OnError = "stop",
    frames: FramesFile = None,
    line_buffered: Annotated[
        bool,
        typer.Option("--line-buffered", help="Answer every row at once, for a program at the other end of a pipe."),
    ] = False,
    force: Force = False,
) -> None:
    """Correct commanded poses or joint positions, any number of rows, or a controller program.

    By the calibrated model no row is worse than the command: where no better joints are found, it stays as it is. Rows
    come back with the corrected joints, the input's other columns and a status (docs/numerics): ok, jump (the correction
    changes faster than the command), outside (of the training's configurations); partial, limited, near-singular,
    out-of-limits (a part of the error stays), uncorrected (all of it: as commanded) or unreachable (empty joints, exit
    code 4; the other rows are written all the same). Poses without joints are a path: each row starts from the one before,
    jumps of the joints are reported. A calibration with backlash takes it up by the direction of each joint's corrected
    motion: rows must be in the order of motion.

    Of a program (docs/programs) only the numbers of joint and pose targets change; stderr says how many, by how
    much at most, and what was left alone and why. A target without an answer stops it, and nothing is written.

    Example: calibtool compensate calibration.h5 targets.csv -o corrected.csv
    """
    check_output(output, force)
    one_stdin(calibration, targets, frames)
    choice(method, ("exact", "one-step"), "--method")
    choice(kind, FORMATS, "--format")
    choice(on_error, ("stop", "skip"), "--on-error")
    from typing import cast

    from calibtool.calibration.frame_report import frame_report
    from calibtool.compensation.program import OUTSIDE_POLICIES, OutsidePolicy
    from calibtool.compensation.solve import Method
    from calibtool.compensation.stream import BATCH, RowFormat, StreamOptions
    from calibtool.robot.coupling import JOINT_VALUES, JointValues

    choice(outside, OUTSIDE_POLICIES, "--outside")
    if joint_values is not None:
        choice(joint_values, JOINT_VALUES, "--joint-values")
    solver, policy = cast(Method, method), cast(OutsidePolicy, outside)
    values = cast(JointValues | None, joint_values)
    most, weighed = in_rad(largest_change_deg), _weights(weights)
    loaded = under(load_calibration(calibration, frame)[0], payload_kg, temperature_c)
    found_frame = frame_report(loaded)
    if found_frame is not None and found_frame.name == "fitted":
        message(f"frame fitted: every target moves by the common part, too: {found_frame.common}")
    bounds = _bounds(loaded, most, weighed)
    with input_stream(targets) as stream:
        found = recognised(targets, stream.peek()) if kind == "auto" else kind
        if found not in ROWS:
            if uncertainty or verify or line_buffered:
                raise UsageError(
                    f"--uncertainty, --verify and --line-buffered are for rows, but {shown(targets)} is {found}"
                )
            check_not_input(output, targets, calibration)
            how = program_options(solver, policy, on_error, values, frames, backlash, most, weighed)
            compensate_file(loaded, stream.read(), targets, found, output, force, how)
            message(bounds)
            return
        if on_error != "stop" or frames is not None:
            raise UsageError(f"--on-error and --frames are for programs, but {shown(targets)} holds rows")
        options = StreamOptions(
            method=solver,
            outside=policy,
            uncertainty=uncertainty,
            verify=verify,
            joint_values=values or "serial",
            backlash=backlash,
            largest_change=most,
            weights=weighed,
            batch=1 if line_buffered else BATCH,
        )
        lines = text_lines(stream, shown(targets))
        compensate_rows(loaded, lines, shown(targets), cast(RowFormat, found), options, output, force, bounds)


def _weights(text: str | None) -> "Weights | None":
    """`--weights` as numbers; UsageError for what are none."""
    if text is None:
        return None
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"--weights is '{text}'; expected six numbers, for example 1,1,1,0,0,1") from None


def _bounds(calibration: "Calibration", largest_change: float | None, weights: "Weights | None") -> str:
    """How far joints may be changed, in words. UsageError for weights that do not fit the robot."""
    from math import degrees

    from calibtool.compensation.one_step import default_bounds

    robot = calibration.robot
    most = default_bounds(calibration, largest_change, weights).largest_change
    slides = f", slides by {most * robot.length * 1e3:.3g} mm" if any(robot.prismatic) else ""
    return f"joints change by at most {degrees(most):.3g} deg{slides} (--largest-change-deg)"


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
    """Write corrected rows as they come, then what people have to know of them."""
    from calibtool.compensation.stream import StreamReport, compensate_stream
    from calibtool.errors import NoSolutionError

    report = StreamReport()
    texts = compensate_stream(calibration, lines, name, options, report, row_format)
    with output_stream(output, force) as write:
        for text in counted(texts, "rows", options.batch):
            write(text.encode())
    for line in report.remarks:
        message(line, important=True)
    if report.others:
        message(f"… and {report.others} more rows; see the column status", important=True)
    message(bounds)
    if options.backlash and calibration.base.errors["backlash"].any():
        message("backlash is taken up along the rows, in their order; --no-backlash where they are no path")
    if options.verify:
        message(
            f"{report.rows} rows verified: the calibrated model stays within {report.left * 1e3:.3g} mm and "
            f"{report.turned * 1e3:.3g} mrad of the command where the status is ok, jump or outside"
        )
    if report.without_joints:
        raise NoSolutionError(
            f"{name}: {report.without_joints} of {report.rows} rows have no joints, unreachable or refused; the others "
            "are written"
        )
