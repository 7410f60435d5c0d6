"""calibtool export: the compensator for other programs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.files import STREAM, check_output, message, write_output, write_outputs
from calibtool.cli.input_files import load_calibration
from calibtool.cli.options import (
    CalibrationFile,
    Force,
    FrameOption,
    JointValuesOption,
    Output,
    PayloadKg,
    TemperatureC,
    choice,
    joint_values_of,
    under,
)
from calibtool.errors import UsageError

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.export.rendering import Precision
    from calibtool.robot.coupling import JointValues

FORMATS = ("json", "c", "st", "onnx", "urdf")
# What each format calls its precisions, double first.
PRECISIONS = {"c": ("double", "float"), "st": ("LREAL", "REAL"), "onnx": ("double", "float")}


def export(
    calibration: CalibrationFile,
    format: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="json|c|st|onnx|urdf",
            help="json (complete), c (C99 and header), st (IEC 61131-3), onnx (network), "
            "urdf (geometry).",
        ),
    ],
    precision: Annotated[
        str | None,
        typer.Option(
            "--precision",
            metavar="double|float",
            help="c, onnx: double or float; st: LREAL or REAL.",
        ),
    ] = None,
    payload_kg: PayloadKg = None,
    temperature_c: TemperatureC = None,
    frame: FrameOption = None,
    joint_values: JointValuesOption = None,
    output: Output = "-",
    force: Force = False,
) -> None:
    """Write the compensator as JSON, C, Structured Text, ONNX or URDF.

    For C, -o NAME.c also writes NAME.h; NAME starts every symbol, and names the function block of
    NAME.st. A calibration with payload or temperature is written for those of the options.
    What a URDF cannot hold is listed on stderr. docs/export.md describes each format.

    Example: calibtool export calibration.h5 --format c -o compensator.c
    """
    choice(format, FORMATS, "--format")
    chosen, values = _precision(format, precision), joint_values_of(joint_values)
    if format == "urdf":
        if values == "controller":
            raise UsageError(
                "--joint-values: a URDF's joints are the serial chain's; leave the option out"
            )
        values = "serial"
    check_output(output, force, binary=format == "onnx")
    stem = "calibtool" if output == STREAM else Path(output).stem
    loaded = under(load_calibration(calibration, frame)[0], payload_kg, temperature_c)
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
        from calibtool.export.as_urdf import calibration_as_urdf
        from calibtool.robot.coupling import coupling_text

        contents, missing = calibration_as_urdf(loaded)
        if loaded.robot.coupled:
            differing = coupling_text(loaded.robot.coupling)
            message(f"the joints of the URDF are the serial chain's: {differing}")
        for line in missing:
            message(f"not in the URDF: {line}")
    write_output(output, contents, force)


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
    header_path = str(Path(output).with_suffix(".h"))
    check_output(header_path, force)
    values = calibration.robot.joint_values(calibration.robot.name, values)
    header, source = calibration_as_c(calibration, prefix, precision, values)
    write_outputs({header_path: header, output: source}, force)


def _precision(format: str, name: str | None) -> "Precision":
    if name is None:
        return "double"
    if format not in PRECISIONS:
        raise UsageError(f"--precision: {format} holds every number as it is; leave the option out")
    names = PRECISIONS[format]
    return "double" if choice(name, names, "--precision") == names[0] else "single"
