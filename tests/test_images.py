"""Images of boards: rendered by the project from a simulated robot, found, and identified from."""

from pathlib import Path

import numpy as np
import pytest
from derivatives import assert_derivative

from calibtool.errors import InputError, NoSolutionError, UsageError
from calibtool.measurement.checks import check_measurements
from calibtool.measurement.images import opencv as lazily
from calibtool.measurement.images.board_description import BoardDescription, parse_board
from calibtool.measurement.images.image_import import images_in, import_images, joined
from calibtool.measurement.images.intrinsics_file import parse_intrinsics
from calibtool.measurement.images.lens import calibrated
from calibtool.measurement.images.rendering_boards import rendered
from calibtool.measurement.images.turned_boards import turned
from calibtool.measurement.instruments.image_corners import BOARD, LENS
from calibtool.measurement.kinds.projection import (
    by_lens,
    by_point,
    planar_pose,
    project,
    stepped,
    undistorted,
)
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.registration import register
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.planning.joint_table import joint_table
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array, exp6, inverse, transform_points
from calibtool.tables import read_tables

ARM = load_robot("ur5")
SMALL = LENS * np.array([0.4] * 4 + [1] * 5)  # the lens on 640 × 480 px
SIZE = (640, 480)
CHECKERS = BoardDescription(kind="checkerboard", squares=(9, 7), square_mm=25)
ROWS = 9


def seen_by(measurements: Measurements) -> Array:
    """Poses of the board in the camera, from the truth of a simulation."""
    assert measurements.truth is not None
    setup, actual = measurements.truth.setup, measurements.truth.actual
    assert setup.T_tool_camera is not None
    assert setup.T_base_boards is not None
    camera = actual.forward(measurements.q) @ setup.T_tool_camera
    poses: Array = inverse(camera) @ setup.T_base_boards[0]
    return poses


@pytest.fixture(scope="module")
def simulated() -> Measurements:
    return simulate(
        ARM, Simulation(seed=4, configurations=ROWS, workspace="full", instrument="corners")
    )


def written(folder: Path, board: BoardDescription, poses: Array, seed: int = 0) -> list[Path]:
    cv2 = pytest.importorskip("cv2")
    images = rendered(board, poses, SMALL, SIZE, np.random.default_rng(seed))
    for k, image in enumerate(images):
        cv2.imwrite(str(folder / f"img{k}.png"), image)
    return images_in(folder)


