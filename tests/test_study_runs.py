"""One run of a study: the same numbers as the commands one after another, and failures that
stay where they are.
"""

from dataclasses import replace

import pytest

from calibtool.calibration import identify
from calibtool.errors import CalibtoolError, NoSolutionError
from calibtool.evaluation.compare import evaluate
from calibtool.evaluation.study import Definition, Study, perform
from calibtool.evaluation.study import runs as module
from calibtool.evaluation.study.study_table import COLUMNS
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot

SMALL = Definition(
    robots=["fanuc-m1000ia"],
    runs=2,
    configurations=[25],
    fresh=20,
    methods=["local-poe", "complete"],
)


def as_dicts(rows: list) -> list[dict]:
    return [dict(zip(COLUMNS, row, strict=True)) for row in rows]


def test_a_run_is_simulate_identify_and_evaluate() -> None:
    study = Study.of(SMALL)
    nominal, local_poe, complete = as_dicts(perform(study, 1))
    seed = complete["seed"]
    robot = load_robot("fanuc-m1000ia")
    workspace = robot.workspace()
    measured = simulate(robot, Simulation(seed=seed, configurations=25, workspace=workspace))
    fresh = Simulation(seed=seed, configurations=20, workspace=workspace, same_robot=measured.truth)
    judged = evaluate([("c", identify(measured, "complete"))], simulate(robot, fresh))
    assert complete["position_max_mm"] == pytest.approx(
        judged.methods[1].position_size.max() * 1e3, rel=1e-8
    )
    assert nominal["position_mean_mm"] == pytest.approx(
        judged.methods[0].position_size.mean() * 1e3, rel=1e-8
    )
    share = 100 * (1 - complete["position_max_mm"] / nominal["position_max_mm"])
    assert complete["position_max_reduction_percent"] == pytest.approx(share, rel=1e-6)
    assert complete["position_max_mm"] < local_poe["position_max_mm"] < nominal["position_max_mm"]
    assert [row["method"] for row in (nominal, local_poe, complete)] == [
        "nominal",
        "local-poe",
        "complete",
    ]
    assert (complete["study"], complete["run"], complete["configurations"]) == (study.key, 2, 25)


def test_without_fresh_ones_the_measured_are_judged() -> None:
    on_measured = as_dicts(
        perform(Study.of(SMALL.changed({"fresh": 0, "methods": "local-poe"})), 0)
    )
    on_fresh = as_dicts(perform(Study.of(SMALL.changed({"methods": "local-poe"})), 0))
    assert on_measured[0]["seed"] == on_fresh[0]["seed"]
    assert on_measured[0]["position_mean_mm"] != on_fresh[0]["position_mean_mm"]


def test_a_method_that_fails_costs_only_its_row(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise NoSolutionError("not observable")

    study = Study.of(SMALL)
    before = perform(study, 0)
    monkeypatch.setitem(module._CALIBRATE, "local-poe", refuse)
    after = perform(study, 0)
    assert (after[0], after[2]) == (before[0], before[2])
    row = as_dicts(after)[1]
    assert row["status"] == "not observable"
    assert row["position_mean_mm"] is row["networks"] is None


def test_a_run_that_cannot_be_measured_leaves_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("no\nluck")

    monkeypatch.setattr(module, "simulate", fail)
    rows = as_dicts(perform(Study.of(SMALL), 0))
    assert [row["status"] for row in rows] == ["unexpected ZeroDivisionError: no luck"] * 3


def test_another_calibtool_performs_nothing() -> None:
    with pytest.raises(CalibtoolError, match="install the same"):
        perform(replace(Study.of(SMALL), version="0.0.1"), 0)


@pytest.mark.parametrize("method", ["network", "network-local-poe", "default"])
def test_methods_with_networks(method: str) -> None:
    definition = Definition(
        robots=["planar-3r"], runs=1, configurations=[25], fresh=10, methods=[method]
    )
    row = as_dicts(perform(Study.of(definition), 0))[1]
    assert (row["method"], row["status"]) == (method, "ok")
    assert row["position_mean_reduction_percent"] > 50


def test_a_run_that_cannot_be_judged_leaves_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise NoSolutionError("not reachable")

    monkeypatch.setattr(module, "evaluate", fail)
    assert [row["status"] for row in as_dicts(perform(Study.of(SMALL), 0))] == ["not reachable"] * 3
