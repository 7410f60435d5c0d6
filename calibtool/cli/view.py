"""calibtool view: the arm and its errors in a browser."""

from typing import Annotated

import typer

from calibtool.cli.files import check_output, message, read_bytes, shown, write_output
from calibtool.cli.interrupts import interruptible
from calibtool.cli.options import Force


def view(
    file: Annotated[str, typer.Argument(metavar="CALIBRATION|MEASUREMENTS", help="A file of calibtool; '-' is stdin.")],
    html: Annotated[
        str | None, typer.Option("--html", metavar="FILE", help="Write a page that needs nothing else, and end.")
    ] = None,
    magnify: Annotated[
        float | None, typer.Option(min=0, help="Factor on the errors (default: a round one that shows them).")
    ] = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the live view on this machine.")] = 8080,
    force: Force = False,
) -> None:
    """Show the arm, its targets and their errors.

    Measurements: targets of the nominal robot and the measured ones. A calibration: those of the nominal robot and where
    the calibration says they are. The live view needs the extra 'view' and ends on Ctrl-C; a page of --html needs nothing.

    Example: calibtool view measurements.h5 --html view.html
    """
    if html is not None:
        check_output(html, force)
    import io
    from math import isfinite

    from calibtool.errors import UsageError
    from calibtool.evaluation.view.page import page_of
    from calibtool.evaluation.view.scene import scene_of
    from calibtool.storage import read_any

    if magnify is not None and not isfinite(magnify):
        raise UsageError(f"--magnify: {magnify} is no finite number")
    scene = scene_of(read_any(io.BytesIO(read_bytes(file)), shown(file)))
    factor = scene.fitting_factor if magnify is None else magnify
    if html is not None:
        write_output(html, page_of(scene, factor), force)
        return
    from contextlib import suppress
    from threading import Event

    from calibtool.evaluation.view.live import serving

    with suppress(KeyboardInterrupt), interruptible(), serving(scene, factor, port):
        message(f"http://127.0.0.1:{port} shows {shown(file)}, errors × {factor:g}; Ctrl-C ends it")
        Event().wait()
