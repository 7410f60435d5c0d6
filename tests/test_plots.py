"""Figures: whole pictures of the format asked for, the same bytes every time, with
every method in them.
"""

import io
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from matplotlib.image import imread

from calibtool.calibration import Calibration, identify, train
from calibtool.calibration.fit import BaseOptions
from calibtool.cli.plot import OF_CALIBRATIONS, OF_ERRORS
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.families import BY_ID
from calibtool.errors import InputError, UsageError
from calibtool.evaluation.acceptance import parse_limit
from calibtool.evaluation.compare import Evaluation
from calibtool.evaluation.metrics import MethodErrors, MethodResult
from calibtool.evaluation.plots import FIGURES, ImageFormat, Subject, draw, image_format
from calibtool.evaluation.plots.calibration_figures import joint_motions
from calibtool.evaluation.plots.error_figures import magnification
from calibtool.evaluation.plots.style import COLOURS
from calibtool.evaluation.pose_test import pose_test, repeated_poses
from calibtool.identification.complete import CompleteOptions
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

WIDTH = 120.0


def evaluation(
    names: list[str], oriented: bool = True, rows: int = 30, exact: bool = False
) -> Evaluation:
    rng = np.random.default_rng(0)
    size = 0.0 if exact else 1e-3
    methods = [
        MethodErrors(
            name,
            rng.normal(size=(rows, 1, 3)) * size,
            rng.normal(size=(rows, 3)) * size if oriented else None,
        )
        for name in names
    ]
    return Evaluation(
        "ur5", rows, "compensated", tuple(MethodResult(method, method) for method in methods)
    )


def judged(
    measurements: Measurements, names: list[str], oriented: bool = True, **extra: object
) -> Subject:
    """A subject with made-up errors at real configurations."""
    return Subject([], measurements, evaluation(names, oriented, len(measurements)), **extra)


def texts(svg: bytes) -> str:
    """What is written in an SVG whose text is text."""
    root = ElementTree.fromstring(svg)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    return " ".join(
        "".join(element.itertext()) for element in root.iter("{http://www.w3.org/2000/svg}text")
    )


def written(kind: str, subject: Subject) -> str:
    return texts(draw(kind, subject, "svg", WIDTH, letters=True))


def picture(png: bytes) -> np.ndarray:
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    return np.asarray(imread(io.BytesIO(png), format="png"))


@pytest.mark.parametrize(
    ("name", "image"),
    [
        ("a.png", "png"),
        ("dir/b.svg", "svg"),
        ("C.PNG", "png"),
        ("a.svg.png", "png"),
        ("x.Svg", "svg"),
        ("b.pdf", "pdf"),
    ],
)
def test_the_extension_chooses_the_format(name: str, image: str) -> None:
    assert image_format(name) == image


@pytest.mark.parametrize("name", ["plot.eps", "plot", "png", "plot.png.txt", "-", ""])
def test_any_other_extension_is_wrong_usage(name: str) -> None:
    with pytest.raises(UsageError, match=r"plots are written as \.png, \.svg or \.pdf"):
        image_format(name)


def test_a_picture_has_the_width_asked_for_and_something_on_it(
    fanuc_measurements: Measurements,
) -> None:
    image = picture(draw("errors", judged(fanuc_measurements, ["nominal", "paper"]), "png", 85.0))
    assert image.shape[1] == pytest.approx(85 / 25.4 * 300, abs=1)
    assert image[..., :3].std() > 0.01


def test_errors_name_methods_units_and_axes(fanuc_measurements: Measurements) -> None:
    found = written("errors", judged(fanuc_measurements, ["nominal", "paper", "local-poe"]))
    for word in (
        "nominal",
        "paper",
        "local-poe",
        "position error, mm",
        "orientation error, mrad",
        "configuration",
    ):
        assert word in found


def test_without_orientation_there_is_no_panel_for_it(fanuc_measurements: Measurements) -> None:
    subject = judged(
        fanuc_measurements,
        ["nominal", "a"],
        oriented=False,
        limits=(parse_limit("orientation_max_mrad=1"),),
    )
    for kind in ("errors", "distribution"):
        assert "orientation" not in written(kind, subject)


