"""The scene, its page and its server: what is shown is where the targets are."""

import json
import re
import socket
import sys
import urllib.request
from dataclasses import replace

import numpy as np
import pytest

from calibtool.calibration import Calibration
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import UsageError
from calibtool.evaluation.view.arm_geometry import simple_shape
from calibtool.evaluation.view.live import serving
from calibtool.evaluation.view.scene import scene_of
from calibtool.evaluation.view.scene_page import page_of
from calibtool.evaluation.view.solids import _simplified, solids
from calibtool.measurement.measurements import Measurements
from calibtool.robot.robot import Robot


def unseen_first(measurements: Measurements) -> Measurements:
    points = measurements.points.copy()
    points[0, 0] = np.nan
    return replace(measurements, points=points)


def test_the_arm_goes_from_the_base_to_the_tool_in_links_of_its_lengths(
    fanuc_measurements: Measurements,
) -> None:
    scene = scene_of(fanuc_measurements)
    assert scene.arm.shape == (100, 14, 3)
    assert not scene.arm[:, 0].any()
    robot = fanuc_measurements.robot
    assert np.allclose(
        scene.arm[:, -1], robot.mechanism.forward(fanuc_measurements.q)[:, :3, 3], atol=1e-12
    )
    links = np.linalg.norm(np.diff(scene.arm, axis=1), axis=-1)[:, ::2]
    assert np.allclose(links, np.linalg.norm(robot.chain.placements[:, :3, 3], axis=-1), atol=1e-12)


def test_measured_points_are_where_the_instrument_saw_them(
    fanuc_measurements: Measurements,
) -> None:
    scene = scene_of(fanuc_measurements)
    assert np.allclose(scene.found, fanuc_measurements.points, atol=1e-12)
    assert np.array_equal(scene.magnified(0.0), scene.nominal)
    assert np.allclose(scene.magnified(1.0), scene.found, atol=1e-15)
    lengths = np.linalg.norm(scene.found - scene.nominal, axis=-1)
    assert np.allclose(scene.error_rms, np.sqrt((lengths**2).mean(axis=-1)))
    assert 0 < scene.error_rms.min() < scene.error_rms.max() < 0.05


def test_a_calibration_shows_nearly_what_was_measured(
    fanuc_measurements: Measurements, fanuc_local_poe: Calibration
) -> None:
    measured, calibrated = scene_of(fanuc_measurements), scene_of(fanuc_local_poe)
    left = np.linalg.norm(measured.found - calibrated.found, axis=-1).mean()
    assert left < 0.2 * measured.error_rms.mean()
    assert (measured.meaning, calibrated.meaning) == ("measured", "calibrated")


def test_the_default_magnification_is_round_and_makes_errors_visible(
    fanuc_measurements: Measurements,
) -> None:
    scene = scene_of(fanuc_measurements)
    extent = np.ptp(scene.arm.reshape(-1, 3), axis=0).max()
    assert 1 / 40 < np.median(scene.error_rms) * scene.fitting_factor / extent < 1 / 11
    assert f"{scene.fitting_factor:.0e}"[0] in "125"
    assert replace(scene, found=scene.nominal).fitting_factor == 1.0


def test_the_page_holds_the_scene_and_needs_nothing_else(fanuc_measurements: Measurements) -> None:
    scene = scene_of(unseen_first(fanuc_measurements))
    page = page_of(scene, 50.0)
    assert page == page_of(scene, 50.0)
    assert not re.findall(r"""(?:https?:|src=|href=|import\b|fetch\()""", page)
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.S)[1])
    assert data["error"][0][0] == [None] * 3
    assert np.allclose(
        np.array(data["nominal"]) + np.nan_to_num(np.array(data["error"], float)),
        np.where(np.isnan(scene.found), scene.nominal, scene.found),
        atol=1e-6,
    )
    assert np.allclose(data["size_mm"], scene.error_rms * 1e3, atol=1e-4)
    assert np.isfinite(data["size_mm"]).all()


