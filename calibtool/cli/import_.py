"""calibtool import: instrument tables to measurements."""

from typing import Annotated

import typer

from calibtool.cli.files import check_output, message, one_stdin, read_text, same_file, shown, write_outputs
from calibtool.cli.options import Force, Output, Seed, choice
from calibtool.cli.provenance import provenance
from calibtool.errors import UsageError


def import_(
    table: Annotated[str, typer.Argument(metavar="TABLE", help="A table with a header line; '-' is stdin.")],
    robot: Annotated[str, typer.Option(help="A robot of the catalogue, or a path.")],
    output: Output = "-",
    columns: Annotated[
        str | None, typer.Option(metavar="MAP.toml", help="Which column is what; without it the header's names tell.")
    ] = None,
    frame: Annotated[
        str | None,
        typer.Option(metavar="base|unknown", help="Frame of the measured values (default: the map's, or unknown)."),
    ] = None,
    robot_targets: Annotated[
        bool, typer.Option("--robot-targets", help="The targets stand where the robot's description says.")
    ] = False,
    rows: Annotated[
        str | None, typer.Option(metavar="A:B", help="Only data rows A to B, from 1, both included.")
    ] = None,
    sample: Annotated[int | None, typer.Option(min=1, help="A random sample of so many rows.")] = None,
    rest: Annotated[
        str | None, typer.Option(metavar="FILE", help="Write the rows that were not taken here, for a fair test.")
    ] = None,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Bring in an instrument's table.

    Three targets, one target (position only) or 6-D poses; an unknown instrument frame and unknown targets are estimated.

    Example: calibtool import tracker.csv --robot ur10 --columns map.toml -o measurements.h5
    """
    check_output(output, force, binary=True)
    if rest is not None:
        check_output(rest, force, binary=True)
        if same_file(rest, output):
            raise UsageError(f"--rest and -o are the same, {rest}")
    one_stdin(table, columns)
    from dataclasses import replace
    from typing import Literal, cast

    from calibtool.measurement.checks import check_measurements
    from calibtool.measurement.importing import import_table, parse_column_map, select_rows
    from calibtool.robot.catalogue import load_robot
    from calibtool.storage import to_bytes

    if frame is not None:
        choice(frame, ("base", "unknown"), "--frame")
    text = read_text(table)
    inputs = {"table": text.encode()}
    column_map = None
    if columns is not None:
        map_text = read_text(columns)
        inputs["columns"] = map_text.encode()
        column_map = parse_column_map(map_text, shown(columns))
    measurements, warnings = import_table(
        text,
        shown(table),
        load_robot(robot),
        column_map,
        frame=cast(Literal["base", "unknown"] | None, frame),
        robot_targets=robot_targets,
    )
    for warning in warnings:
        message(f"warning: {warning}")
    for finding in check_measurements(measurements):
        message(str(finding))
    taken, left = select_rows(measurements, rows, sample, seed)
    if rest is not None and not len(left):
        raise UsageError("--rest: no row is left; take fewer with --sample or --rows")
    origin = provenance(seed if sample is not None else None, **inputs)
    outputs: dict[str, bytes | str] = {output: to_bytes(replace(taken, provenance=origin))}
    if rest is not None:
        outputs[rest] = to_bytes(replace(left, provenance=origin))
    write_outputs(outputs, force)
