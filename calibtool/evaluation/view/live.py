"""The scene live in a browser, by viser."""

import contextlib
import io
import socket
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from calibtool.errors import UsageError
from calibtool.evaluation.view.scene import Scene
from calibtool.robot.se3 import Array

if TYPE_CHECKING:
    from viser import ViserServer

_ARM, _NOMINAL, _FOUND = (119, 119, 119), (0, 114, 178), (213, 94, 0)


@contextlib.contextmanager
def serving(scene: Scene, magnify: float, port: int, host: str = "127.0.0.1") -> Iterator["ViserServer"]:
    """A server that shows the scene inside the block, with a slider for the configuration and the magnification.

    UsageError without viser, or when the port is taken.
    """
    try:
        import viser
    except ImportError:
        raise UsageError("view needs viser; run: pip install 'calibtool[view]' (or write a page with --html)") from None
    _check_free(host, port)
    with contextlib.redirect_stdout(io.StringIO()):  # viser greets and says goodbye where data belong
        server = viser.ViserServer(host=host, port=port, label=f"calibtool: {scene.robot}", verbose=False)
    server.scene.set_up_direction("+z")
    server.scene.add_frame("/base", axes_length=_size(scene) / 12, axes_radius=_size(scene) / 400)
    chosen = server.gui.add_slider("configuration", 1, max(len(scene), 2), 1, 1)
    factor = server.gui.add_number("errors ×", magnify, min=0.0)
    told = server.gui.add_markdown("")

    def draw(_: Any = None) -> None:
        now = min(int(chosen.value), len(scene)) - 1
        found, width = scene.magnified(float(factor.value)), _size(scene) / 300
        seen = ~np.isnan(found[..., 0])
        arm = scene.arm[now]
        tool = np.broadcast_to(arm[-1], scene.nominal[now].shape)
        _lines(server, "/arm", np.stack([arm[:-1], arm[1:]], axis=1), _ARM, 3 * width)
        _lines(server, "/flange", np.stack([tool, scene.nominal[now]], axis=1), _ARM, width)
        _lines(server, "/errors", np.stack([scene.nominal[seen], found[seen]], axis=1), _FOUND, width)
        for name, points, colour in (("/nominal", scene.nominal[seen], _NOMINAL), ("/found", found[seen], _FOUND)):
            server.scene.add_point_cloud(name, points.astype(np.float32), colour, point_size=2 * width)
        told.content = f"{scene.meaning}: error {scene.sizes[now] * 1e3:.3f} mm"

    chosen.on_update(draw)
    factor.on_update(draw)
    draw()
    try:
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def _size(scene: Scene) -> float:
    return float(max(np.ptp(scene.arm.reshape(-1, 3), axis=0).max(), 1e-3))


def _lines(server: "ViserServer", name: str, segments: Array, colour: tuple[int, int, int], width: float) -> None:
    server.scene.add_line_segments(name, segments.astype(np.float32), colour, thickness=width)


def _check_free(host: str, port: int) -> None:
    """viser takes the next free port without a word; a port that was asked for is meant."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise UsageError(f"--port {port}: {error.strerror or error}; choose another one") from None
