"""calibtool train: what the network builds on, how it is trained, and that a seed repeats it."""

import hashlib
from pathlib import Path
from typing import Any

import pytest
from commandline import Files, answer, contents, refused, run

EARLY = ["--base", "local-poe", "--regularisation", "early-stopping"]


def mean_error(calibration: str, on: str) -> tuple[float, float]:
    """Mean position error in mm: nominal, and with the calibration."""
    methods = answer("evaluate", calibration, "--on", on)["methods"]
    return methods[0]["position_mm"]["mean"], methods[1]["position_mm"]["mean"]


def trained(files: Files, *options: object) -> dict[str, Any]:
    return answer(
        "train",
        files.measurements,
        "--restarts",
        1,
        *(() if "--base" in options else EARLY),
        *options,
    )


def test_report_and_file(files: Files) -> None:
    result = run("train", files.measurements, "--restarts", 1, *EARLY, "-o", "c.h5")
    assert result.stdout_bytes == b""
    assert "network: 4 hidden nodes, task loss, lm" in result.stderr
    assert Path("c.h5").exists()
    assert (
        run("train", files.measurements, "--restarts", 1, *EARLY).stdout_bytes
        == Path("c.h5").read_bytes()
    )


def test_json_makes_no_file_unless_one_is_named(files: Files) -> None:
    value = trained(files)
    assert contents(Path.cwd()) == {}
    assert trained(files, "-o", "c.h5") == value
    assert answer("info", "c.h5")["network"] == value["network"]
    assert value["schema"] == "calibtool/training"


def test_json_and_the_file_cannot_share_stdout(files: Files) -> None:
    assert "--json" in refused(2, "train", files.measurements, "--json", "-o", "-")


def test_same_seed_same_bytes(files: Files) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        run("train", files.measurements, "--restarts", 1, "--seed", seed, "-o", f"{name}.h5")
    a, b, c = (Path(f"{name}.h5").read_bytes() for name in "abc")
    assert a == b
    assert a != c


def test_fresh_configurations_get_better(files: Files) -> None:
    """Configurations that no fit has seen, a seed for all: on the arm with three joints, and on
    the one with six.
    """
    for calibration in (files.paper, files.network, files.local_poe):
        nominal, compensated = mean_error(calibration, files.fresh)
        assert compensated < nominal
    nominal, compensated = mean_error(files.six_network, files.six_fresh)
    assert compensated < 0.3 * nominal


def test_base_models(files: Files) -> None:
    assert trained(files, "--base", "nominal")["base"]["model"] == "nominal"
    assert trained(files, "--base", "local-poe")["base"]["model"] == "local-poe"
    assert answer("train", files.measurements, "--restarts", 1)["base"]["model"] == "complete"
    assert "parameters" not in trained(files, "--base", "nominal")["base"]


def test_a_file_as_base(files: Files) -> None:
    """The identified model of a file is used as it is: the same network as if it were
    identified here.
    """
    run(
        "train",
        files.measurements,
        "--restarts",
        1,
        "--base",
        files.local_poe,
        *EARLY[2:],
        "-o",
        "c.h5",
    )
    value = answer("info", "c.h5")
    assert value["network"] == answer("info", files.network)["network"]
    provenance = value["provenance"]
    assert (
        provenance["sha256_base"] == hashlib.sha256(Path(files.local_poe).read_bytes()).hexdigest()
    )
    assert (
        provenance["sha256_measurements"]
        == hashlib.sha256(Path(files.measurements).read_bytes()).hexdigest()
    )


def test_base_from_stdin(files: Files) -> None:
    run(
        "train",
        files.measurements,
        "--restarts",
        1,
        "--base",
        "-",
        "-o",
        "c.h5",
        stdin=_bytes(files.local_poe),
    )
    assert answer("info", "c.h5")["base"]["model"] == "local-poe"


def _bytes(path: str) -> bytes:
    return Path(path).read_bytes()


def test_base_of_another_robot(files: Files) -> None:
    message = refused(3, "train", files.six_measurements, "--base", files.network, "-o", "c.h5")
    assert "planar-3r" in message
    assert "fanuc-m1000ia" in message


@pytest.mark.parametrize("loss", ["task", "joint"])
def test_losses(files: Files, loss: str) -> None:
    assert trained(files, "--loss", loss)["network"]["loss"] == loss


