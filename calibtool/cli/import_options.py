"""Options of calibtool import, in groups: the table, files beside it, the rows that are taken."""

from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Annotated, Any

import typer

from calibtool.cli.files import message, read_bytes, read_text, shown
from calibtool.cli.input_files import RobotOptions, load_calibration
from calibtool.cli.options import JointValuesOption, Seed, choice, joint_values_of
from calibtool.errors import NoSolutionError, UsageError

if TYPE_CHECKING:
    from calibtool.measurement.importing import (
        ColumnMap,
        CommandedFile,
        Imported,
        JointFile,
        SecondArm,
        Stated,
    )


@dataclass(frozen=True)
class TableOptions:
    """How a table is understood; None where its contents tell."""

    columns: Annotated[
        str | None,
        typer.Option(
            metavar="MAP.toml", help="Which column is what; without it the header's names tell."
        ),
    ] = None
    frame: Annotated[
        str | None,
        typer.Option(
            metavar="base|unknown",
            help="Frame of the measured values (default: the map's, or unknown).",
        ),
    ] = None
    poses_of: Annotated[
        str,
        typer.Option(
            metavar="sensor|board",
            help="The poses are those of a sensor on the tool, or of a fixed board in a camera on "
            "the tool.",
        ),
    ] = "sensor"
    second_arm: Annotated[
        str | None,
        typer.Option(
            metavar="ROBOT",
            help="The points are those of a sensor on this arm, or on that of a calibration.h5; "
            "its joints: second_j1_deg …",
        ),
    ] = None
    robot_targets: Annotated[
        bool,
        typer.Option("--robot-targets", help="The targets are where the robot's description says."),
    ] = False
    topics: Annotated[
        str | None,
        typer.Option(
            metavar="JOINTS,MEASURED", help="Of a ROS bag: its topics, where there are several."
        ),
    ] = None
    format: Annotated[
        str | None,
        typer.Option(
            metavar="table|spatial-analyzer|excel",
            help="Format of TABLE (default: its contents tell).",
        ),
    ] = None
    sheet: Annotated[
        str | None, typer.Option(metavar="NAME", help="Sheet of a workbook (default: the first).")
    ] = None
    layout: Annotated[
        str | None,
        typer.Option(
            metavar="names|groups|order|single|targets",
            help="What the names of SpatialAnalyzer points mean (docs/file-formats.md).",
        ),
    ] = None
    unit: Annotated[
        str | None,
        typer.Option(metavar="mm|m|in", help="Unit of lengths where the header does not state it."),
    ] = None
    angle_unit: Annotated[
        str | None,
        typer.Option(metavar="deg|rad", help="Unit of angles where the header does not state it."),
    ] = None
    convention: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Of three angles: intrinsic-xyz, extrinsic-zyx, … (any axes), zyx, "
            "rotation-vector.",
        ),
    ] = None
    encoding: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Of text files: utf-8, utf-16, cp1252 … (default: found)."
        ),
    ] = None
    joint_values: JointValuesOption = None

    def stated(self) -> "Stated":
        """Units and convention where a header does not state them."""
        from calibtool.measurement.importing import Stated

        return Stated(
            _chosen(self.unit, ("mm", "m", "in"), "--unit"),
            _chosen(self.angle_unit, ("deg", "rad"), "--angle-unit"),
            self.convention,
        )

    def layout_of_file(self) -> dict[str, Any]:
        """Format, sheet, layout and encoding of the file, as `read_table` takes them."""
        from calibtool.measurement.importing.sources import FORMATS
        from calibtool.measurement.importing.spatial_analyzer import LAYOUTS

        return {
            "format": _chosen(self.format, FORMATS, "--format"),
            "sheet": self.sheet,
            "layout": _chosen(self.layout, LAYOUTS, "--layout"),
            "encoding": self.encoding,
        }

    def meaning(self) -> dict[str, Any]:
        """What the columns are, as `read_table` takes it."""
        return {
            "frame": _chosen(self.frame, ("base", "unknown"), "--frame"),
            "robot_targets": self.robot_targets,
            "stated": self.stated(),
            "joint_values": joint_values_of(self.joint_values),
            "board": choice(self.poses_of, ("sensor", "board"), "--poses-of") == "board",
            "second_arm": None if self.second_arm is None else _second_arm(self.second_arm),
        }

    def column_map(self, inputs: dict[str, bytes]) -> "ColumnMap | None":
        """The map of --columns; its bytes are noted in `inputs`."""
        from calibtool.measurement.importing import parse_column_map

        if self.columns is None:
            return None
        text = read_text(self.columns)
        inputs["columns"] = text.encode()
        return parse_column_map(text, shown(self.columns))


