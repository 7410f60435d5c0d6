"""calibtool import: files of instruments to measurements."""

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from calibtool.cli.files import (
    HDF5,
    check_output,
    message,
    one_stdin,
    read_bytes,
    read_text,
    same_file,
    shown,
    write_output,
    write_outputs,
    write_stdout,
    wrote,
)
from calibtool.cli.import_images import ImageOptions, import_folder
from calibtool.cli.import_options import (
    chosen,
    findings_of,
    in_one_frame,
    offset_of,
    second_arm_of,
    stated_of,
)
from calibtool.cli.input_files import load_described, measurements_words
from calibtool.cli.options import (
    AllowOption,
    Force,
    JointValuesOption,
    Output,
    Seed,
    ToolOption,
    choice,
    joint_values_of,
)
from calibtool.cli.progress import working
from calibtool.cli.provenance import provenance
from calibtool.errors import InputError, NoSolutionError, UsageError


def import_(
    table: Annotated[
        str,
        typer.Argument(
            metavar="TABLE",
            help="A table with a header, SpatialAnalyzer points, .xlsx, a ROS bag, a folder of "
            "images; '-' is stdin.",
        ),
    ],
    robot: Annotated[str, typer.Option(help="A built-in robot, or the path of a description.")],
    output: Output = "-",
    columns: Annotated[
        str | None,
        typer.Option(
            metavar="MAP.toml", help="Which column is what; without it the header's names tell."
        ),
    ] = None,
    frame: Annotated[
        str | None,
        typer.Option(
            metavar="base|unknown",
            help="Frame of the measured values (default: the map's, or unknown).",
        ),
    ] = None,
    poses_of: Annotated[
        str,
        typer.Option(
            metavar="sensor|board",
            help="The poses are those of a sensor on the tool, or of a fixed board in a camera on "
            "the tool.",
        ),
    ] = "sensor",
    board: Annotated[
        str | None,
        typer.Option(metavar="BOARD.toml", help="Of images: the board that they show."),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="tool|beside",
            help="Of images: the camera is on the tool (default), or beside the arm with the board "
            "on the tool.",
        ),
    ] = None,
    intrinsics: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Of images: the camera's, as ROS or OpenCV write them (default: calibrated from "
            "the images).",
        ),
    ] = None,
    picture: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.png",
            help="Of images: draw the corners found and their reprojection errors.",
        ),
    ] = None,
    second_arm: Annotated[
        str | None,
        typer.Option(
            metavar="ROBOT",
            help="The points are those of a sensor on this arm, or on that of a calibration.h5; "
            "its joints: second_j1_deg …",
        ),
    ] = None,
    robot_targets: Annotated[
        bool,
        typer.Option("--robot-targets", help="The targets are where the robot's description says."),
    ] = False,
    joints: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="The joint values' own file, where TABLE has none."),
    ] = None,
    commanded: Annotated[
        str | None,
        typer.Option(
            metavar="TARGETS",
            help="Measured while the arm was driven to corrected joints: what went into "
            "compensate.",
        ),
    ] = None,
    join: Annotated[
        str,
        typer.Option(
            metavar="index|name|time",
            help="How rows of --joints find theirs: row order, name, time stamp; --commanded: row "
            "order or name.",
        ),
    ] = "index",
    join_tolerance_s: Annotated[
        float,
        typer.Option(min=0, help="Time stamps further apart than this do not belong together."),
    ] = 0.1,
    clock_offset: Annotated[
        str | None,
        typer.Option(
            metavar="SECONDS|auto",
            help="Added to the stamps of TABLE, for --join time with a moving arm; auto: found.",
        ),
    ] = None,
    use_references: Annotated[
        bool,
        typer.Option(
            "--use-references",
            help="Bring the rows back into one frame by the reference points (ref1_x_mm …), where "
            "these say more than their noise.",
        ),
    ] = False,
    references: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="The same by readings in FILE: time_s or row (rows measured before), ref1_x_mm …",
        ),
    ] = None,
    topics: Annotated[
        str | None,
        typer.Option(
            metavar="JOINTS,MEASURED", help="Of a ROS bag: its topics, where there are several."
        ),
    ] = None,
    format: Annotated[
        str | None,
        typer.Option(
            metavar="table|spatial-analyzer|excel",
            help="Format of TABLE (default: its contents tell).",
        ),
    ] = None,
    sheet: Annotated[
        str | None, typer.Option(metavar="NAME", help="Sheet of a workbook (default: the first).")
    ] = None,
    layout: Annotated[
        str | None,
        typer.Option(
            metavar="names|groups|order|single|targets",
            help="What the names of SpatialAnalyzer points mean (docs/file-formats.md).",
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(metavar="mm|m|in", help="Unit of lengths where the header does not state it."),
    ] = None,
    angle_unit: Annotated[
        str | None,
        typer.Option(metavar="deg|rad", help="Unit of angles where the header does not state it."),
    ] = None,
    convention: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Of three angles: intrinsic-xyz, extrinsic-zyx, … (any axes), zyx, "
            "rotation-vector.",
        ),
    ] = None,
    tool: ToolOption = None,
    allow: AllowOption = None,
    encoding: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Of text files: utf-8, utf-16, cp1252 … (default: found)."
        ),
    ] = None,
    joint_values: JointValuesOption = None,
    rows: Annotated[
        str | None,
        typer.Option(metavar="A:B", help="Only data rows A to B, from 1, both included."),
    ] = None,
    sample: Annotated[
        int | None, typer.Option(min=1, help="A random sample of so many rows.")
    ] = None,
    rest: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="Write the rows that were not taken here, for a fair test."
        ),
    ] = None,
    seed: Seed = 0,
    accept_misfit: Annotated[
        bool,
        typer.Option(
            "--accept-misfit", help="Take in points that the robot, or any mistake tried, misses."
        ),
    ] = False,
    map_template: Annotated[
        bool,
        typer.Option(
            "--map-template",
            help="Write a column map made from the header instead, to be completed by hand.",
        ),
    ] = False,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run", help="Show how the table is understood on stdout and write nothing."
        ),
    ] = False,
    force: Force = False,
) -> None:
    """Import measurements (CSV, Excel, SpatialAnalyzer, …).

    Three targets, one target (position only) or 6-D poses. An unknown instrument frame and unknown
    targets are estimated from the imported rows. Begin with --dry-run.

    Measured after a correction: the joints, in TABLE or --joints, are those that the arm was driven
    to, and --commanded TARGETS holds the joints or poses before correction. `evaluate` then
    compares measured with commanded points.

    Images: a folder with --board BOARD.toml and --joints FILE. The corners of the board are found
    with OpenCV (the extra `camera`); each image is a row, by its name or by order.

    Example: calibtool import tracker.csv --robot ur10 --columns map.toml -o measurements.h5
    """
    from calibtool.measurement.importing.ros_bags import is_bag, read_bag

    images = ImageOptions(board, camera, intrinsics, picture)
    if os.path.isdir(table) and not is_bag(table):
        import_folder(
            table,
            load_described(robot, tool, allow),
            output,
            images,
            joints,
            stated=stated_of(unit, angle_unit, convention),
            joint_values=joint_values_of(joint_values),
            encoding=encoding,
            others={
                "--columns": columns,
                "--commanded": commanded,
                "--clock-offset": clock_offset,
                "--use-references": use_references,
                "--references": references,
                "--format": format,
                "--rows": rows,
                "--sample": sample,
                "--rest": rest,
                "--map-template": map_template,
                "--dry-run": dry_run,
                "--robot-targets": robot_targets,
                "--second-arm": second_arm,
            },
            accept_misfit=accept_misfit,
            force=force,
        )
        return
    images.refuse(table)
    if not dry_run:
        check_output(output, force, binary=not map_template, suffixes=() if map_template else HDF5)
        if rest is not None:
            check_output(rest, force, binary=True, suffixes=HDF5)
            if same_file(rest, output):
                raise UsageError(f"--rest and -o are the same, {rest}")
    one_stdin(table, columns, joints, commanded, references)
    from dataclasses import replace

    from calibtool.measurement.checks import check_measurements
    from calibtool.measurement.importing import (
        CommandedFile,
        JointFile,
        parse_column_map,
        preview,
        read_table,
        template_of,
    )
    from calibtool.measurement.importing.joint_files import JOINS
    from calibtool.measurement.importing.sources import FORMATS
    from calibtool.measurement.importing.spatial_analyzer import LAYOUTS
    from calibtool.storage import to_bytes

    of_bag = is_bag(table)
    inputs = {} if of_bag else {"table": read_bytes(table)}
    column_map = joint_file = None
    if columns is not None:
        map_text = read_text(columns)
        inputs["columns"] = map_text.encode()
        column_map = parse_column_map(map_text, shown(columns))
    join_by = chosen(join, JOINS, "--join")
    if joints is not None:
        inputs["joints"] = read_bytes(joints)
        joint_file = JointFile(inputs["joints"], shown(joints), join_by, join_tolerance_s, encoding)
    elif join != "index" and not (join == "name" and commanded is not None):
        raise UsageError(f"--join {join}: there is no second file; give --joints FILE")
    commanded_file = None
    if commanded is not None:
        inputs["commanded"] = read_bytes(commanded)
        commanded_file = CommandedFile(inputs["commanded"], shown(commanded), join_by)
    if references is not None:
        inputs["references"] = read_bytes(references)
    model = load_described(robot, tool, allow)
    if of_bag:
        if joints is not None:
            raise UsageError(f"--joints {joints}: a bag holds the joints itself")
        bag = read_bag(Path(table), model, [] if topics is None else topics.split(","))
        inputs |= {"table": bag.measured.encode(), "joints": bag.joints.encode()}
        joint_file = JointFile(bag.joints, f"{table} (joints)", "time", join_tolerance_s)
        message(f"note: {bag.note}")
    elif topics is not None:
        raise UsageError(f"--topics: {shown(table)} is no ROS bag")
    stated = stated_of(unit, angle_unit, convention)
    how: dict[str, Any] = {
        "format": chosen(format, FORMATS, "--format"),
        "sheet": sheet,
        "layout": chosen(layout, LAYOUTS, "--layout"),
        "encoding": encoding,
    }
    if map_template:
        text = template_of(
            inputs["table"],
            shown(table),
            model,
            stated,
            joint_file,
            **how,
        )
        write_output(output, text, force)
        wrote(output, "column map, to be completed")
        return
    with working(f"reading {shown(table)}"):
        imported = read_table(
            inputs["table"],
            shown(table),
            model,
            column_map,
            frame=chosen(frame, ("base", "unknown"), "--frame"),
            robot_targets=robot_targets,
            stated=stated,
            joints=joint_file,
            joint_values=joint_values_of(joint_values),
            commanded=commanded_file,
            board=choice(poses_of, ("sensor", "board"), "--poses-of") == "board",
            second_arm=None if second_arm is None else second_arm_of(second_arm),
            **how,
        )
    imported, moved = in_one_frame(imported, use_references, references, inputs, stated)
    if clock_offset is not None:
        imported = imported.with_clock_offset(offset_of(imported, clock_offset))
    for note in imported.understood.remarks:
        message(f"note: {note}")
    for warning in imported.warnings:
        message(f"warning: {warning}")
    taken, left = imported.split(rows, sample, seed)
    if rest is not None and left is None:
        raise UsageError("--rest: no row is left; take fewer with --sample or --rows")
    if dry_run:
        write_stdout(preview(taken).encode())
        for finding in findings_of(taken):
            message(str(finding))
        return
    origin = provenance(seed if sample is not None else None, **inputs)
    with working(f"registering and checking {len(taken.measurements)} configurations"):
        try:
            measurements = taken.registered().measurements
        except NoSolutionError as error:
            found = check_measurements(taken.measurements)
            why = [f.message for f in found if f.severity == "warning"]
            raise NoSolutionError("; ".join([str(error), *why[:1]])) from None
        findings = check_measurements(measurements, taken.auxiliary, taken.stream)
    for finding in findings:
        if finding.name == "nominal_robot" and not accept_misfit:
            raise InputError(
                f"{shown(table)}: {finding.message}; --accept-misfit takes the file in all the same"
            )
        message(str(finding))
    warned = (finding.message for finding in findings if finding.severity == "warning")
    said = (*moved, *taken.warnings, *warned)
    measurements = replace(measurements, provenance=origin, findings=said)
    outputs: dict[str, bytes | str] = {output: to_bytes(measurements)}
    if rest is not None and left is not None:
        held_out = left.with_setup(measurements.setup).measurements
        outputs[rest] = to_bytes(replace(held_out, provenance=origin, findings=said))
    write_outputs(outputs, force)
    wrote(output, measurements_words(measurements))
    if rest is not None and left is not None:
        wrote(rest, measurements_words(held_out))
