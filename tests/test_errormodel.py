"""Families of errors: what each does to the robot, computed apart; columns are derivatives;
conditions are used.
"""

from dataclasses import replace

import numpy as np
import pytest
from derivatives import assert_derivative
from poe import expm_chain, random_positions

from calibtool.calibration import identify
from calibtool.errormodel.actual import ActualRobot, ErrorScales, random_actual
from calibtool.errormodel.families import BY_ID, ERROR_KINDS, FAMILIES
from calibtool.errormodel.family import Family
from calibtool.errormodel.operating_conditions import REFERENCE_C, Conditions
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import InputError
from calibtool.evaluation.compare import evaluate
from calibtool.identification.complete import CompleteOptions, identify_complete
from calibtool.identification.parameters import Parameters
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, relative_error

STEP = {
    "payload": 1e-7,
    "gravity": 1e-7,
    "bending": 1e-7,
    "temperature": 1e-6,
}  # rad per N m and 1/K are small numbers


def conditions(robot: Robot, count: int, rng: np.random.Generator) -> Conditions:
    return Conditions(
        direction=rng.choice([-1.0, 1.0], (count, robot.n)),
        payload_kg=rng.uniform(2, 10, count),
        temperature_c=rng.uniform(25, 35, count),
    )


def all_errors(robot: Robot, rng: np.random.Generator) -> RobotErrors:
    """A millimetre, a milliradian or what amounts to it in every element of every family."""
    values = {}
    for family in FAMILIES:
        shape = family.shape(robot.n, 2)
        values[family.id] = (
            rng.normal(size=shape) * STEP.get(family.id, 1e-3) * family.free(robot, shape)
        )
    return RobotErrors.of(robot, **values)


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.id)
@pytest.mark.parametrize("name", ["ur5", "scara", "gantry"])
def test_columns_are_derivatives_away_from_the_nominal_robot(
    name: str, family: Family, rng: np.random.Generator
) -> None:
    robot = load_robot(name)
    errors, q, rows = (
        all_errors(robot, rng),
        random_positions(robot, rng, 1),
        conditions(robot, 1, rng),
    )
    shape, scale = family.shape(robot.n, 2), 1e3 * STEP.get(family.id, 1e-3)
    start = errors.forward(q, rows)

    def moved(x: Array) -> Array:
        return relative_error(
            errors.moved(**{family.id: x.reshape(shape) * scale}).forward(q, rows), start
        )[0]

    found = family.columns(shape, errors.context(q, rows))[0] * scale
    # Of a turn the first order is enough: other errors are a thousandth.
    tolerance = 5e-3 if family.turns else 1e-6
    assert_derivative(
        moved,
        found,
        np.zeros(int(np.prod(shape))),
        tolerance=tolerance * min(1.0, np.abs(found).max()),
    )


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.id)
def test_a_family_states_the_same_of_every_element(fanuc: Robot, family: Family) -> None:
    shape = family.shape(6, 2)
    size = int(np.prod(shape))
    names = family.names(shape, family.ascii)
    assert len(set(names)) == size
    assert all(name.isascii() for name in names)
    factor, units = family.display(fanuc, shape)
    assert factor.shape == family.free(fanuc, shape).shape == family.groups(shape).shape == shape
    assert len(units) == size
    assert family.order(family.shape(6, family.orders[-1])) == family.orders[-1]


def test_values_of_another_shape_or_family_are_refused(fanuc: Robot) -> None:
    for values in (
        {"gravity": np.zeros(5)},
        {"placements": np.zeros((6, 6))},
        {"harmonics": np.zeros(6)},
    ):
        with pytest.raises(ValueError, match="expected shape"):
            RobotErrors.of(fanuc, **values)
    with pytest.raises(ValueError, match="friction"):
        RobotErrors.of(fanuc, friction=np.zeros(6))


# --- payload and temperature, computed apart ------------------------------------------------------


def test_a_mass_winds_joints_up_and_bends_them_by_its_moment(rng: np.random.Generator) -> None:
    """c m along the axis, b m across it, m = (p_tool − p_joint) × weight; poses by scipy's
    matrix exponential.
    """
    robot, mass = load_robot("ur5"), 7.0
    chain, q = robot.chain, random_positions(robot, rng, 1)
    wind, bend = rng.uniform(1, 3, (2, 6)) * 1e-6
    errors = RobotErrors.of(robot, payload=np.stack([wind, bend], axis=-1))
    frames = robot.mechanism.frames(q)
    placements, driven = chain.placements.copy(), q.copy()
    for j in range(6):
        F0 = frames.before[0, j]
        moment = np.cross(frames.tool[0, :3, 3] - F0[:3, 3], [0.0, 0.0, -9.81 * mass])
        axis = F0[:3, :3] @ chain.twists[j, 3:]
        driven[0, j] += wind[j] * axis @ moment
        across = F0[:3, :3].T @ (moment - axis * (axis @ moment))
        placements[j] = placements[j] @ exp6(np.concatenate([np.zeros(3), bend[j] * across]))
    expected = expm_chain(placements, chain.twists, driven)
    found = errors.forward(q, Conditions(payload_kg=np.array([mass])))
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert np.abs(found - robot.mechanism.forward(q))[0, :3, 3].max() > 1e-5


