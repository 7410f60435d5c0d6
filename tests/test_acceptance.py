"""Limits: read strictly, judged against the statistic they name."""

import numpy as np
import pytest

from calibtool.errors import UsageError
from calibtool.evaluation.acceptance import broken_limits, parse_limit
from calibtool.evaluation.metrics import STATISTICS, MethodErrors


def method(
    name: str, millimetres: list[float], milliradians: list[float] | None = None
) -> MethodErrors:
    position = np.zeros((len(millimetres), 1, 3))
    position[:, 0, 1] = np.array(millimetres) * 1e-3
    turn = None
    if milliradians is not None:
        turn = np.zeros((len(milliradians), 3))
        turn[:, 2] = np.array(milliradians) * 1e-3
    return MethodErrors(name, position, turn)


@pytest.mark.parametrize("statistic", STATISTICS)
@pytest.mark.parametrize(("quantity", "unit"), [("position", "mm"), ("orientation", "mrad")])
@pytest.mark.parametrize(
    ("text", "value"), [("0.2", 0.2), ("1e-3", 1e-3), ("0", 0.0), ("12", 12.0)]
)
def test_a_limit_names_quantity_statistic_and_unit(
    quantity: str, unit: str, statistic: str, text: str, value: float
) -> None:
    limit = parse_limit(f"{quantity}_{statistic}_{unit}={text}")
    assert (limit.quantity, limit.statistic, limit.unit, limit.value) == (
        quantity,
        statistic,
        unit,
        value,
    )


@pytest.mark.parametrize(
    "text",
    [
        "",
        "position_max_mm",
        "position_max_mm=",
        "position_max_mm=abc",
        "position_max_mm=nan",
        "position_max_mm=-1",
        "position_max_mm=1e",
        "position_max_mrad=1",
        "orientation_max_mm=1",
        "position_median_mm=1",
        "speed_max_mm=1",
        "position_max_mm=1 2",
        "position_max_mm<1",
    ],
)
def test_anything_else_is_wrong_usage_and_shown(text: str) -> None:
    with pytest.raises(UsageError) as error:
        parse_limit(text)
    assert str(error.value).startswith(
        f"--require {text}: expected position_S_mm=VALUE or orientation_S_mrad=VALUE"
    )


def test_a_limit_that_is_met_is_not_broken_even_when_it_is_met_exactly() -> None:
    errors = [method("a", [0.1, 0.25], [0.5, 1.0])]
    limits = [
        parse_limit("position_max_mm=0.2500001"),
        parse_limit("orientation_mean_mrad=0.7500001"),
    ]
    assert broken_limits(errors, limits) == []
    assert broken_limits([method("a", [0.0])], [parse_limit("position_max_mm=0")]) == []


def test_a_broken_limit_names_method_statistic_value_and_limit() -> None:
    errors = [method("nominal", [1.0, 3.0], [1.0, 2.0]), method("good", [0.1, 0.3], [0.1, 0.2])]
    broken = broken_limits(
        errors, [parse_limit("position_mean_mm=0.5"), parse_limit("orientation_max_mrad=0.15")]
    )
    assert broken == [
        "nominal: position mean 2 mm is above the limit of 0.5 mm",
        "nominal: orientation max 2 mrad is above the limit of 0.15 mrad",
        "good: orientation max 0.2 mrad is above the limit of 0.15 mrad",
    ]


@pytest.mark.parametrize(
    ("statistic", "value"),
    [("mean", 2.0), ("max", 3.0), ("rms", np.sqrt(5)), ("std", 1.0), ("p95", 2.9)],
)
def test_each_statistic_is_judged_by_its_own_value(statistic: str, value: float) -> None:
    errors = [method("a", [1.0, 3.0])]
    assert broken_limits(errors, [parse_limit(f"position_{statistic}_mm={value + 1e-6}")]) == []
    assert len(broken_limits(errors, [parse_limit(f"position_{statistic}_mm={value - 1e-6}")])) == 1


def test_a_limit_on_an_orientation_that_is_not_measured_counts_as_broken() -> None:
    broken = broken_limits([method("a", [0.1])], [parse_limit("orientation_max_mrad=10")])
    assert len(broken) == 1
    assert "not measured" in broken[0]


def test_an_error_that_is_not_a_number_does_not_pass() -> None:
    assert broken_limits([method("a", [0.1, float("nan")])], [parse_limit("position_max_mm=1")])
