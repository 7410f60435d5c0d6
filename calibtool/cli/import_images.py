"""The part of calibtool import that reads a folder of images."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from calibtool.cli.files import (
    check_output,
    message,
    read_bytes,
    read_text,
    same_file,
    shown,
    write_outputs,
    wrote,
)
from calibtool.cli.import_options import TableOptions
from calibtool.cli.input_files import measurements_words
from calibtool.cli.options import choice, joint_values_of
from calibtool.cli.progress import counted, working
from calibtool.cli.provenance import provenance
from calibtool.errors import InputError, UsageError

if TYPE_CHECKING:
    from calibtool.robot.robot import Robot


@dataclass(frozen=True)
class ImageOptions:
    """The options of images alone; None where they were not given."""

    board: Annotated[
        str | None,
        typer.Option(metavar="BOARD.toml", help="Of images: the board that they show."),
    ] = None
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="tool|beside",
            help="Of images: the camera is on the tool (default), or beside the arm with the board "
            "on the tool.",
        ),
    ] = None
    intrinsics: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Of images: the camera's, as ROS or OpenCV write them (default: calibrated from "
            "the images).",
        ),
    ] = None
    picture: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.png",
            help="Of images: draw the corners found and their reprojection errors.",
        ),
    ] = None

    def refuse(self, table: str) -> None:
        """UsageError where one of them was given with a table."""
        for option, value in vars(self).items():
            if value is not None:
                raise UsageError(
                    f"--{option} belongs to a folder of images, {shown(table)} is none; poses of a "
                    "board in a camera: --poses-of board"
                )


def import_folder(
    folder: str,
    robot: "Robot",
    output: str,
    options: ImageOptions,
    tables: TableOptions,
    joints: str | None,
    accept_misfit: bool,
    force: bool,
) -> None:
    """Import the images of a folder, see `import_images`. tables: units and joint values."""
    if joints is None or options.board is None:
        missing = "--joints FILE" if joints is None else "--board BOARD.toml"
        raise UsageError(f"{folder}: a folder of images needs {missing}")
    check_output(output, force, binary=True)
    if options.picture is not None:
        check_output(options.picture, force, binary=True)
        if same_file(options.picture, output):
            raise UsageError(f"--picture and -o are the same, {output}")
    from calibtool.measurement.checks import check_measurements
    from calibtool.measurement.images.board_description import parse_board
    from calibtool.measurement.images.board_picture import picture
    from calibtool.measurement.images.image_import import Camera, images_in, import_images
    from calibtool.measurement.images.intrinsics_file import parse_intrinsics
    from calibtool.measurement.registration import register
    from calibtool.storage import to_bytes

    camera = choice(options.camera or "tool", ("tool", "beside"), "--camera")
    board_text = read_text(options.board)
    inputs = {"joints": read_bytes(joints), "board": board_text.encode()}
    lens = None
    if options.intrinsics is not None:
        lens_text = read_text(options.intrinsics)
        inputs["intrinsics"] = lens_text.encode()
        lens = parse_intrinsics(lens_text, shown(options.intrinsics))
    paths = images_in(Path(folder))
    imported = import_images(
        paths,
        inputs["joints"],
        shown(joints),
        robot,
        parse_board(board_text, shown(options.board)),
        camera=cast(Camera, camera),
        intrinsics=lens,
        stated=tables.stated(),
        joint_values=joint_values_of(tables.joint_values),
        encoding=tables.encoding,
        progress=counted,
    )
    for note in imported.notes:
        message(f"note: {note}")
    with working(f"registering and checking {len(imported.measurements)} images"):
        measurements = imported.measurements
        measurements = replace(measurements, setup=register(measurements))
        findings = [*imported.findings, *check_measurements(measurements)]
    for finding in findings:
        if finding.name == "nominal_robot" and not accept_misfit:
            raise InputError(
                f"{folder}: {finding.message}; --accept-misfit takes the images in all the same"
            )
        message(str(finding))
    inputs["images"] = "\n".join(f"{path.name} {_digest(path)}" for path in paths).encode()
    warnings = tuple(finding.message for finding in findings if finding.severity == "warning")
    measurements = replace(measurements, provenance=provenance(None, **inputs), findings=warnings)
    outputs: dict[str, bytes | str] = {output: to_bytes(measurements)}
    if options.picture is not None:
        lost = [path for path in paths if path not in imported.paths]
        outputs[options.picture] = picture(imported.paths, imported.pixels, imported.lens, lost)
    write_outputs(outputs, force)
    wrote(output, measurements_words(measurements))


def _digest(path: Path) -> str:
    from hashlib import sha256

    return sha256(path.read_bytes()).hexdigest()