def test_links_grow_each_by_its_own_coefficient(rng: np.random.Generator) -> None:
    robot = load_robot("scara")
    growth, q = rng.uniform(5e-6, 30e-6, robot.n + 1), random_positions(robot, rng, 3)
    warmth = np.array([-10.0, 0.0, 25.0])
    found = RobotErrors.of(robot, temperature=growth).forward(
        q, Conditions(temperature_c=REFERENCE_C + warmth)
    )
    for k, rise in enumerate(warmth):
        placements = robot.chain.placements.copy()
        placements[:, :3, 3] *= (1 + growth * rise)[:, None]
        np.testing.assert_allclose(
            found[k], expm_chain(placements, robot.chain.twists, q[k : k + 1])[0], atol=1e-12
        )


@pytest.mark.parametrize("name", ["ur5", "gantry"])
def test_rows_answer_alike_together_and_alone(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    errors, q, rows = (
        all_errors(robot, rng),
        random_positions(robot, rng, 5),
        conditions(robot, 5, rng),
    )
    together, frames = errors.forward(q, rows), errors.frames(q, rows)
    mechanism, driven = errors.at(q, rows)
    np.testing.assert_array_equal(mechanism.forward_and_jacobian(driven)[0], together)
    np.testing.assert_allclose(frames.tool, together, atol=1e-15)
    for k in range(5):
        one = np.array([k])
        np.testing.assert_array_equal(errors.forward(q[one], rows.rows(one))[0], together[k])


def test_no_mass_and_the_reference_temperature_change_nothing(
    fanuc: Robot, rng: np.random.Generator
) -> None:
    q = random_positions(fanuc, rng, 3)
    errors = all_errors(fanuc, rng)
    without = errors.without("payload", "temperature")
    for rows in (
        Conditions(),
        Conditions(payload_kg=np.zeros(3), temperature_c=np.full(3, REFERENCE_C)),
    ):
        np.testing.assert_array_equal(errors.forward(q, rows), without.forward(q, rows))


@pytest.mark.parametrize(
    ("kwargs", "what"),
    [
        ({"payload_kg": np.array([1.0, -2.0, 0.0])}, "payload_kg"),
        ({"payload_kg": np.array([1.0, np.nan, 0.0])}, "payload_kg"),
        ({"temperature_c": np.array([20.0, 21.0])}, "temperature_c"),
        ({"temperature_c": np.array([20.0, 21.0, -300.0])}, "temperature_c"),
        ({"direction": np.full((3, 6), 0.5)}, "directions"),
    ],
)
def test_conditions_that_cannot_be_are_refused(kwargs: dict, what: str) -> None:
    measurements = simulate(load_robot("ur5"), Simulation(configurations=3, workspace="full"))
    with pytest.raises(InputError, match=what):
        replace(measurements, conditions=Conditions(**kwargs))


# --- identified -----------------------------------------------------------------------------------


def simulated(
    kinds: tuple[str, ...], seed: int = 1, count: int = 80, **more: object
) -> Measurements:
    scales = ErrorScales(
        ("geometric", *kinds), sizes={"payload": 1.5e-3} if "payload" in kinds else {}
    )
    return simulate(
        load_robot("ur5"),
        Simulation(seed=seed, configurations=count, workspace="full", scales=scales, **more),
    )


def again(measurements: Measurements, **more: object) -> Measurements:
    simulation = Simulation(
        seed=77,
        configurations=300,
        same_robot=measurements.truth,
        noise=0.0,
        workspace="full",
        **more,
    )
    return simulate(measurements.robot, simulation)


@pytest.mark.parametrize(
    ("kind", "family", "condition"),
    [
        ("payload", "payload", {"payload_kg": (0.0, 10.0)}),
        ("thermal", "temperature", {"temperature_c": (20.0, 60.0)}),
    ],
)
def test_evidence_finds_what_depends_on_the_row_and_predicts_by_it(
    kind: str, family: str, condition: dict
) -> None:
    measurements = simulated((kind,), **condition)
    calibration = identify(measurements, "complete")
    assert family in calibration.base.posterior.parameters.orders
    fresh = again(measurements, **condition)
    poses = calibration.forward(fresh.q, fresh.conditions)
    truth = fresh.truth.actual.forward(fresh.q, fresh.conditions)
    left = np.linalg.norm((poses - truth)[:, :3, 3], axis=-1).mean()
    blind = identify_complete(measurements, CompleteOptions(orders={family: 0})).errors.forward(
        fresh.q
    )
    without = np.linalg.norm((blind - truth)[:, :3, 3], axis=-1).mean()
    assert left < 0.5 * without


def test_nothing_is_found_where_nothing_depends_on_the_row() -> None:
    found = identify_complete(
        simulated((), payload_kg=(0.0, 10.0), temperature_c=(20.0, 35.0))
    ).posterior
    assert not {"payload", "temperature"} & set(found.parameters.orders)


def test_a_family_is_refused_where_its_condition_is_unknown() -> None:
    for family, words in (("payload", "mass"), ("temperature", "temperatures")):
        with pytest.raises(InputError, match=words):
            identify_complete(simulated(()), CompleteOptions(orders={family: 1}))


def test_corrections_are_for_the_payload_and_temperature_of_every_row() -> None:
    condition = {"payload_kg": (0.0, 10.0), "temperature_c": (20.0, 35.0)}
    measurements = simulated(("payload", "thermal"), **condition)
    calibration = identify(measurements, "complete")
    fresh = again(measurements, **condition)
    fresh = fresh.rows(np.arange(0, 300, 10))
    together = evaluate([("found", calibration)], fresh).methods[1]
    blind = evaluate(
        [("blind", identify_complete_without(measurements, calibration))], fresh
    ).methods[1]
    assert (
        np.linalg.norm(together.position, axis=-1).mean()
        < 0.5 * np.linalg.norm(blind.position, axis=-1).mean()
    )


def identify_complete_without(measurements: Measurements, like: object) -> object:
    base = identify_complete(measurements, CompleteOptions(orders={"payload": 0, "temperature": 0}))
    return replace(like, base=base)


def test_the_description_states_where_the_robot_hangs_and_what_it_carries() -> None:
    """Upside down everything bends the other way; a payload of the description holds where rows do
    not state otherwise.
    """
    source = load_robot("ur5").source
    rng = np.random.default_rng(0)

    def mounted(text: str) -> Robot:
        from calibtool.robot.source import parse_source

        return Robot.from_source(parse_source(source.toml_text + text, source.urdf_text, "here"))

    up, down = (
        mounted("\n[mounting]\npayload_kg = 5.0\n"),
        mounted("\n[mounting]\npayload_kg = 5.0\ngravity = [0, 0, 2]\n"),
    )
    q = random_positions(up, rng, 4)
    value = np.full((6, 2), 1e-6)
    here, there = (RobotErrors.of(robot, payload=value).motion(q) for robot in (up, down))
    np.testing.assert_allclose(here, -there, atol=1e-15)
    np.testing.assert_allclose(
        here, RobotErrors.of(up, payload=value).motion(q, Conditions(payload_kg=np.full(4, 5.0)))
    )
    assert not RobotErrors.of(up, payload=value).motion(q, Conditions(payload_kg=np.zeros(4))).any()
    with pytest.raises(InputError, match="no direction"):
        mounted("\n[mounting]\ngravity = [0, 0, 0]\n")


def test_kinds_of_simulated_errors_are_those_of_the_families(fanuc: Robot) -> None:
    assert set(ERROR_KINDS) == {family.kind for family in FAMILIES}
    drawn: ActualRobot = random_actual(fanuc, ErrorScales(ERROR_KINDS), np.random.default_rng(0))
    assert {family.id for family in drawn.errors.present} == set(BY_ID) - {"pairs"}


def test_parameters_are_those_of_their_families(fanuc: Robot) -> None:
    measurements = simulate(
        fanuc, Simulation(configurations=2, unregistered=True, workspace="full")
    )
    parameters = Parameters.of(
        fanuc, measurements.setup, twists=1, harmonics=2, gravity=1, backlash=1, payload=1
    )
    names = parameters.ids
    assert len(names) == len(set(names)) == parameters.count == len(parameters.prior_std())
    assert all(name.isascii() for name in names)
    assert sorted(np.concatenate(parameters.groups)) == list(range(parameters.blocks["base"].start))


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.id)
def test_no_rows_have_no_errors(family: Family, fanuc: Robot, rng: np.random.Generator) -> None:
    """A table without rows is a table: every family answers with as many rows."""
    errors, none = all_errors(fanuc, rng), np.zeros((0, fanuc.n))
    alone = RobotErrors.of(fanuc, **{family.id: errors[family.id]})
    rows = conditions(fanuc, 0, rng)
    assert alone.forward(none, rows).shape == (0, 4, 4)
    shape = errors[family.id].shape
    found = family.columns(shape, alone.context(none, rows))
    assert found.shape == (0, 6, int(np.prod(shape)))