@pytest.mark.parametrize("optimizer", ["lm", "gd"])
def test_optimizers(files: Files, optimizer: str) -> None:
    assert trained(files, "--optimizer", optimizer)["network"]["optimizer"] == optimizer


def test_hidden_nodes(files: Files) -> None:
    """√(6n) unless given: 4 for three joints, 6 for six."""
    assert trained(files)["network"]["hidden"] == 4
    assert trained(files, "--hidden", 7)["network"]["hidden"] == 7
    assert answer("info", files.six_network)["network"]["hidden"] == 6


@pytest.mark.parametrize(
    ("validation", "training", "held"), [(0.5, 20, 20), (0.25, 30, 10), (0, 40, 0)]
)
def test_validation_part(files: Files, validation: float, training: int, held: int) -> None:
    network = trained(files, "--validation", validation)["network"]
    assert network["training_configurations"] == training
    assert network["validation_configurations"] == held


def test_restarts(files: Files) -> None:
    assert answer("train", files.measurements, "--restarts", 3)["network"]["restarts"] == 3


def test_a_network_that_does_not_help_is_not_used() -> None:
    """Nothing but noise is left over to learn."""
    run("simulate", "ur10", "-n", 30, "--errors", "thermal", "-o", "m.h5")
    result = run("train", "m.h5", "--restarts", 1, *EARLY, "-o", "c.h5")
    value = answer("info", "c.h5")["network"]
    assert value["used"] is False
    assert "network: not used" in result.stderr
    assert value["loss_reduction_percent"] <= 0


@pytest.mark.parametrize(("robot", "rows"), [("planar-3r", 4), ("ur3", 4)])
def test_few_rows_are_identified_and_no_network_is_judged(robot: str, rows: int) -> None:
    """`train` asks for no more rows than `identify`: with folds left out too few remain."""
    run("simulate", robot, "-n", rows, "--unregistered", "-o", "m.h5")
    run("identify", "m.h5", "-o", "identified.h5")
    result = run("train", "m.h5", "--restarts", 1, "--folds", 2, "-o", "trained.h5")
    assert "not used: where some configurations are left out" in result.stderr
    same = answer("info", "trained.h5"), answer("info", "identified.h5")
    assert same[0]["network"]["used"] is False
    assert same[0]["base"] == same[1]["base"]


@pytest.mark.parametrize(
    "form",
    [
        ["--hidden", "0"],
        ["--validation", "1"],
        ["--validation", "-0.1"],
        ["--restarts", "0"],
        ["--seed", "-1"],
    ],
)
def test_numbers_out_of_range(files: Files, form: list[str]) -> None:
    assert form[0] in refused(2, "train", files.measurements, *form, "-o", "c.h5")


def test_a_loss_is_called_validation_only_where_something_was_held_back(files: Files) -> None:
    assert (
        "validation loss"
        in run("train", files.measurements, "--restarts", 1, *EARLY, "-o", "a.h5").stderr
    )
    without = run(
        "train", files.measurements, "--restarts", 1, *EARLY, "--validation", 0, "-o", "b.h5"
    ).stderr
    assert "network: 4 hidden nodes" in without
    assert "validation loss" not in without


def test_the_learning_curve_falls_and_states_what_more_would_give(files: Files) -> None:
    paper = ["--base", "nominal", "--folds", 2, "--learning-curve"]
    curve = trained(files, *paper)["learning_curve"]
    sizes, errors = curve["configurations"], curve["position_rms_mm"]
    assert sizes == sorted(set(sizes))
    assert errors[-1] < errors[0]
    assert [row["configurations"] for row in curve["predicted"]] == [2 * sizes[-1], 4 * sizes[-1]]
    predicted = [row["position_rms_mm"] for row in curve["predicted"]]
    assert curve["floor_mm"] <= predicted[1] <= predicted[0]
    shown = run("train", files.measurements, "--restarts", 1, *paper, "-o", "c.h5").stderr
    assert f"no number of them less than {curve['floor_mm']:.3g} mm" in shown
    assert f"{sizes[-1]}: {errors[-1]:.3g} mm" in shown


def test_bayes_needs_second_derivatives(files: Files) -> None:
    message = refused(
        2,
        "train",
        files.measurements,
        "--optimizer",
        "gd",
        "--regularisation",
        "bayes",
        "-o",
        "c.h5",
    )
    assert "early-stopping" in message