def test_the_solids_stand_where_the_joints_are(
    fanuc: Robot, fanuc_measurements: Measurements
) -> None:
    """A joint's solid turns about its axis: its centre is the joint's origin in every
    configuration; links reach from joint to joint.
    """
    scene = scene_of(fanuc_measurements)
    shape = simple_shape(fanuc)
    pieces = dict(zip([g.name for g in shape.geometryObjects], solids(scene, shape), strict=True))
    frames = fanuc.mechanism.frames(scene.q)
    for j in range(fanuc.n):
        piece = pieces[f"joint{j + 1}"]
        assert np.allclose(piece.placements[:, :, 3], frames.after[:, j, :3, 3], atol=1e-9)
        assert np.allclose(piece.vertices.mean(axis=0), 0.0, atol=1e-9)
        assert piece.faces.max() < len(piece.vertices)
    assert len(
        json.loads(
            re.search(
                r'id="data">(.*?)</script>', page_of(scene, 1.0, list(pieces.values())), re.S
            )[1]
        )["solids"]
    ) == len(pieces)


def test_a_simplified_mesh_keeps_its_shape() -> None:
    """A sphere of many triangles: fewer, and still on the sphere to the size of a cell."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 120), np.linspace(0, np.pi, 80), indexing="ij")
    points = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], -1).reshape(-1, 3)
    k = np.arange(119 * 80).reshape(119, 80)[:, :-1].ravel()
    faces = np.concatenate([np.stack([k, k + 1, k + 80], 1), np.stack([k + 1, k + 81, k + 80], 1)])
    vertices, kept = _simplified(points, faces, 24)
    assert len(kept) < len(faces) / 4
    radii = np.linalg.norm(vertices[np.unique(kept)], axis=-1)
    assert abs(radii - 1).max() < 2 / 24
    a, b, c = vertices[kept].swapaxes(0, 1)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum()
    assert area == pytest.approx(4 * np.pi, rel=0.05)


def test_a_name_cannot_break_the_page(fanuc: Robot, fanuc_measurements: Measurements) -> None:
    named = fanuc.source.description.model_copy(update={"name": "<script>alert(1)</script>"})
    robot = replace(fanuc, source=replace(fanuc.source, description=named))
    page = page_of(replace(scene_of(fanuc_measurements), robot=robot), 1.0)
    assert "&lt;script&gt;alert" in page
    assert "<script>alert" not in page


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_the_server_answers_on_its_port_alone_and_stops(
    fanuc: Robot, fanuc_measurements: Measurements, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("viser")
    scene, shape, port = (
        scene_of(unseen_first(fanuc_measurements)),
        simple_shape(fanuc),
        free_port(),
    )
    with serving(scene, shape, 10.0, port):
        with urllib.request.urlopen(f"http://127.0.0.1:{port}", timeout=10) as answer:
            assert answer.status == 200
        with pytest.raises(UsageError, match=f"--port {port}"), serving(scene, shape, 10.0, port):
            pass
    assert capsys.readouterr().out == ""


def test_the_live_scene_has_the_arm_the_targets_and_the_magnified_errors(
    fanuc: Robot, fanuc_measurements: Measurements
) -> None:
    pytest.importorskip("viser")
    scene = scene_of(unseen_first(fanuc_measurements))
    with serving(scene, simple_shape(fanuc), 10.0, free_port()) as visualizer:
        handles = visualizer.viewer.scene._handle_from_node_name
        joints = RobotErrors.of(fanuc).frames(scene.q[:1]).after[0, :, :3, 3]
        for j, joint in enumerate(joints):
            assert np.allclose(
                visualizer.frames[f"arm/visual/joint{j + 1}"].position, joint, atol=1e-9
            )
        assert np.allclose(
            handles["/nominal/now"].points, scene.nominal[0, 1:], atol=1e-6
        )  # the first was not seen
        assert np.allclose(
            handles["/found/all"].points, scene.magnified(10.0)[1:].reshape(-1, 3), atol=1e-6
        )
        vectors = handles["/errors/all"].points
        assert np.allclose(
            vectors[:, 1] - vectors[:, 0],
            10 * (scene.found - scene.nominal)[1:].reshape(-1, 3),
            atol=1e-5,
        )


def test_without_viser_the_remedy_is_named(
    fanuc: Robot, fanuc_measurements: Measurements, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    scene = scene_of(fanuc_measurements)
    with (
        pytest.raises(UsageError, match=r"calibtool\[view\]"),
        serving(scene, simple_shape(fanuc), 1.0, 8080),
    ):
        pass