def test_errors_that_are_all_zero_can_be_drawn(fanuc_measurements: Measurements) -> None:
    subject = Subject([], fanuc_measurements, evaluation(["nominal"], rows=100, exact=True))
    for kind in ("errors", "vectors"):
        assert written(kind, subject)


def test_names_of_many_methods_are_shown_as_they_are(fanuc_measurements: Measurements) -> None:
    names = ["nominal", "_hidden", "a$x$b", "5 < 6 & 7", *(f"method-{i}" for i in range(6))]
    found = written("distribution", judged(fanuc_measurements, names))
    assert all(name in found for name in names)


def test_the_limit_is_drawn(fanuc_measurements: Measurements) -> None:
    limits = (parse_limit("position_p95_mm=0.7"),)
    assert "p95 ≤ 0.7 mm" in written(
        "distribution", judged(fanuc_measurements, ["nominal", "a"], limits=limits)
    )


def test_the_median_arrow_is_five_to_eight_percent_of_the_workspace() -> None:
    rng = np.random.default_rng(1)
    for size in (1e-6, 3e-5, 1e-3, 0.05):
        error = rng.normal(size=(200, 3)) * size
        factor = magnification(2.0, error)
        median = np.median(np.linalg.norm(error, axis=-1))
        assert factor == 1.0 or 0.05 * 2.0 <= factor * median <= 0.08 * 2.0 * 1.0001
        assert float(f"{factor:.1e}".partition("e")[0]) in (1, 1.5, 2, 3, 4, 5, 6, 8)
    assert magnification(2.0, np.zeros((5, 3))) == 1.0


def test_a_training_shows_both_losses_and_the_kept_iteration(fanuc_network: Calibration) -> None:
    assert fanuc_network.training is not None
    found = written("training", Subject([("paper", fanuc_network)]))
    chosen = fanuc_network.training.history.chosen
    for word in (
        "paper: pose error, Levenberg–Marquardt",
        "training",
        "validation",
        "without network",
        f"kept: iteration {chosen}",
    ):
        assert word in found


def test_only_calibrations_with_a_network_are_drawn(
    fanuc_network: Calibration, fanuc_local_poe: Calibration
) -> None:
    both = Subject([("poe", fanuc_local_poe), ("paper", fanuc_network)])
    assert "paper: pose error" in written("training", both)
    assert "poe" not in written("training", both)
    assert "paper" not in written("observability", both)


def test_a_gaussian_process_has_no_iterations_to_draw() -> None:
    measurements = simulate(load_robot("planar-3r"), Simulation(seed=1, configurations=20))
    found = train(measurements, "nominal", TrainingOptions(regressor="gaussian-process"))
    assert found.training is not None
    with pytest.raises(InputError, match="no network was trained"):
        draw("training", Subject([("gp", found)]), "png")


def test_joint_motions_are_those_of_the_network_on_the_drawing(fanuc_network: Calibration) -> None:
    """On the nominal robot, moving the joints by δρ gives the calibrated pose (Eq.
    13), to first order.
    """
    q = fanuc_network.q[:20]
    moved = fanuc_network.robot.mechanism.forward(q + joint_motions(fanuc_network, q))
    np.testing.assert_allclose(moved, fanuc_network.forward(q), atol=3e-5)


@pytest.mark.parametrize("kind", ["training", "motions", "parameters"])
def test_what_is_not_there_is_reported(kind: str, fanuc_local_poe: Calibration) -> None:
    with pytest.raises(InputError, match=r"no |only "):
        draw(kind, Subject([("poe", fanuc_local_poe)]), "png")


def test_figures_of_errors_need_measurements(fanuc_local_poe: Calibration) -> None:
    assert set(FIGURES) == {*OF_CALIBRATIONS, *OF_ERRORS}
    for kind in OF_ERRORS:
        with pytest.raises(UsageError, match="measurements"):
            draw(kind, Subject([("poe", fanuc_local_poe)]), "png")
    with pytest.raises(UsageError, match="did you mean errors"):
        draw("eror", Subject([]), "png")


