"""calibtool view: the arm and its errors in a browser."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.files import check_output, message, read_bytes, shown, write_output, wrote
from calibtool.cli.input_files import in_frame
from calibtool.cli.interrupts import interruptible
from calibtool.cli.options import Force, FrameOption, finite
from calibtool.errors import InputError, UsageError
from calibtool.units import count_of

if TYPE_CHECKING:
    import pinocchio as pin

    from calibtool.robot.robot import Robot


def view(
    file: Annotated[
        str,
        typer.Argument(
            metavar="CALIBRATION|MEASUREMENTS", help="A file of calibtool; '-' is stdin."
        ),
    ],
    html: Annotated[
        str | None,
        typer.Option(
            "--html", metavar="FILE", help="Write a page that needs nothing else, and end."
        ),
    ] = None,
    magnify: Annotated[
        float | None,
        typer.Option(min=0, help="Factor on the errors (default: a round one that shows them)."),
    ] = None,
    meshes: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FOLDER",
            help="Where meshes of the robot's URDF lie; nothing outside is read. Repeatable.",
        ),
    ] = None,
    frame: FrameOption = None,
    port: Annotated[
        int, typer.Option(min=1, max=65535, help="Port of the live view on this machine.")
    ] = 8080,
    force: Force = False,
) -> None:
    """Show the arm, its targets and their errors in 3-D.

    Measurements: targets of the nominal robot and the measured ones. A calibration: targets of the
    nominal robot and of the calibrated one. The live view needs the extra 'view', answers browsers
    of this machine only, and ends on Ctrl-C. --html writes a page that needs nothing else.

    The arm has the meshes of its URDF where they are found, such as those of example-robot-data,
    and simple solids otherwise.

    Example: calibtool view measurements.h5 --html view.html
    """
    if html is not None:
        check_output(html, force, suffixes=(".html", ".htm"))
    folders = [Path(folder) for folder in meshes or []]
    import io

    from calibtool.evaluation.view.scene import scene_of
    from calibtool.evaluation.view.scene_page import page_of
    from calibtool.storage import read_any
    from calibtool.unfinished_files import temporary_folder

    for folder in folders:
        if not folder.is_dir():
            raise UsageError(f"--meshes: {folder}: no such folder")
    if magnify is not None:
        finite(magnify, "--magnify")
    contents = read_any(io.BytesIO(read_bytes(file)), shown(file))
    if frame is not None:
        contents = in_frame(contents, frame, shown(file))
    scene = scene_of(contents)
    factor = scene.fitting_factor if magnify is None else magnify
    if html is not None:
        from calibtool.evaluation.view.solids import solids

        with temporary_folder() as copies:
            pieces = solids(scene, _shape(scene.robot, folders, copies))
        write_output(html, page_of(scene, factor, pieces), force)
        wrote(html, f"{count_of(len(scene), 'configuration')}, errors × {factor:g}")
        return
    from contextlib import suppress
    from threading import Event

    from calibtool.evaluation.view.live import serving

    with (
        suppress(KeyboardInterrupt),
        interruptible(),
        temporary_folder() as copies,
        serving(scene, _shape(scene.robot, folders, copies), factor, port),
    ):
        message(
            f"http://127.0.0.1:{port} shows {shown(file)}, errors × {factor:g}, to this machine "
            "alone; Ctrl-C ends it"
        )
        Event().wait()


def _shape(robot: "Robot", folders: list[Path], copies: Path) -> "pin.GeometryModel":
    """The visual geometry of the URDF; simple solids, with the reason, where it is not
    available."""
    from calibtool.evaluation.view.arm_geometry import described_shape, mesh_folders, simple_shape

    if robot.chain.tree is not None:  # meshes are placed along serial chains
        return simple_shape(robot)
    try:
        described = described_shape(robot, mesh_folders(robot, folders), copies)
    except InputError as error:
        message(f"{error}; the arm is shown as simple solids")
        return simple_shape(robot)
    return described if described.ngeoms else simple_shape(robot)
