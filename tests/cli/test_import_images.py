"""calibtool import of a folder of images: files written, pictures drawn, wrong use refused."""

from pathlib import Path

import numpy as np
import pytest
from commandline import answer, refused, run, stored, write_table

from calibtool.measurement.images.rendering_boards import rendered
from calibtool.measurement.instruments.image_corners import BOARD, LENS
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.planning.joint_table import joint_table
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import inverse

ARM = load_robot("ur5")
UR5 = ("--robot", "ur5")
SMALL = LENS * np.array([0.4] * 4 + [1] * 5)
GIVEN = ("--joints", "joints.csv", "--board", "board.toml")
DESCRIBED = """kind = "charuco"
squares = [9, 7]
square_mm = 25.0
marker_mm = 18.0
dictionary = "5x5_100"
"""


def written(rows: int) -> None:
    """A folder of images and what belongs to it."""
    cv2 = pytest.importorskip("cv2")
    seen = simulate(ARM, Simulation(4, rows, "full", instrument="corners"))
    assert seen.truth is not None
    setup = seen.truth.setup
    assert setup.T_tool_camera is not None
    assert setup.T_base_boards is not None
    camera = seen.truth.actual.forward(seen.q) @ setup.T_tool_camera
    poses = inverse(camera) @ setup.T_base_boards[0]
    Path("images").mkdir()
    names = [f"shot {k}.png" for k in range(rows)]
    images = rendered(BOARD, poses, SMALL, (640, 480), np.random.default_rng(0))
    for name, image in zip(names, images, strict=True):
        cv2.imwrite(f"images/{name}", image)
    Path("joints.csv").write_text(joint_table(ARM, seen.q, {"image": names}))
    Path("board.toml").write_text(DESCRIBED)
    K = f"[{SMALL[0]}, 0, {SMALL[2]}, 0, {SMALL[1]}, {SMALL[3]}, 0, 0, 1]"
    Path("lens.yaml").write_text(f"camera_matrix: {{data: {K}}}\nD: {SMALL[4:].tolist()}\n")


def test_images_become_measurements_and_a_picture() -> None:
    written(6)
    output = ("-o", "m.h5", "--picture", "found.png", "--intrinsics", "lens.yaml")
    said = run("import", "images", *UR5, *GIVEN, *output).stderr
    assert "note: 6 of 6 images: focal length 560.0, 560.0 px" in said
    assert "warning" not in said
    assert stored("m.h5", "measurements/values").shape == (6, 96)
    assert answer("info", "m.h5")["observation"].startswith("corners of a board in images")
    assert Path("found.png").read_bytes().startswith(b"\x89PNG")
    beside = ("--camera", "beside", "-o", "n.h5", "--accept-misfit", "--intrinsics", "lens.yaml")
    said = run("import", "images", *UR5, *GIVEN, *beside).stderr
    assert "warning" in said  # it is on the tool


def test_wrong_use_is_one_line_with_a_remedy() -> None:
    written(1)
    output = ("-o", "m.h5")
    message = refused(2, "import", "images", *UR5, *output)
    assert message.startswith("images: a folder of images needs --joints FILE")
    message = refused(2, "import", "images", *UR5, "--joints", "joints.csv", *output)
    assert message.startswith("images: a folder of images needs --board BOARD.toml")
    message = refused(2, "import", "images", *UR5, *GIVEN, "--rows", "1:2", *output)
    assert message.startswith("--rows belongs to tables; images is a folder of images")
    message = refused(2, "import", "joints.csv", *UR5, "--board", "board.toml", *output)
    assert message.startswith("--board belongs to a folder of images, joints.csv is none")
    message = refused(4, "import", "images", *UR5, *GIVEN, *output)
    assert message.startswith("1 images show the board; a lens needs 5")
    Path("empty").mkdir()
    message = refused(3, "import", "empty", *UR5, *GIVEN, *output)
    assert message.startswith("empty: no image in it (.png")
    write_table("other.csv", ["image"], [["x.png"]])
    message = refused(3, "import", "images", *UR5, "--joints", "other.csv", *GIVEN[2:], *output)
    assert "other.csv: column 'image' has no row for the image shot 0.png" in message
    assert not Path("m.h5").exists()
