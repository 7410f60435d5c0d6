"""Statistics by hand, reductions against the nominal robot, tables of signed errors."""

import math

import numpy as np
import pytest
from cases import examples
from hypothesis import given
from hypothesis import strategies as st

from calibtool.evaluation.metrics import STATISTICS, MethodErrors, error_rows, statistics, summary


def method(
    name: str, position: list[list[list[float]]], turn: list[list[float]] | None = None
) -> MethodErrors:
    return MethodErrors(name, np.array(position), None if turn is None else np.array(turn))


@given(values=st.lists(st.floats(1e-9, 1e3), min_size=1, max_size=30))
@examples(30)
def test_statistics_are_those_of_a_hand_calculation(values: list[float]) -> None:
    found = statistics(np.array(values), 1e-3)
    scaled = sorted(v * 1e3 for v in values)
    n = len(values)
    mean = math.fsum(scaled) / n
    assert tuple(found) == STATISTICS
    assert math.isclose(found["mean"], mean, rel_tol=1e-9)
    assert math.isclose(found["rms"], math.sqrt(math.fsum(v * v for v in scaled) / n), rel_tol=1e-9)
    variance = (
        math.fsum((v - mean) ** 2 for v in scaled) / n
    )  # of these rows, not of a population behind them
    assert math.isclose(found["std"], math.sqrt(variance), rel_tol=1e-6, abs_tol=1e-6 * mean)
    assert found["max"] == pytest.approx(scaled[-1], rel=1e-12)
    at = 0.95 * (n - 1)
    low, high = scaled[math.floor(at)], scaled[math.ceil(at)]
    assert math.isclose(found["p95"], low + (at - math.floor(at)) * (high - low), rel_tol=1e-9)


def test_the_size_of_several_points_is_their_root_mean_square_length() -> None:
    errors = method(
        "a", [[[3e-3, 4e-3, 0.0], [0.0, 0.0, 0.0]], [[1e-3, 2e-3, 2e-3], [0.0, 3e-3, 0.0]]]
    )
    assert np.allclose(errors.position_size, [5e-3 / math.sqrt(2), 3e-3])


def test_the_size_of_a_turn_is_its_angle() -> None:
    errors = method("a", [[[0.0, 0.0, 0.0]]], [[1e-3, -2e-3, 2e-3]])
    assert errors.orientation_size is not None
    assert np.allclose(errors.orientation_size, [3e-3])
    assert method("a", [[[0.0, 0.0, 0.0]]]).orientation_size is None


def test_a_reduction_is_what_is_gone_in_percent() -> None:
    nominal = method("nominal", [[[4e-3, 0, 0]], [[8e-3, 0, 0]]], [[2e-3, 0, 0], [0, 4e-3, 0]])
    better = method("better", [[[1e-3, 0, 0]], [[0, 1e-3, 0]]], [[1e-3, 0, 0], [0, 0, 1e-3]])
    entry = summary(better, nominal)
    assert entry["position_mm"]["mean"] == pytest.approx(1.0)
    assert entry["orientation_mrad"]["max"] == pytest.approx(1.0)
    assert entry["reduction_percent"] == pytest.approx(
        {
            "position_mean": 100 * (1 - 1 / 6),
            "position_max": 100 * (1 - 1 / 8),
            "position_std": 100.0,
            "orientation_mean": 100 * (1 - 1 / 3),
            "orientation_max": 75.0,
            "orientation_std": 100.0,
        },
        abs=1e-9,
    )


def test_the_nominal_robot_is_reduced_by_nothing_and_a_worse_one_by_less() -> None:
    nominal = method("nominal", [[[1e-3, 0, 0]], [[3e-3, 0, 0]]])
    assert set(summary(nominal, nominal)["reduction_percent"].values()) <= {0.0, None}
    worse = method("worse", [[[2e-3, 0, 0]], [[6e-3, 0, 0]]])
    assert summary(worse, nominal)["reduction_percent"]["position_mean"] == pytest.approx(-100.0)


def test_an_orientation_that_is_not_seen_is_null() -> None:
    entry = summary(method("a", [[[1e-3, 0, 0]]]), method("nominal", [[[1e-3, 0, 0]]]))
    assert entry["orientation_mrad"] is None
    assert not any(entry["reduction_percent"].get(f"orientation_{s}") for s in STATISTICS)


def test_a_perfect_nominal_robot_has_nothing_to_reduce() -> None:
    perfect = method("nominal", [[[0.0, 0, 0]], [[0.0, 0, 0]]])
    assert set(summary(perfect, perfect)["reduction_percent"].values()) <= {0.0, None}


def test_error_rows_keep_sign_and_direction() -> None:
    a = method(
        "nominal",
        [[[1e-3, -2e-3, 3e-3], [0, 0, 0]], [[0, 0, -1e-6], [5e-4, 0, 0]]],
        [[1e-3, 0, 0], [0, 0, -2e-3]],
    )
    b = method("b", [[[0, 0, 0], [0, 0, 0]], [[0, 0, 0], [0, 0, 0]]], [[0, 0, 0], [0, 0, 0]])
    header, rows = error_rows([a, b])
    assert header == [
        "method", "configuration",
        "t1_dx_mm", "t1_dy_mm", "t1_dz_mm", "t2_dx_mm", "t2_dy_mm", "t2_dz_mm",
        "rx_mrad", "ry_mrad", "rz_mrad",
    ]  # fmt: skip
    assert [row[:2] for row in rows] == [["nominal", "1"], ["nominal", "2"], ["b", "1"], ["b", "2"]]
    assert [float(v) for v in rows[0][2:]] == [1, -2, 3, 0, 0, 0, 1, 0, 0]
    assert [float(v) for v in rows[1][2:]] == [0, 0, -1e-3, 0.5, 0, 0, 0, 0, -2]


def test_error_rows_of_one_point_without_orientation() -> None:
    header, rows = error_rows([method("nominal", [[[1e-3, -2e-3, 3e-3]]])])
    assert header == ["method", "configuration", "dx_mm", "dy_mm", "dz_mm"]
    assert [float(v) for v in rows[0][2:]] == [1, -2, 3]
