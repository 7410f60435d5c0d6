"""calibtool import: files of instruments to measurements."""

import os
from typing import Annotated

import typer

from calibtool.cli.import_images import ImageOptions, import_folder
from calibtool.cli.import_options import OtherFiles, RowOptions, TableOptions
from calibtool.cli.import_table import import_table
from calibtool.cli.input_files import RobotOptions
from calibtool.cli.options import Force, Output
from calibtool.errors import UsageError


def import_(
    *,
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
    tables: TableOptions,
    images: ImageOptions,
    files: OtherFiles,
    selection: RowOptions,
    described: RobotOptions,
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
    from calibtool.measurement.importing.ros_bags import is_bag

    if os.path.isdir(table) and not is_bag(table):
        for option, value in {
            "--columns": tables.columns,
            "--commanded": files.commanded,
            "--clock-offset": files.clock_offset,
            "--use-references": files.use_references,
            "--references": files.references,
            "--format": tables.format,
            "--rows": selection.rows,
            "--sample": selection.sample,
            "--rest": selection.rest,
            "--map-template": map_template,
            "--dry-run": dry_run,
            "--robot-targets": tables.robot_targets,
            "--second-arm": tables.second_arm,
        }.items():
            if value:
                raise UsageError(f"{option} belongs to tables; {table} is a folder of images")
        model = described.load(robot)
        import_folder(table, model, output, images, tables, files.joints, accept_misfit, force)
        return
    images.refuse(table)
    import_table(
        table,
        robot,
        described,
        tables,
        files,
        selection,
        output,
        accept_misfit=accept_misfit,
        map_template=map_template,
        dry_run=dry_run,
        force=force,
    )
