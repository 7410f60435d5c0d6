"""The scene live in a browser: the arm by Pinocchio's ViserVisualizer, the rest by viser."""

import contextlib
import io
import socket
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from calibtool.errors import UsageError
from calibtool.evaluation.view.local_server import local_server
from calibtool.evaluation.view.scene import Scene
from calibtool.robot.se3 import Array

if TYPE_CHECKING:
    from pinocchio.visualize import ViserVisualizer
    from viser import ViserServer

_HOST = "127.0.0.1"
_NOMINAL, _FOUND = (0, 114, 178), (213, 94, 0)
_SMALL = 1e-3  # m: smallest size in which a scene is drawn


@contextlib.contextmanager
def serving(
    scene: Scene, shape: pin.GeometryModel, magnify: float, port: int
) -> Iterator["ViserVisualizer"]:
    """A server that shows the scene inside the block, with a slider for the configuration and
    the magnification.

    shape: visual geometry of the arm, on the joints of the robot's chain. Its `viewer` is the
    server. It answers browsers of this machine only (`local_server`).
    UsageError without viser or a Pinocchio that knows it, or when the port is taken.
    """
    visualizer = _visualizer(scene, shape)
    _check_free(_HOST, port)
    size = max(scene.extent, _SMALL)
    with contextlib.redirect_stdout(io.StringIO()):  # viser prints to stdout, which is for data
        server = local_server(_HOST, port, f"calibtool: {scene.robot.name}")
        visualizer.initViewer(viewer=server)
        visualizer.loadViewerModel("arm", frame_axis_length=size / 20, frame_axis_radius=size / 600)
    server.scene.set_up_direction("+z")
    server.scene.add_frame("/base", axes_length=size / 12, axes_radius=size / 400)
    server.scene.add_grid("/floor", width=2 * size, height=2 * size, cell_size=size / 10)
    _look_at(server, scene)
    chosen = server.gui.add_slider("configuration", 1, max(len(scene), 2), 1, 1)
    factor = server.gui.add_number("errors ×", magnify, min=0.0)
    everywhere = server.gui.add_checkbox("all configurations", True)
    description = server.gui.add_markdown("")

    def draw(_: Any = None) -> None:
        now = min(int(chosen.value), len(scene)) - 1
        visualizer.display(scene.robot.mechanism.configuration(scene.q[now : now + 1])[0])
        found = scene.magnified(float(factor.value))
        flange = np.broadcast_to(scene.arm[now, -1], scene.nominal[now].shape)
        _lines(server, "/tool", np.stack([flange, scene.nominal[now]], axis=1), _NOMINAL, 2.0)
        _pairs(server, "now", scene.nominal[now], found[now], size / 120)
        rest = (
            np.arange(len(scene)) != now if everywhere.value else np.zeros(len(scene), dtype=bool)
        )
        _pairs(server, "all", scene.nominal[rest], found[rest], size / 300)
        description.content = (
            f"**{scene.error_rms[now] * 1e3:.3f} mm** off here, "
            f"{np.median(scene.error_rms) * 1e3:.3f} mm "
            f"in the median; blue: nominal, orange: {scene.meaning}"
        )

    for control in (chosen, factor, everywhere):
        control.on_update(draw)
    draw()
    try:
        yield visualizer
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def _visualizer(scene: Scene, shape: pin.GeometryModel) -> "ViserVisualizer":
    try:
        import viser  # noqa: F401  (Pinocchio's message names another remedy)
        from pinocchio.visualize import ViserVisualizer
    except ImportError:
        raise UsageError(
            "view needs viser; run: pip install 'calibtool[view]' (or write a page with --html)"
        ) from None
    return ViserVisualizer(scene.robot.chain.model, pin.GeometryModel(), shape)


def _look_at(server: "ViserServer", scene: Scene) -> None:
    """Camera in front and above, looking at the middle of the targets."""
    points = scene.arm.reshape(-1, 3)
    middle, far = (points.min(axis=0) + points.max(axis=0)) / 2, 1.1 * max(scene.extent, _SMALL)
    server.initial_camera.look_at = tuple(middle)
    server.initial_camera.position = tuple(middle + far * np.array([0.75, -0.75, 0.45]))


def _pairs(server: "ViserServer", name: str, nominal: Array, found: Array, width: float) -> None:
    """Nominal and found targets and the lines between them, without unseen targets."""
    seen = ~np.isnan(found[..., 0])
    _lines(server, f"/errors/{name}", np.stack([nominal[seen], found[seen]], axis=1), _FOUND, 3.0)
    for kind, points, colour in (
        ("nominal", nominal[seen], _NOMINAL),
        ("found", found[seen], _FOUND),
    ):
        server.scene.add_point_cloud(
            f"/{kind}/{name}",
            points.astype(np.float32),
            colour,
            point_size=width,
            point_shape="circle",
            precision="float32",
        )


def _lines(
    server: "ViserServer", name: str, segments: Array, colour: tuple[int, int, int], width: float
) -> None:
    """Segments (k, 2, 3), `width` pixels wide."""
    segments = segments.astype(np.float32)
    server.scene.add_line_segments(
        name, segments, colour, thickness=width, thickness_units="screen"
    )


def _check_free(host: str, port: int) -> None:
    """UsageError for a port in use: viser would silently take the next free one."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise UsageError(
                f"--port {port}: {error.strerror or error}; choose another one"
            ) from None
