"""Plots: whole pictures of the format asked for, the same bytes every time, with every method in them."""

import io
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from matplotlib.image import imread

from calibtool.calibration import Calibration
from calibtool.errors import InputError, UsageError
from calibtool.evaluation.compare import Evaluation
from calibtool.evaluation.metrics import MethodErrors
from calibtool.evaluation.plots import draw_errors, draw_training, image_format


def evaluation(names: list[str], oriented: bool = True, rows: int = 30, exact: bool = False) -> Evaluation:
    rng = np.random.default_rng(0)
    size = 0.0 if exact else 1e-3
    methods = [
        MethodErrors(
            name, rng.normal(size=(rows, 1, 3)) * size, rng.normal(size=(rows, 3)) * size if oriented else None
        )
        for name in names
    ]
    return Evaluation("ur5", rows, "compensated", methods, [0] * len(names))


def texts(svg: bytes) -> str:
    root = ElementTree.fromstring(svg)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    return " ".join("".join(element.itertext()) for element in root.iter("{http://www.w3.org/2000/svg}text"))


def picture(png: bytes) -> np.ndarray:
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    return np.asarray(imread(io.BytesIO(png), format="png"))


@pytest.mark.parametrize(
    ("name", "image"),
    [("a.png", "png"), ("dir/b.svg", "svg"), ("C.PNG", "png"), ("a.svg.png", "png"), ("x.Svg", "svg")],
)
def test_the_extension_chooses_the_format(name: str, image: str) -> None:
    assert image_format(name) == image


@pytest.mark.parametrize("name", ["plot.pdf", "plot", "png", "plot.png.txt", "-", ""])
def test_any_other_extension_is_wrong_usage(name: str) -> None:
    with pytest.raises(UsageError, match=r"plots are written as \.png or \.svg"):
        image_format(name)


def test_a_png_of_errors_is_a_picture_with_something_on_it() -> None:
    for oriented in (True, False):
        image = picture(draw_errors(evaluation(["nominal", "paper"], oriented), "png"))
        assert image.shape[1] == 1500  # 10 in at 150 dpi
        assert image[..., :3].std() > 0.01


def test_an_svg_of_errors_names_methods_units_and_axes() -> None:
    written = texts(draw_errors(evaluation(["nominal", "paper", "local-poe"]), "svg"))
    for word in ("nominal", "paper", "local-poe", "position error, mm", "orientation error, mrad", "configuration"):
        assert word in written


def test_without_orientation_there_is_no_panel_for_it() -> None:
    assert "orientation" not in texts(draw_errors(evaluation(["nominal", "a"], oriented=False), "svg"))


@pytest.mark.filterwarnings("ignore:Data has no positive values")
def test_a_plot_of_errors_that_are_all_zero_can_be_drawn() -> None:
    picture(draw_errors(evaluation(["nominal"], exact=True), "png"))


def test_many_methods_can_be_told_apart() -> None:
    names = [f"method-{i}" for i in range(9)]
    written = texts(draw_errors(evaluation(names), "svg"))
    assert all(name in written for name in names)


def test_a_training_shows_both_losses_and_the_kept_iteration(fanuc_network: Calibration) -> None:
    assert fanuc_network.training is not None
    written = texts(draw_training([("paper", fanuc_network)], "svg"))
    chosen = fanuc_network.training.history.chosen
    for word in ("paper: task loss, lm", "training", "validation", "without network", f"kept: iteration {chosen}"):
        assert word in written
    picture(draw_training([("paper", fanuc_network)], "png"))


def test_only_calibrations_with_a_network_are_drawn(fanuc_network: Calibration, fanuc_local_poe: Calibration) -> None:
    written = texts(draw_training([("poe", fanuc_local_poe), ("paper", fanuc_network)], "svg"))
    assert "paper: task loss" in written
    assert "poe:" not in written


def test_without_any_network_there_is_no_training_to_draw(fanuc_local_poe: Calibration) -> None:
    with pytest.raises(InputError, match="poe: has no network, so there is no training to draw"):
        draw_training([("poe", fanuc_local_poe)], "png")


@pytest.mark.parametrize("image", ["png", "svg"])
def test_the_same_picture_has_the_same_bytes(image: str, fanuc_network: Calibration) -> None:
    drawn = [draw_errors(evaluation(["nominal", "a"], oriented=False), image) for _ in range(2)]  # type: ignore[arg-type]
    assert drawn[0] == drawn[1]
    curves = [draw_training([("paper", fanuc_network)], image) for _ in range(2)]  # type: ignore[arg-type]
    assert curves[0] == curves[1]


@pytest.mark.parametrize("image", ["png", "svg"])
def test_no_date_and_no_version_is_written_into_the_picture(image: str) -> None:
    data = draw_errors(evaluation(["nominal"]), image)  # type: ignore[arg-type]
    assert b"dc:date" not in data
    assert b"Software" not in data