@pytest.fixture(scope="module")
def charuco(simulated: Measurements, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return written(tmp_path_factory.mktemp("charuco"), BOARD, seen_by(simulated))


@pytest.fixture(scope="module")
def checkers(simulated: Measurements, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return written(tmp_path_factory.mktemp("checkers"), CHECKERS, seen_by(simulated))


def joints_of(measurements: Measurements, names: list[str] | None = None) -> str:
    return joint_table(ARM, measurements.q, {"image": names} if names else None)


# --- the camera ---


def test_derivatives_of_the_projection() -> None:
    points = np.random.default_rng(0).uniform([-0.2, -0.2, 0.4], [0.2, 0.2, 0.9], (6, 3))

    def moved(step: Array) -> Array:
        return project(points + step, LENS)

    assert_derivative(moved, by_point(points, LENS), np.zeros(3), tolerance=1e-7)

    def other_lens(step: Array) -> Array:
        return project(points, stepped(LENS, step))

    assert_derivative(other_lens, by_lens(points, LENS), np.zeros(9), tolerance=1e-7)


def test_a_ray_is_where_its_pixel_came_from() -> None:
    rays = np.random.default_rng(1).uniform(-0.4, 0.4, (50, 2))
    points = np.concatenate([rays, np.ones((50, 1))], axis=-1) * 0.7
    assert np.abs(undistorted(project(points, LENS), LENS) - rays).max() < 1e-9


def test_the_pose_of_a_flat_board_from_exact_rays() -> None:
    corners = BOARD.corners
    for k, pose in enumerate(exp6(np.random.default_rng(2).normal(size=(20, 6)) * 0.4)):
        pose[2, 3] = 0.5 + 0.02 * k
        points = transform_points(pose[None], corners)[0]
        found = planar_pose(points[:, :2] / points[:, 2:], corners)
        assert np.abs(found - pose).max() < 1e-9


def test_projection_agrees_with_opencv() -> None:
    cv2 = pytest.importorskip("cv2")
    points = np.random.default_rng(3).uniform([-0.2, -0.2, 0.4], [0.2, 0.2, 0.9], (30, 3))
    K = np.array([[LENS[0], 0, LENS[2]], [0, LENS[1], LENS[3]], [0, 0, 1]])
    theirs = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, LENS[4:])[0][:, 0]
    assert np.abs(project(points, LENS) - theirs).max() < 1e-9


# --- images ---


def test_corners_are_found_where_the_board_was_drawn(
    charuco: list[Path], simulated: Measurements
) -> None:
    imported = import_images(charuco, joints_of(simulated), "j.csv", ARM, BOARD)
    assert len(imported.paths) == ROWS
    drawn = project(transform_points(seen_by(simulated), BOARD.corners), SMALL)
    apart = imported.pixels - drawn
    assert np.isfinite(apart[..., 0]).mean() > 0.6  # at 25 px a square some are not found
    assert np.sqrt(np.nanmean(apart**2)) < 0.08
    assert np.abs(imported.lens.intrinsics[:2] / SMALL[:2] - 1).max() < 5e-3
    assert np.abs(imported.lens.intrinsics[2:4] - SMALL[2:4]).max() < 2
    # The nominal robot explains them as well as ideal corners.
    warnings = [f.name for f in check_measurements(imported.measurements)]
    assert "nominal_robot" not in warnings


def test_images_find_their_rows_by_name(charuco: list[Path], simulated: Measurements) -> None:
    order = np.random.default_rng(1).permutation(ROWS)
    text = joints_of(simulated.rows(order), [f"photos/img{k}.PNG" for k in order])
    text = text.replace(".PNG", ".png")
    assert SMALL is not None
    imported = import_images(charuco, text, "j.csv", ARM, BOARD, intrinsics=SMALL)
    assert np.allclose(imported.measurements.q, simulated.q, atol=1e-7)
    table = next(read_tables(iter(joints_of(simulated).splitlines(True)), "j.csv"))
    assert joined(table, ["a.png"] * ROWS).tolist() == list(range(ROWS))
    with pytest.raises(InputError, match=f"{ROWS} rows, but there are 4 images"):
        joined(table, ["a.png"] * 4)
    with pytest.raises(InputError, match=r"column 'image' has no row for the image img3.png"):
        import_images(charuco, text.replace("img3.", "img77."), "j.csv", ARM, BOARD)


def test_what_shows_nothing_is_listed_and_left_out(
    charuco: list[Path], simulated: Measurements, tmp_path: Path
) -> None:
    cv2 = pytest.importorskip("cv2")
    for path in charuco:
        (tmp_path / path.name).write_bytes(path.read_bytes())
    blank = np.full((480, 640), 90, dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "img2.png"), blank)
    sharp = cv2.imread(str(charuco[4]), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(str(tmp_path / "img4.png"), cv2.GaussianBlur(sharp, (0, 0), 15))
    (tmp_path / "img5.png").write_bytes(b"no image")
    cv2.imwrite(str(tmp_path / "img6.png"), cv2.resize(sharp, (320, 240)))
    paths = images_in(tmp_path)
    imported = import_images(paths, joints_of(simulated), "j.csv", ARM, BOARD, intrinsics=SMALL)
    assert [path.name for path in imported.paths] == [f"img{k}.png" for k in (0, 1, 3, 7, 8)]
    (finding,) = imported.findings
    assert finding.name == "board_not_found"
    assert finding.numbers == {"images": 4}
    for part in ("img2.png", "img4.png (blurred: ", "img5.png (no image)", "(320 × 240 px)"):
        assert part in finding.message
    assert np.allclose(imported.measurements.q, simulated.q[[0, 1, 3, 7, 8]], atol=1e-7)


def test_an_image_of_a_moving_arm_is_named_with_its_error(
    charuco: list[Path], simulated: Measurements, tmp_path: Path
) -> None:
    cv2 = pytest.importorskip("cv2")
    for path in charuco:
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if path.name == "img7.png":  # the lower half was read out later: a rolling shutter
            image[240:] = np.roll(image[240:], 6, axis=1)
        cv2.imwrite(str(tmp_path / path.name), image)
    paths = images_in(tmp_path)
    imported = import_images(paths, joints_of(simulated), "j.csv", ARM, BOARD, intrinsics=SMALL)
    assert [finding.name for finding in imported.findings] == ["blurred_images"]
    assert "img7.png (" in imported.findings[0].message
    assert len(imported.paths) == ROWS - 1


def test_mirrored_images_are_named(
    charuco: list[Path], simulated: Measurements, tmp_path: Path
) -> None:
    cv2 = pytest.importorskip("cv2")
    for path in charuco:
        cv2.imwrite(str(tmp_path / path.name), cv2.imread(str(path))[:, ::-1])
    with pytest.raises(InputError, match="the images are mirrored: 4 of 4"):
        import_images(images_in(tmp_path), joints_of(simulated), "j.csv", ARM, BOARD)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (
            {"dictionary": "4x4_100"},
            "those of 5x5_50 (or a larger one), not of 4x4_100",
        ),
        ({"squares": (11, 7)}, "their markers are those of a board of 9 squares across"),
        ({"squares": (7, 9)}, "their markers are those of a board of 9 squares across"),
    ],
)
def test_another_board_than_described_is_named(
    charuco: list[Path], simulated: Measurements, changed: dict[str, object], said: str
) -> None:
    other = BOARD.model_copy(update=changed)
    with pytest.raises(InputError, match="the images do not show the charuco of") as caught:
        import_images(charuco, joints_of(simulated), "j.csv", ARM, other)
    assert said in str(caught.value)


