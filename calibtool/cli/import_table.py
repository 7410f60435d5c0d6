"""The part of calibtool import that reads a table, a workbook or a ROS bag."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibtool.cli.files import (
    HDF5,
    check_output,
    message,
    one_stdin,
    read_bytes,
    same_file,
    shown,
    write_output,
    write_outputs,
    write_stdout,
    wrote,
)
from calibtool.cli.import_options import OtherFiles, RowOptions, TableOptions
from calibtool.cli.input_files import RobotOptions, measurements_words
from calibtool.cli.progress import working
from calibtool.cli.provenance import provenance
from calibtool.errors import InputError, NoSolutionError, UsageError

if TYPE_CHECKING:
    from calibtool.measurement.checks.finding import Finding
    from calibtool.measurement.importing import Imported, JointFile
    from calibtool.measurement.measurements import Measurements
    from calibtool.robot.robot import Robot


def import_table(
    path: str,
    robot: str,
    described: RobotOptions,
    table: TableOptions,
    others: OtherFiles,
    selection: RowOptions,
    output: str,
    *,
    accept_misfit: bool,
    map_template: bool,
    dry_run: bool,
    force: bool,
) -> None:
    """Import the rows of a table; with `map_template` or `dry_run` show how it is understood."""
    if not dry_run:
        _check_outputs(output, selection.rest, map_template, force)
    one_stdin(path, table.columns, others.joints, others.commanded, others.references)
    from calibtool.measurement.importing import preview, read_table, template_of
    from calibtool.measurement.importing.ros_bags import is_bag

    inputs = {} if is_bag(path) else {"table": read_bytes(path)}
    column_map = table.column_map(inputs)
    joints, commanded = others.read(inputs, table.encoding)
    model = described.load(robot)
    if is_bag(path):
        joints = _joints_of_bag(path, model, table, others, inputs)
    elif table.topics is not None:
        raise UsageError(f"--topics: {shown(path)} is no ROS bag")
    stated, how = table.stated(), table.layout_of_file()
    if map_template:
        text = template_of(inputs["table"], shown(path), model, stated, joints, **how)
        write_output(output, text, force)
        wrote(output, "column map, to be completed")
        return
    with working(f"reading {shown(path)}"):
        imported = read_table(
            inputs["table"],
            shown(path),
            model,
            column_map,
            joints=joints,
            commanded=commanded,
            **table.meaning(),
            **how,
        )
    imported, moved = others.in_one_frame(imported, inputs, stated)
    imported = others.at_clock_offset(imported)
    for note in imported.understood.remarks:
        message(f"note: {note}")
    for warning in imported.warnings:
        message(f"warning: {warning}")
    taken, untaken = imported.split(selection.rows, selection.sample, selection.seed)
    if selection.rest is not None and untaken is None:
        raise UsageError("--rest: no row is left; take fewer with --sample or --rows")
    if dry_run:
        write_stdout(preview(taken).encode())
        with suppress(NoSolutionError):  # the preview says that the set-up cannot be registered
            for finding in _registered(taken)[1]:
                message(str(finding))
        return
    measurements, findings = _registered(taken)
    for finding in findings:
        if finding.name == "nominal_robot" and not accept_misfit:
            raise InputError(
                f"{shown(path)}: {finding.message}; --accept-misfit takes the file in all the same"
            )
        message(str(finding))
    warned = (finding.message for finding in findings if finding.severity == "warning")
    origin = provenance(None if selection.sample is None else selection.seed, **inputs)
    kept = {output: measurements}
    if selection.rest is not None and untaken is not None:
        kept[selection.rest] = untaken.with_setup(measurements.setup).measurements
    _write(kept, origin, (*moved, *taken.warnings, *warned), force)


def _check_outputs(output: str, rest: str | None, map_template: bool, force: bool) -> None:
    check_output(output, force, binary=not map_template, suffixes=() if map_template else HDF5)
    if rest is not None:
        check_output(rest, force, binary=True, suffixes=HDF5)
        if same_file(rest, output):
            raise UsageError(f"--rest and -o are the same, {rest}")


def _joints_of_bag(
    path: str, model: "Robot", table: TableOptions, others: OtherFiles, inputs: dict[str, bytes]
) -> "JointFile":
    """The joints of a ROS bag; its two tables are noted in `inputs`."""
    from calibtool.measurement.importing import JointFile
    from calibtool.measurement.importing.ros_bags import read_bag

    if others.joints is not None:
        raise UsageError(f"--joints {others.joints}: a bag holds the joints itself")
    bag = read_bag(Path(path), model, [] if table.topics is None else table.topics.split(","))
    inputs |= {"table": bag.measured.encode(), "joints": bag.joints.encode()}
    message(f"note: {bag.note}")
    return JointFile(bag.joints, f"{path} (joints)", "time", others.join_tolerance_s)


def _registered(taken: "Imported") -> "tuple[Measurements, list[Finding]]":
    """The measurements with their set-up registered, and what the checks on import find. Rows that
    these say do not belong to the others stay, and do not move the set-up.

    NoSolutionError with the first warning of the checks where the set-up cannot be registered.
    """
    from calibtool.measurement.checks import check_measurements, rows_off

    with working(f"registering and checking {len(taken.measurements)} configurations"):
        try:
            measurements = taken.registered().measurements
        except NoSolutionError as error:
            found = check_measurements(taken.measurements)
            why = [f.message for f in found if f.severity == "warning"]
            raise NoSolutionError("; ".join([str(error), *why[:1]])) from None
        findings = check_measurements(measurements, taken.auxiliary, taken.stream)
        if off := rows_off(findings):
            with suppress(NoSolutionError):  # they are needed
                measurements = taken.registered(off).measurements
        return measurements, findings


def _write(
    kept: "dict[str, Measurements]",
    origin: dict[str, str],
    findings: tuple[str, ...],
    force: bool,
) -> None:
    from calibtool.storage import to_bytes

    kept = {
        path: replace(each, provenance=origin, findings=findings) for path, each in kept.items()
    }
    write_outputs({path: to_bytes(each) for path, each in kept.items()}, force)
    for path, each in kept.items():
        wrote(path, measurements_words(each))
