"""calibtool export: the compensator for other programs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.calibration_options import CalibrationOptions
from calibtool.cli.files import STREAM, check_output, message, write_output, write_outputs, wrote
from calibtool.cli.options import (
    CalibrationFile,
    Force,
    JointValuesOption,
    Output,
    choice,
    joint_values_of,
)
from calibtool.errors import UsageError

GEOMETRIES = ("urdf", "ros2-urdf", "dh", "mdh", "ur-yaml", "offsets", "kuka-machine")

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.export.rendering import Precision
    from calibtool.robot.coupling import JointValues
    from calibtool.robot.denavit_hartenberg import DhConvention

FORMATS = ("json", "c", "st", "onnx", *GEOMETRIES)
# Formats by the suffix of the output; .csv is ambiguous.
SUFFIXES = {
    ".json": "json",
    ".c": "c",
    ".st": "st",
    ".onnx": "onnx",
    ".urdf": "urdf",
    ".yaml": "ur-yaml",
    ".yml": "ur-yaml",
    ".dat": "kuka-machine",
}
# Names of the precisions of each format, double first.
PRECISIONS = {"c": ("double", "float"), "st": ("LREAL", "REAL"), "onnx": ("double", "float")}


def export(
    *,
    calibration: CalibrationFile,
    format: Annotated[
        str | None,
        typer.Option(
            "--format",
            metavar="json|c|st|onnx|urdf|ros2-urdf|dh|mdh|ur-yaml|offsets|kuka-machine",
            help="json (complete), c (C99 and header), st (IEC 61131-3), onnx (network); geometry "
            "alone: urdf, ros2-urdf, dh, mdh, ur-yaml, offsets, kuka-machine (default: the "
            "suffix of -o tells).",
        ),
    ] = None,
    precision: Annotated[
        str | None,
        typer.Option(
            "--precision",
            metavar="double|float",
            help="c, onnx: double or float; st: LREAL or REAL.",
        ),
    ] = None,
    prefix: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="c, st: what symbols begin with (default: the output's name)."
        ),
    ] = None,
    conditions: CalibrationOptions,
    joint_values: JointValuesOption = None,
    output: Output = "-",
    force: Force = False,
) -> None:
    """Write a calibration as code or as a robot model.

    Code: C99 (-o NAME.c also writes NAME.h) or Structured Text; NAME, or --prefix, starts every
    symbol. It is written for one payload and one temperature. Data: JSON has the complete
    calibration, ONNX the network.

    Robot models hold the geometry alone, fitted to the calibrated robot: URDF, tables of DH
    parameters (dh: standard, mdh: modified), the calibration.yaml of a UR arm, joint offsets, or
    machine data of a KUKA arm. What a format cannot hold is listed on stderr and in the file.
    docs/export.md describes each format.

    Example: calibtool export calibration.h5 --format c -o compensator.c
    """
    format = _format(format, output)
    chosen, values = _precision(format, precision), joint_values_of(joint_values)
    if prefix is not None and format not in ("c", "st"):
        raise UsageError(f"--prefix names symbols of c and st; leave it out for {format}")
    if format in GEOMETRIES and format != "offsets":
        if values == "controller":
            what = "a URDF's" if "urdf" in format else f"the {format}'s"
            raise UsageError(
                f"--joint-values: {what} joints are the serial chain's; leave the option out"
            )
        values = "serial"
    check_output(output, force, binary=format == "onnx")
    stem = prefix or ("calibtool" if output == STREAM else Path(output).stem)
    loaded = conditions.load(calibration)
    if format not in GEOMETRIES:
        from calibtool.export.rendering import left_out

        if dropped := left_out(loaded):
            message(f"warning: left out: {dropped}")
    if format == "c":
        _export_c(loaded, stem, chosen, values, output, force)
        return
    contents: bytes | str
    values = loaded.robot.joint_values(loaded.robot.name, values)
    if format == "json":
        from calibtool.export.as_json import calibration_as_json

        contents = calibration_as_json(loaded, values)
    elif format == "st":
        from calibtool.export.structured_text import calibration_as_structured_text

        contents = calibration_as_structured_text(loaded, stem, chosen, values)
    elif format == "onnx":
        from calibtool.export.as_onnx import calibration_as_onnx

        contents = calibration_as_onnx(loaded, chosen, values)
    else:
        contents = _geometry(loaded, format, values)
    write_output(output, contents, force)
    wrote(output, f"{format} format, {loaded.robot.name}")


def _format(given: str | None, output: str) -> str:
    """--format, or the format by the suffix of the output."""
    if given is not None:
        return choice(given, FORMATS, "--format")
    found = SUFFIXES.get(Path(output).suffix.lower())
    if found is None:
        raise UsageError(
            f"the suffix of the output '{output}' names no format; give --format "
            f"{', '.join(FORMATS)}"
        )
    return found


def _geometry(calibration: "Calibration", format: str, values: "JointValues") -> str:
    """The text of a geometry, with a line on stderr for each part that it cannot hold."""
    from calibtool.robot.coupling import coupling_text

    robot = calibration.robot
    what = "URDF" if "urdf" in format else format
    if format in ("urdf", "ros2-urdf"):
        from calibtool.export.as_urdf import calibration_as_urdf

        contents, missing = calibration_as_urdf(calibration, comments=format == "urdf")
    elif format in ("dh", "mdh"):
        from calibtool.export.as_dh import calibration_as_dh

        convention: DhConvention = "standard" if format == "dh" else "modified"
        contents, missing = calibration_as_dh(calibration, convention)
    elif format == "ur-yaml":
        from calibtool.export.as_ur_yaml import calibration_as_ur_yaml

        contents, missing = calibration_as_ur_yaml(calibration)
    elif format == "kuka-machine":
        from calibtool.export.as_kuka_machine import calibration_as_kuka_machine

        contents, missing = calibration_as_kuka_machine(calibration)
    else:
        from calibtool.export.as_offsets import calibration_as_offsets

        contents, missing = calibration_as_offsets(calibration, values)
    if robot.coupled and format != "offsets":
        differing = coupling_text(robot.coupling)
        message(f"the joints of the {what} are the serial chain's: {differing}")
    for line in missing:
        message(f"not in the {what}: {line}")
    return contents


def _export_c(
    calibration: "Calibration",
    prefix: str,
    precision: "Precision",
    values: "JointValues | None",
    output: str,
    force: bool,
) -> None:
    from calibtool.export.c_code import calibration_as_c

    if Path(output).suffix != ".c":
        raise UsageError("--format c: -o takes a file that ends in .c; the header goes beside it")
    header_path = Path(output).with_suffix(".h")
    check_output(str(header_path), force)
    values = calibration.robot.joint_values(calibration.robot.name, values)
    header, source = calibration_as_c(calibration, prefix, precision, values, header_path.name)
    write_outputs({str(header_path): header, output: source}, force)
    wrote(output, f"C99 compensator of {calibration.robot.name}; its header is {header_path}")


def _precision(format: str, name: str | None) -> "Precision":
    if name is None:
        return "double"
    if format not in PRECISIONS:
        raise UsageError(f"--precision: {format} holds every number as it is; leave the option out")
    names = PRECISIONS[format]
    return "double" if choice(name, names, "--precision") == names[0] else "single"