@dataclass(frozen=True)
class OtherFiles:
    """Files beside the table, and how their rows belong to its rows."""

    joints: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="The joint values' own file, where TABLE has none."),
    ] = None
    commanded: Annotated[
        str | None,
        typer.Option(
            metavar="TARGETS",
            help="Measured while the arm was driven to corrected joints: what went into "
            "compensate.",
        ),
    ] = None
    join: Annotated[
        str,
        typer.Option(
            metavar="index|name|time",
            help="How rows of --joints find theirs: row order, name, time stamp; --commanded: row "
            "order or name.",
        ),
    ] = "index"
    join_tolerance_s: Annotated[
        float,
        typer.Option(min=0, help="Time stamps further apart than this do not belong together."),
    ] = 0.1
    clock_offset: Annotated[
        str | None,
        typer.Option(
            metavar="SECONDS|auto",
            help="Added to the stamps of TABLE, for --join time with a moving arm; auto: found.",
        ),
    ] = None
    use_references: Annotated[
        bool,
        typer.Option(
            "--use-references",
            help="Bring the rows back into one frame by the reference points (ref1_x_mm …), where "
            "these say more than their noise.",
        ),
    ] = False
    references: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="The same by readings in FILE: time_s or row (rows measured before), ref1_x_mm …",
        ),
    ] = None

    def read(
        self, inputs: dict[str, bytes], encoding: str | None
    ) -> "tuple[JointFile | None, CommandedFile | None]":
        """The files of joints and of targets; the bytes of every file are noted in `inputs`."""
        from calibtool.measurement.importing import CommandedFile, JointFile
        from calibtool.measurement.importing.joint_files import JOINS

        join: Any = choice(self.join, JOINS, "--join")
        joints = commanded = None
        if self.joints is not None:
            inputs["joints"] = read_bytes(self.joints)
            name = shown(self.joints)
            joints = JointFile(inputs["joints"], name, join, self.join_tolerance_s, encoding)
        elif join != "index" and not (join == "name" and self.commanded is not None):
            raise UsageError(f"--join {join}: there is no second file; give --joints FILE")
        if self.commanded is not None:
            inputs["commanded"] = read_bytes(self.commanded)
            commanded = CommandedFile(inputs["commanded"], shown(self.commanded), join)
        if self.references is not None:
            inputs["references"] = read_bytes(self.references)
        return joints, commanded

    def in_one_frame(
        self, imported: "Imported", inputs: dict[str, bytes], stated: "Stated"
    ) -> "tuple[Imported, list[str]]":
        """The rows in one frame by --use-references or --references; notes for the file."""
        if not self.use_references and self.references is None:
            return imported, []
        from calibtool.measurement.importing import undo_instrument_motion

        file = None
        if self.references is not None:
            file = (inputs["references"], shown(self.references))
        imported, notes, moved = undo_instrument_motion(imported, file, stated)
        for text in notes:
            message(f"note: {text}")
        return imported, notes if moved else []

    def at_clock_offset(self, imported: "Imported") -> "Imported":
        """The joints at the stamps plus --clock-offset."""
        if self.clock_offset is None:
            return imported
        return imported.with_clock_offset(_offset(imported, self.clock_offset))


@dataclass(frozen=True)
class RowOptions:
    """Which rows are taken, and where the others go."""

    rows: Annotated[
        str | None,
        typer.Option(metavar="A:B", help="Only data rows A to B, from 1, both included."),
    ] = None
    sample: Annotated[int | None, typer.Option(min=1, help="A random sample of so many rows.")] = (
        None
    )
    rest: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="Write the rows that were not taken here, for a fair test."
        ),
    ] = None
    seed: Seed = 0


def _chosen(value: str | None, allowed: tuple[str, ...], option: str) -> Any:
    """An allowed value, or None where the option was not given; UsageError otherwise."""
    return None if value is None else choice(value, allowed, option)


def _second_arm(name: str) -> "SecondArm":
    """A second arm: a nominal robot, or a calibrated one."""
    from calibtool.measurement.importing import SecondArm

    if name.endswith(".h5"):
        calibration, _ = load_calibration(name)
        return SecondArm(calibration.robot, calibration.forward)
    robot = RobotOptions().load(name)
    return SecondArm(robot, robot.mechanism.forward)


def _offset(imported: "Imported", text: str) -> float:
    """The offset of --clock-offset, s; with `auto` it is found from the motion, and reported."""
    from calibtool.measurement.checks.clocks import clock_offset

    if text == "auto":
        stream = imported.with_clock_offset(0.0).stream
        assert stream is not None
        found = clock_offset(imported.measurements.points_alone(), stream)
        if found is None:
            raise NoSolutionError(
                "--clock-offset auto: nothing tells it: the arm stands still, or the points do not "
                "fit the robot; state it in seconds"
            )
        message(f"note: clock offset {found.offset:+.5f} s, ± {found.error * 1e3:.2g} ms")
        return found.offset
    try:
        seconds = float(text)
    except ValueError:
        seconds = float("nan")
    if not isfinite(seconds):
        raise UsageError(f"--clock-offset: '{text}' is no number of seconds, nor auto")
    return seconds
