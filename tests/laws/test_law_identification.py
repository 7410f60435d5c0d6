"""Laws of the estimators: what must not matter, what must come out, and how sure it may be."""

from dataclasses import replace

import numpy as np
import pytest
from cases import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2, norm
from strategies import (
    DrawnChain,
    assume_regular,
    configurations,
    drawn_chains,
    measured,
    perfect,
    robots,
    seeds,
    simulated,
)

from calibtool.calibration import Calibration, identify
from calibtool.calibration.fit import BaseOptions
from calibtool.errormodel.actual import ActualRobot, ErrorScales, random_actual
from calibtool.errormodel.families import FAMILIES
from calibtool.errormodel.tolerances import Tolerances
from calibtool.identification.complete import CompleteOptions, identify_complete
from calibtool.identification.local_poe import identify_local_poe
from calibtool.identification.parameters import State
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import residuals, weights
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, inverse, readonly, transform_points

GEOMETRIC = ErrorScales()
# Nothing is chosen by evidence, so that a rounding error cannot tip a choice, and nothing hangs on
# the direction of gravity, which a base that stands elsewhere has in another direction.
NOTHING = {family.id: 0 for family in FAMILIES if not family.always}
PLAIN = BaseOptions(
    "complete", CompleteOptions(orders=NOTHING | {"harmonics": 1, "twists": 1, "wobble": 1})
)
MODELS = st.sampled_from([BaseOptions("local-poe"), PLAIN, BaseOptions("nominal")])


def identified(measurements: Measurements, options: BaseOptions) -> Calibration:
    assume_regular(measurements.robot)
    return identify(measurements, options)


def difference(a: Calibration, b: Calibration, q: Array) -> float:
    """Largest difference of predicted pose elements over their size."""
    poses = a.forward(q), b.forward(q)
    return float(np.abs(poses[0] - poses[1]).max() / max(1.0, float(np.abs(poses[0]).max())))


# --- what must not matter -------------------------------------------------------------------------


@examples(8)
@given(robots(), seeds, MODELS)
def test_order_of_rows_does_not_matter(robot: Robot, seed: int, options: BaseOptions) -> None:
    rng = np.random.default_rng(seed)
    data = simulated(robot, rng, 25)
    shuffled = data.rows(rng.permutation(25))
    assert difference(identified(data, options), identified(shuffled, options), data.q) < 1e-9


@examples(8)
@given(drawn_chains(), seeds, MODELS)
def test_where_the_base_stands_does_not_matter(
    chain: DrawnChain, seed: int, options: BaseOptions
) -> None:
    """The same points told in another base frame: the same poses, told in that frame."""
    rng = np.random.default_rng(seed)
    data = simulated(chain.robot(), rng, 25, scales=GEOMETRIC)
    base = rng.uniform(-2, 2, 6)
    standing = chain.robot(base=base)
    stand = (
        standing.mechanism.forward(data.q[:1])[0]
        @ inverse(chain.robot().mechanism.forward(data.q[:1]))[0]
    )
    moved = replace(
        data, robot=standing, points=readonly(transform_points(stand, data.points)), truth=None
    )
    first, second = identified(data, options), identified(moved, options)
    np.testing.assert_allclose(second.forward(data.q), stand @ first.forward(data.q), atol=1e-8)


@examples(8)
@given(robots(), seeds, MODELS, st.booleans())
def test_where_the_instrument_stands_does_not_matter(
    robot: Robot, seed: int, options: BaseOptions, pose: bool
) -> None:
    rng = np.random.default_rng(seed)
    data = simulated(robot, rng, 25, pose=pose)
    frame = exp6(rng.uniform(-3, 3, 6))
    moved = replace(
        data,
        points=readonly(transform_points(frame, data.points)),
        rotations=None if data.rotations is None else readonly(frame[:3, :3] @ data.rotations),
        setup=replace(data.setup, T_instrument_base=readonly(frame)),
    )
    assert difference(identified(data, options), identified(moved, options), data.q) < 1e-8


@examples(8)
@given(robots(), seeds, MODELS)
def test_targets_that_were_not_seen_change_nothing_else(
    robot: Robot, seed: int, options: BaseOptions
) -> None:
    """A row of three targets is the same as two rows of it, in which one and the
    other two were seen, where no row is judged as a whole (`isolated`).
    """
    options = replace(options, complete=replace(options.complete, loss_function="squared"))
    rng = np.random.default_rng(seed)
    data = simulated(robot, rng, 20)
    one, two = data.points.copy(), data.points.copy()
    one[:, :-1], two[:, -1] = np.nan, np.nan
    twice = replace(
        data,
        q=readonly(np.tile(data.q, (2, 1))),
        points=readonly(np.concatenate([one, two])),
        truth=None,
    )
    pose = robot.mechanism.forward(data.q)
    whole = residuals(data, data.setup, pose) * weights(data)
    split = residuals(twice, data.setup, np.tile(pose, (2, 1, 1))) * weights(twice)
    assert np.array_equal(whole, split[:20] + split[20:])
    assert difference(identified(data, options), identified(twice, options), data.q) < 1e-9


# --- what must come out ---------------------------------------------------------------------------


@examples(10)
@given(robots(), seeds, st.sampled_from(["nominal", "local-poe", "complete"]), st.booleans())
def test_zero_errors_are_found_as_zero(robot: Robot, seed: int, model: str, pose: bool) -> None:
    rng = np.random.default_rng(seed)
    data = measured(robot, configurations(robot, 20, rng), perfect(robot), rng, pose=pose)
    found = identified(data, BaseOptions(model)).base
    for errors in (
        found.errors["placements"],
        found.errors["twists"],
        found.errors["offsets"],
        found.errors["harmonics"],
    ):
        assert np.abs(errors).max(initial=0.0) < 1e-9