def test_every_family_of_parameters_is_drawn(fanuc_measurements: Measurements) -> None:
    complete = identify(fanuc_measurements, "complete")
    found = written("parameters", Subject([("complete", complete)]))
    for word in (
        "placement errors, mm",
        "placement errors, mrad",
        "joint offsets, mrad",
        "ζ1.x",
        "q6",
    ):
        assert word in found


def test_everything_that_moves_a_joint_is_drawn_with_its_own_name(fanuc: Robot) -> None:
    """Harmonics, wind-up and backlash of one arm: a panel each, and the harmonics as a curve
    over their joint.
    """
    scales = ErrorScales(("geometric", "gear", "gravity", "backlash"))
    measurements = simulate(fanuc, Simulation(configurations=60, scales=scales, workspace="full"))
    options = CompleteOptions(orders={"harmonics": 2, "gravity": 1, "backlash": 1, "twists": 1})
    complete = identify(measurements, BaseOptions("complete", options))
    found = written("parameters", Subject([("complete", complete)]))
    units = {
        "placements": "mm",
        "twists": "mm/rad",
        "harmonics": "mrad",
        "gravity": "mrad",
        "backlash": "mrad",
    }
    for family, unit in units.items():
        assert f"{BY_ID[family].words}, {unit}" in found
    assert "δρ2, mrad" in written("motions", Subject([("complete", complete)]))


def test_coverage_counts_one_set_of_the_training_once(
    fanuc_measurements: Measurements, fanuc_local_poe: Calibration, fanuc_network: Calibration
) -> None:
    both = [("poe", fanuc_local_poe), ("paper", fanuc_network)]
    found = written(
        "coverage", Subject(both, fanuc_measurements, evaluation(["nominal"], rows=100))
    )
    assert "training of poe, paper" in found
    assert "joint 6, deg" in found


def test_pose_accuracy_and_repeatability(fanuc_measurements: Measurements) -> None:
    rows = fanuc_measurements.rows(np.repeat(np.arange(5), 4))
    made = evaluation(["nominal", "a"], rows=20)
    poses = repeated_poses(rows.q, rows.robot.mechanism.forward(rows.q)[:, :3, 3])
    tested = Evaluation(
        "x", 20, "predicted", made.results, pose_test=pose_test(made.methods, poses)
    )
    found = written("iso9283", Subject([], rows, tested))
    for word in ("AP nominal", "AP a", "RP", "configuration 1", "position, mm"):
        assert word in found


@pytest.mark.parametrize("image", ["png", "svg", "pdf"])
def test_the_same_picture_has_the_same_bytes_and_no_date(
    image: ImageFormat, fanuc_measurements: Measurements, monkeypatch: pytest.MonkeyPatch
) -> None:
    subject = judged(fanuc_measurements, ["nominal", "a"], oriented=False)
    drawn = []
    for epoch in ("0", "1700000000"):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", epoch)
        drawn.append(draw("distribution", subject, image, WIDTH))
    assert drawn[0] == drawn[1]
    for word in (b"dc:date", b"Software", b"CreationDate", b"Producer"):
        assert word not in drawn[0]


def test_letters_of_a_file_are_part_of_it(fanuc_measurements: Measurements) -> None:
    """A journal's typesetter has other fonts: SVG letters are outlines, PDF letters
    whole TrueType ones.
    """
    subject = judged(fanuc_measurements, ["nominal", "a"], oriented=False)
    assert texts(draw("distribution", subject, "svg", WIDTH)) == ""
    pdf = draw("distribution", subject, "pdf", WIDTH)
    assert b"/FontFile2" in pdf
    assert b"/Type3" not in pdf


def test_colours_are_those_of_the_palette(fanuc_measurements: Measurements) -> None:
    """Colours of a figure are those of the palette (Okabe and Ito) and greys, nothing else."""
    svg = draw("errors", judged(fanuc_measurements, ["nominal", *"abcdef"]), "svg", WIDTH).decode()
    used = set(re.findall(r"#[0-9a-f]{6}\b", svg)) - {"#ffffff", "#000000"}
    greys = {
        c
        for c in used
        if max(int(c[i : i + 2], 16) for i in (1, 3, 5))
        - min(int(c[i : i + 2], 16) for i in (1, 3, 5))
        < 3
    }
    assert used - greys == set(COLOURS[1:])