def test_squares_of_another_size_are_named_with_their_scale(
    charuco: list[Path], simulated: Measurements
) -> None:
    for size in (30.0, 25.0 / 25.4):
        other = BOARD.model_copy(update={"square_mm": size, "marker_mm": 0.72 * size})
        imported = import_images(charuco, joints_of(simulated), "j.csv", ARM, other)
        warnings = [f for f in check_measurements(imported.measurements) if f.name == "board_scale"]
        assert len(warnings) == 1
        assert warnings[0].numbers["scale"] == pytest.approx(25.0 / size, rel=0.01)


def test_a_checkerboard_is_numbered_from_one_end(
    checkers: list[Path], simulated: Measurements
) -> None:
    imported = import_images(
        checkers, joints_of(simulated), "j.csv", ARM, CHECKERS, intrinsics=SMALL
    )
    kept = [int(path.stem[3:]) for path in imported.paths]
    assert len(kept) >= 6
    drawn = project(transform_points(seen_by(simulated)[kept], CHECKERS.corners), SMALL)
    as_drawn, over = (np.abs(imported.pixels - d).max() for d in (drawn, drawn[:, ::-1]))
    assert min(as_drawn, over) < 1.0  # all of them the same way round


def test_a_checkerboard_of_other_squares_is_named(
    checkers: list[Path], simulated: Measurements
) -> None:
    other = CHECKERS.model_copy(update={"squares": (8, 6)})
    with pytest.raises(InputError, match=r"they show (9 × 7|7 × 9) squares"):
        import_images(checkers, joints_of(simulated), "j.csv", ARM, other)