@examples(6)
@given(robots(), seeds, st.sampled_from(["local-poe", "complete"]))
def test_errors_without_noise_are_found_where_they_can_be_seen(
    robot: Robot, seed: int, model: str
) -> None:
    """Predicted and actual poses of the measured configurations agree a thousand times
    better than before.
    """
    rng = np.random.default_rng(seed)
    actual = random_actual(robot, GEOMETRIC, rng)
    if model == "local-poe":
        actual = without_twists(actual)
    data = measured(robot, configurations(robot, 60, rng), actual, rng, noise=0.0)
    data = replace(data, noise_position=1e-8)
    found = identified(data, BaseOptions(model))
    true, nominal = actual.forward(data.q), robot.mechanism.forward(data.q)
    left, before = (
        np.linalg.norm((true - pose)[:, :3, 3], axis=-1).max()
        for pose in (found.forward(data.q), nominal)
    )
    assert left < 1e-3 * before + 1e-9


def without_twists(actual: ActualRobot) -> ActualRobot:
    return replace(actual, errors=actual.errors.without("twists"))


# --- how sure it may be ---------------------------------------------------------------------------

FALSE_ALARM = 1e-5  # of each bound, so that fewer than one in 10,000 correct programs fail here
ROBOTS = 100


def test_errors_are_recovered_within_their_covariance() -> None:
    """(θ̂ − θ)ᵀ C⁻¹ (θ̂ − θ) is χ² with one degree of freedom per parameter, if θ is
    drawn from the prior.
    """
    tolerances = Tolerances(length=0.3e-3, angle=0.3e-3)
    options = CompleteOptions(
        tolerances, {"harmonics": 0, "gravity": 0, "twists": 1}, estimate_priors=False
    )
    robot = load_robot("scara")
    distances, scores, parameters = [], [], 0
    for seed in range(ROBOTS):
        rng = np.random.default_rng(seed)
        actual = random_actual(robot, ErrorScales(length=0.3e-3, angle=0.3e-3), rng)
        data = measured(robot, configurations(robot, 60, rng), actual, rng, noise=0.05e-3)
        posterior = (found := identify_complete(data, options)).posterior
        assert posterior is not None
        parameters = posterior.parameters.count
        true = State(actual.errors, found.setup).vector(posterior.parameters)
        off = found.state.vector(posterior.parameters) - true
        distances.append(off @ np.linalg.solve(posterior.covariance, off))
        scores.append(off / posterior.std)
    # The noise is estimated from about 500 residuals beyond the parameters: their spread adds 2 %
    # to that of the sum.
    low, high = chi2.ppf([FALSE_ALARM, 1 - FALSE_ALARM], ROBOTS * parameters)
    total = float(np.sum(distances))
    margin = 0.02 * (high - low)
    assert low - margin < total < high + margin
    # No parameter is biased: the mean of its scores is that of 100 standard normal ones.
    largest = norm.isf(FALSE_ALARM / (2 * parameters)) / np.sqrt(ROBOTS)
    assert np.abs(np.mean(scores, axis=0)).max() < 1.02 * largest


@pytest.mark.parametrize("name", ["planar-3r", "gantry"])
def test_what_local_poe_leaves_over_is_noise(name: str) -> None:
    """The weighted squares left by the fit are χ² with equations minus rank degrees of freedom."""
    robot = load_robot(name)
    squares, freedom = 0.0, 0
    for seed in range(ROBOTS):
        rng = np.random.default_rng(seed)
        actual = without_twists(random_actual(robot, ErrorScales(length=0.1e-3, angle=0.1e-3), rng))
        actual = replace(actual, errors=actual.errors.without("offsets"))
        data = measured(robot, configurations(robot, 12, rng), actual, rng, noise=0.05e-3)
        found = identify_local_poe(data)
        left = residuals(data, data.setup, found.errors.frames(data.q).tool) * weights(data)
        squares += float((left**2).sum())
        freedom += data.equations - found.rank
    low, high = chi2.ppf([FALSE_ALARM, 1 - FALSE_ALARM], freedom)
    assert low < squares < high


@examples(6)
@given(
    drawn_chains(largest=7, kinds=("revolute", "continuous")),
    seeds,
    st.sampled_from([0.05, 20.0]),
    MODELS,
)
def test_lengths_times_s_give_position_errors_times_s(
    chain: DrawnChain, seed: int, scale: float, options: BaseOptions
) -> None:
    """Lengths, their tolerances and the noise times s: the same turns, positions times s."""
    rng = np.random.default_rng(seed)
    data = simulated(chain.robot(), rng, 25, scales=GEOMETRIC)
    scaled = replace(
        data,
        robot=chain.robot(scale=scale),
        points=readonly(data.points * scale),
        setup=replace(data.setup, targets=readonly(data.setup.targets * scale)),
        noise_position=data.noise_position * scale,
        truth=None,
    )
    first, second = (
        identified(data, options).forward(data.q),
        identified(scaled, options).forward(data.q),
    )
    np.testing.assert_allclose(second[:, :3, :3], first[:, :3, :3], atol=1e-9)
    np.testing.assert_allclose(second[:, :3, 3] / scale, first[:, :3, 3], atol=1e-9)
