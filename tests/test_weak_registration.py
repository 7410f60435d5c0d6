"""Rows that hardly tell the set-up: nothing runs away, and what is not seen is named."""

from dataclasses import replace

import numpy as np
import pytest

from calibtool.calibration import identify
from calibtool.errors import NoSolutionError
from calibtool.measurement.checks.design import design_findings
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.registration import register
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.inverse import inverse_kinematics
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, readonly


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("ur5")


def poses(robot: Robot, shifts: Array, turns: Array, jitter: float = 0.0) -> Array:
    """Joints (N, n) at the home pose shifted (N, 3) m and turned (N, 3) rad in the base frame."""
    home = robot.workspace().home
    T = np.repeat(robot.mechanism.forward(home[None]), len(shifts), axis=0)
    T[:, :3, 3] += shifts
    T[:, :3, :3] = exp6(np.concatenate([0 * turns, turns], axis=1))[:, :3, :3] @ T[:, :3, :3]
    q = inverse_kinematics(robot, T, home).q
    return np.asarray(q + jitter * np.random.default_rng(1).normal(size=q.shape))


def designs(robot: Robot, name: str, jitter: float) -> Array:
    rng = np.random.default_rng(0)
    shifts, turns = rng.uniform(-0.15, 0.15, (40, 3)), np.zeros((40, 3))
    if name == "line":
        shifts = np.outer(np.linspace(-0.2, 0.2, 40), [0.0, 1.0, 0.0])
    if name == "plane":
        shifts[:, 2] = 0.0
    if name == "turning":
        turns = rng.uniform(-0.5, 0.5, (40, 3))
    if name == "one axis":
        turns[:, 2] = rng.uniform(-0.5, 0.5, 40)
    return poses(robot, shifts, turns, jitter)


def seen(robot: Robot, q: Array, targets: slice = slice(None)) -> Measurements:
    """Some targets by a tracker that stands anywhere, registered."""
    data = replace(simulate(robot, Simulation(seed=2, at=q, unregistered=True)), truth=None)
    setup = replace(data.setup, targets=readonly(data.setup.targets[targets]))
    data = replace(data, points=readonly(data.points[:, targets]), setup=setup)
    return replace(data, setup=register(data))


@pytest.mark.parametrize("jitter", [0.0, 1e-4])
@pytest.mark.parametrize(
    ("name", "targets"),
    [("orientation", slice(1)), ("line", slice(3)), ("one axis", slice(1)), ("line", slice(1))],
)
def test_targets_stay_on_the_tool(robot: Robot, name: str, targets: slice, jitter: float) -> None:
    """The tracker is 6.8 m away and the targets 0.15 m from the tool frame: both stay within 3 m,
    where the noise alone would put them anywhere."""
    data = seen(robot, designs(robot, name, jitter), targets)
    sets = [data.setup]
    try:
        sets.append(identify(data).base.setup)
    except NoSolutionError as error:
        assert "the rows hardly tell" in str(error)  # noqa: PT017
    for setup in sets:
        assert np.linalg.norm(setup.targets, axis=-1).max() < 3.0
        assert 4.0 < np.linalg.norm(setup.T_instrument_base[:3, 3]) < 10.0


def test_what_is_not_seen_is_named(robot: Robot) -> None:
    q = {name: designs(robot, name, 0.0) for name in ("orientation", "one axis", "turning")}
    found = {
        name: [f.message for f in design_findings(robot, q[name]) if f.name == "one_orientation"]
        for name in q
    }
    assert "keeps one orientation" in found["orientation"][0]
    assert "turns about one axis only" in found["one axis"][0]
    assert found["turning"] == []
    data = seen(robot, q["orientation"])
    named = identify(data).base.unobservable
    assert any("target" in text or "base" in text or "ζ7" in text for text in named)


def test_where_the_rows_tell_it_nothing_is_drawn_anywhere(robot: Robot) -> None:
    """The set-up is that of least squares alone: its residuals are orthogonal to what it can do."""
    data = simulate(robot, Simulation(seed=2, configurations=40, unregistered=True))
    truth = data.truth.setup if data.truth is not None else None
    assert truth is not None
    np.testing.assert_allclose(data.setup.targets, truth.targets, atol=10e-3)


def test_rows_of_which_none_sees_every_target(robot: Robot) -> None:
    data = simulate(robot, Simulation(seed=2, configurations=60, unregistered=True))
    whole = identify(replace(data, truth=None))
    points, k = data.points.copy(), np.arange(60)
    for i in range(3):
        points[k % 3 != i, i] = np.nan
    parts = replace(data, points=readonly(points), truth=None)
    parts = replace(parts, setup=register(parts))
    most = 1.2 * identify(replace(data, truth=None), "nominal").base.residual_rms[0]
    for model in ("nominal", "local-poe"):
        assert identify(parts, model).base.residual_rms[0] < most
    found = identify(parts)
    assert found.base.residual_rms[0] < 0.06e-3
    np.testing.assert_allclose(found.setup.targets, whole.setup.targets, atol=2e-3)


def test_a_target_that_is_never_seen_is_named(robot: Robot) -> None:
    data = simulate(robot, Simulation(seed=2, configurations=20, unregistered=True))
    points = data.points.copy()
    points[:, 1] = np.nan
    with pytest.raises(NoSolutionError, match="target 2 is seen in none of the 20"):
        register(replace(data, points=readonly(points), truth=None))