def test_a_mirrored_checkerboard_is_named(simulated: Measurements, tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    for path in written(tmp_path, CHECKERS, seen_by(simulated)):
        cv2.imwrite(str(path), cv2.imread(str(path))[:, ::-1])
    flat = SMALL * np.array([1, 1, 1, 1, 1, 1, 1, -1, 1])
    flat[2] = SIZE[0] - 1 - SMALL[2]
    imported = import_images(
        images_in(tmp_path), joints_of(simulated), "j.csv", ARM, CHECKERS, intrinsics=flat
    )
    names = [f.name for f in check_measurements(imported.measurements)]
    assert "mirrored_images" in names


def test_turned_boards_are_told_from_any_robot() -> None:
    rng = np.random.default_rng(5)
    tool, camera, board = (exp6(rng.normal(size=(n, 6)))[:, :3, :3] for n in (30, 1, 1))
    over = rng.random(30) < 0.4
    flips = np.where(over[:, None, None], np.diag([-1.0, -1.0, 1.0]), np.eye(3))
    on_tool = np.swapaxes(tool @ camera, -1, -2) @ board @ flips
    beside = camera @ tool @ board @ flips
    for seen in (on_tool, beside):
        assert np.array_equal(turned(seen, tool), over != over[0])


def test_a_lens_needs_images_and_tilts(charuco: list[Path], simulated: Measurements) -> None:
    pytest.importorskip("cv2")
    with pytest.raises(NoSolutionError, match="3 images show the board; a lens needs 5"):
        import_images(charuco[:3], joints_of(simulated.rows(np.arange(3))), "j", ARM, BOARD)
    level = np.tile(np.eye(4), (6, 1, 1))
    level[:, :3, 3] = np.random.default_rng(0).uniform([-0.1, -0.1, 0.4], [0, 0, 0.6], (6, 3))
    pixels = project(transform_points(level, BOARD.corners), SMALL)
    with pytest.raises(NoSolutionError, match="all boards look the same way"):
        calibrated(pixels, BOARD.corners, SIZE)


def test_intrinsics_of_another_resolution_are_refused(
    charuco: list[Path], simulated: Measurements
) -> None:
    with pytest.raises(InputError, match="they belong to another camera or resolution"):
        import_images(charuco, joints_of(simulated), "j.csv", ARM, BOARD, intrinsics=LENS)


def test_the_registered_set_up_is_that_of_the_simulation(
    charuco: list[Path], simulated: Measurements
) -> None:
    """Within what the nominal robot's errors do to it."""
    imported = import_images(charuco, joints_of(simulated), "j.csv", ARM, BOARD, intrinsics=SMALL)
    found = register(imported.measurements).T_tool_camera
    assert simulated.truth is not None
    true = simulated.truth.setup.T_tool_camera
    assert found is not None
    assert true is not None
    assert np.abs(found - true).max() < 1.5e-2


# --- files that describe ---


def test_intrinsics_as_ros_and_opencv_write_them() -> None:
    ros = """image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [560, 0, 320, 0, 561, 240, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.02, 0.001, -0.002, 0.003]}
"""
    expected = [560, 561, 320, 240, -0.1, 0.02, 0.001, -0.002, 0.003]
    assert parse_intrinsics(ros, "c.yaml").tolist() == expected
    theirs = """%YAML:1.0
---
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 560., 0., 320., 0., 561., 240., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.1, 0.02, 0.001, -0.002, 0.003 ]
"""
    assert parse_intrinsics(theirs, "c.yml").tolist() == expected
    json = '{"K": [[560, 0, 320], [0, 561, 240], [0, 0, 1]], "D": [[-0.1, 0.02, 0.001, -0.002]]}'
    assert parse_intrinsics(json, "c.json").tolist() == [*expected[:-1], 0.0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[1, 2]", "no camera_matrix in it"),
        ("K: [1, 2, 3]", "has 3 numbers; expected 9"),
        ("K: [0, 0, 3, 0, 1, 2, 0, 0, 1]", "focal lengths 0, 1 px"),
        ("K: [a]", "no numbers under camera_matrix"),
        ("distortion_model: equidistant", "distortion model 'equidistant' is not known"),
        ("{", "neither YAML nor JSON"),
        ("K: [5, 0, 3, 0, 5, 2, 0, 0, 1]\nD: [0, 0, 0, 0, 0, 0.1]", "6 distortion coefficients"),
    ],
)
def test_intrinsics_that_are_none_are_refused(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        parse_intrinsics(text, "c.yaml")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('kind = "charuco"\nsquares = [9, 7]\nsquare_mm = 25', "needs marker_mm and dictionary"),
        ('kind = "checkerboard"\nsquares = [7, 7]\nsquare_mm = 25', "looks the same when turned"),
        ('kind = "checkerboard"\nsquares = [9, 7]\nsquare_mm = -2', "square_mm"),
        ('kind = "checkerboard"\nsquares = [9, 7]\nsquare = 2', "square"),
        (
            'kind = "charuco"\nsquares = [9, 7]\nsquare_mm = 9\nmarker_mm = 9\ndictionary = "x"',
            "marker_mm has to be below square_mm",
        ),
    ],
)
def test_boards_that_cannot_be_are_refused(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        parse_board(text, "b.toml")


def test_a_dictionary_that_there_is_not_or_that_is_too_small() -> None:
    pytest.importorskip("cv2")
    with pytest.raises(InputError, match="no dictionary '5x5_55'"):
        BOARD.model_copy(update={"dictionary": "5x5_55"}).aruco()
    with pytest.raises(InputError, match="needs 450 markers, 5x5_100 has 100"):
        BOARD.model_copy(update={"squares": (30, 30)}).aruco()


def test_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "cv2", None)
    with pytest.raises(UsageError, match=r"pip install 'calibtool\[camera\]'"):
        lazily.opencv()
