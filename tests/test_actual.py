"""The actual robot of a simulation: every effect is what its formula says, of its stated size, and
switched on alone.
"""

from dataclasses import replace

import numpy as np
import pytest
from derivatives import assert_derivative, finite_differences
from poe import expm_chain, poe_frames, random_positions

from calibtool.errormodel.actual import ActualRobot, ErrorScales, random_actual
from calibtool.errormodel.families import ERROR_KINDS, FAMILIES
from calibtool.errormodel.family import Rows, offset_columns
from calibtool.errormodel.operating_conditions import REFERENCE_C
from calibtool.errormodel.placements import placement_columns
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errormodel.temperature import STEEL_EXPANSION
from calibtool.errormodel.twists import twist_columns
from calibtool.robot.catalogue import load_robot
from calibtool.robot.gravity_torque import gravity_torque
from calibtool.robot.mechanism import Frames
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, inverse, relative_error


def actual(robot: Robot, *kinds: str, seed: int = 3) -> ActualRobot:
    return random_actual(robot, ErrorScales(kinds=kinds), np.random.default_rng(seed))


def joint_motion(robot: ActualRobot, q: Array) -> Array:
    """Joint motion errors (N, n) of rows that are driven to in order, without constant offsets."""
    return robot.errors.motion(q, robot.driven_to(q))


def present(robot: ActualRobot) -> set[str]:
    """The kinds that are not zero."""
    return {family.kind for family in robot.errors.present}


# --- kinds ---


@pytest.mark.parametrize("kind", [kind for kind in ERROR_KINDS if kind != "payload"])
def test_each_kind_alone_moves_the_tool_and_leaves_the_others_out(
    fanuc: Robot, kind: str, rng: np.random.Generator
) -> None:
    robot = actual(fanuc, kind)
    assert present(robot) == {kind}
    q = random_positions(fanuc, rng, 5)
    moved = np.linalg.norm(
        robot.forward(q)[:, :3, 3] - fanuc.mechanism.forward(q)[:, :3, 3], axis=-1
    )
    assert (moved > 1e-6).all()
    assert (moved < 50e-3).all()


def test_without_a_kind_the_robot_is_the_nominal_one(
    robot: Robot, rng: np.random.Generator
) -> None:
    q = random_positions(robot, rng, 3)
    np.testing.assert_allclose(
        actual(robot).forward(q),
        expm_chain(robot.chain.placements, robot.chain.twists, q),
        atol=1e-12,
    )


@pytest.mark.parametrize("kind", ERROR_KINDS)
def test_switching_other_kinds_on_leaves_a_kind_as_it_was(fanuc: Robot, kind: str) -> None:
    alone, among_all = actual(fanuc, kind), actual(fanuc, *ERROR_KINDS)
    without = actual(fanuc, *(k for k in ERROR_KINDS if k != kind))
    assert present(among_all) == set(ERROR_KINDS)
    for family in FAMILIES:
        other = alone if family.kind == kind else without
        np.testing.assert_array_equal(among_all.errors[family.id], other.errors[family.id])


def test_the_seed_decides(fanuc: Robot) -> None:
    first, again, other = (actual(fanuc, *ERROR_KINDS, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.errors["placements"], again.errors["placements"])
    np.testing.assert_array_equal(first.errors["harmonics"], again.errors["harmonics"])
    assert (first.errors["placements"] != other.errors["placements"]).all()
    assert (first.errors["harmonics"] != other.errors["harmonics"]).all()


# --- geometry ---


def test_geometric_errors_have_the_stated_spread(rng: np.random.Generator) -> None:
    gantry = load_robot("gantry")
    scales = ErrorScales(length=2e-3, angle=0.3e-3)
    drawn = [random_actual(gantry, scales, child).errors for child in rng.spawn(200)]
    for twists in (
        np.array([g["placements"] for g in drawn]),
        np.array([g["twists"] for g in drawn]),
    ):
        assert twists[..., :3].std() == pytest.approx(2e-3, rel=0.05)
        assert twists[..., 3:].std() == pytest.approx(0.3e-3, rel=0.05)
        assert np.abs(twists.mean(axis=0)).max() < 5 * 2e-3 / np.sqrt(200)
    offsets = np.array([g["offsets"] for g in drawn])
    assert offsets[:, :3].std() == pytest.approx(2e-3, rel=0.1)  # slides: a length
    assert offsets[:, 3:].std() == pytest.approx(0.3e-3, rel=0.1)


def test_geometric_errors_are_finite_motions(robot: Robot, rng: np.random.Generator) -> None:
    errors = random_actual(robot, ErrorScales(length=0.05, angle=0.05), rng)
    q, geometry = random_positions(robot, rng, 3), errors.errors
    identity = np.array([np.eye(4)] * 2)
    placements = np.array(
        [
            M @ expm_chain(identity, x[None], np.ones((1, 1)))[0]
            for M, x in zip(robot.chain.placements, geometry["placements"], strict=True)
        ]
    )
    expected = expm_chain(
        placements, robot.chain.twists + geometry["twists"], q + geometry["offsets"]
    )
    np.testing.assert_allclose(errors.forward(q), expected, atol=1e-9)


@pytest.mark.parametrize(
    "kinds", [("geometric",), ("thermal",), ("gear",), ("gravity",), ERROR_KINDS]
)
@pytest.mark.parametrize("name", ["fanuc-m1000ia", "gantry"])
def test_small_errors_agree_with_the_linear_columns_to_second_order(
    name: str, kinds: tuple[str, ...], rng: np.random.Generator
) -> None:
    robot = load_robot(name)
    chain, q = robot.chain, random_positions(robot, rng, 5)
    plain = poe_frames(chain.placements, chain.twists, q)
    frames = Frames(plain.before, plain.after, plain.tool)
    drawn = actual(robot, *kinds)

    def left_over(scale: float) -> float:
        values = {name: scale * value for name, value in drawn.errors.values.items()}
        errors = replace(drawn, errors=RobotErrors.of(robot, **values))
        placements = errors.errors["placements"].copy()
        for j, M in enumerate(
            chain.placements
        ):  # growth is a shift along the link, seen in the joint's frame
            growth = errors.errors["temperature"][j] * (errors.temperature_c - REFERENCE_C)
            placements[j, :3] += growth * M[:3, :3].T @ M[:3, 3]
        placements = np.broadcast_to(placements, (len(q), *placements.shape)).copy()
        rows = Rows(robot, q, errors.driven_to(q, None))
        for family in FAMILIES:  # turns of the joint frames, about their own origins
            placements[:, :-1, 3:] += family.turn(errors.errors[family.id], rows)
        motion = errors.errors["offsets"] + joint_motion(errors, q)
        linear = (
            (placement_columns(frames) @ placements.reshape(len(q), -1, 1))[..., 0]
            + twist_columns(frames, chain.twists, q) @ errors.errors["twists"].ravel()
            + (offset_columns(frames, chain.twists) @ motion[..., None])[..., 0]
        )
        return float(np.abs(relative_error(errors.forward(q), frames.tool) - linear).max())

    whole, half = left_over(1.0), left_over(0.5)
    assert whole < 2e-4  # second order of millimetres, milliradians and metres
    assert whole < 1e-12 or 3.5 < whole / half < 4.5


# --- gears ---


def test_gear_errors_are_two_harmonics_of_the_commanded_position(
    fanuc: Robot, rng: np.random.Generator
) -> None:
    robot, q = actual(fanuc, "gear"), random_positions(fanuc, rng, 10)
    a1, b1, a2, b2 = robot.errors["harmonics"].T
    expected = a1 * np.sin(q) + b1 * np.cos(q) + a2 * np.sin(2 * q) + b2 * np.cos(2 * q)
    np.testing.assert_allclose(joint_motion(robot, q), expected, atol=1e-16)
    np.testing.assert_allclose(
        robot.forward(q),
        expm_chain(fanuc.chain.placements, fanuc.chain.twists, q + expected),
        atol=1e-12,
    )


def test_gear_errors_have_the_stated_spread_and_slides_have_no_gears(
    rng: np.random.Generator,
) -> None:
    gantry = load_robot("gantry")
    scales = ErrorScales(kinds=("gear",), sizes={"gear": 0.4e-3})
    drawn = np.array(
        [random_actual(gantry, scales, child).errors["harmonics"] for child in rng.spawn(300)]
    )
    assert not drawn[:, :3].any()
    np.testing.assert_allclose(drawn[:, 3:].std(axis=0), 0.4e-3, rtol=0.2)


# --- gravity ---


def potential_energy(robot: Robot, q: Array) -> float:
    """Σ m g h over the links, J; for a URDF without masses of uniform links of 1 kg/m
    from joint to joint.
    """
    after = poe_frames(robot.chain.placements, robot.chain.twists, q[None]).after[0]
    inertias = list(robot.chain.model.inertias)[1:]
    weightless = sum(inertia.mass for inertia in inertias) == 0
    total = 0.0
    for j in range(robot.n):
        if weightless:
            link = robot.chain.placements[j + 1][:3, 3]
            mass, centre = float(np.linalg.norm(link)), link / 2
        else:
            mass, centre = inertias[j].mass, inertias[j].lever
        total += mass * 9.81 * (after[j, :3, :3] @ centre + after[j, :3, 3])[2]
    return total


def test_gravity_torque_is_the_derivative_of_the_potential_energy(
    robot: Robot, rng: np.random.Generator
) -> None:
    for q in random_positions(robot, rng, 2):
        torque = gravity_torque(robot, q[None])
        assert_derivative(lambda x: np.array([potential_energy(robot, x)]), torque, q)


def test_joints_wind_up_in_the_direction_of_the_weight(
    robot: Robot, rng: np.random.Generator
) -> None:
    sagging, q = actual(robot, "gravity"), random_positions(robot, rng, 3)
    motion = joint_motion(sagging, q)
    np.testing.assert_allclose(
        motion, -sagging.errors["gravity"] * gravity_torque(robot, q), atol=1e-18
    )
    for row, step in zip(q, motion, strict=True):
        slope = finite_differences(lambda x: np.array(potential_energy(robot, x)), row)
        assert slope @ step <= 1e-12  # every joint gives way downhill


@pytest.mark.parametrize(
    ("name", "carrying"),
    [
        (
            "fanuc-m1000ia",
            {1, 2},
        ),  # upper arm and forearm; the wrist's links of 0.385 m weigh little beside them
        ("scara", set()),
        ("planar-3r", set()),
        ("gantry", {4}),
        ("ur5", {1, 2}),  # 1.4 kg of wrist at 0.1 m weigh little beside 12 kg at up to 0.8 m
    ],
)
def test_only_joints_that_carry_load_wind_up(name: str, carrying: set[int]) -> None:
    assert set(np.flatnonzero(actual(load_robot(name), "gravity").errors["gravity"])) == carrying


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "ur5", "kinova", "panda", "gantry"])
def test_the_largest_wind_up_is_the_stated_one(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    sagging = random_actual(robot, ErrorScales(kinds=("gravity",), sizes={"gravity": 0.8e-3}), rng)
    largest = np.abs(joint_motion(sagging, random_positions(robot, rng, 2000))).max(axis=0)
    carrying = sagging.errors["gravity"] > 0
    assert carrying.any()
    np.testing.assert_allclose(largest[carrying], 0.8e-3, rtol=0.15)
    assert not largest[~carrying].any()


# --- backlash ---


def test_backlash_leaves_a_joint_behind_its_motion(fanuc: Robot) -> None:
    home = fanuc.workspace().home
    up, down = home + 0.1, home - 0.2
    widths = np.array([1e-4, 2e-4, 3e-4, 4e-4, 5e-4, 6e-4])
    robot = ActualRobot(RobotErrors.of(fanuc, backlash=widths))
    motion = joint_motion(robot, np.array([up, down, up, up + 0.1, down]))
    expected = np.array([-1, 1, -1, -1, 1])[:, None] * robot.errors["backlash"]
    np.testing.assert_allclose(motion, expected, atol=1e-18)


def test_backlash_knows_the_direction_of_each_joint(fanuc: Robot) -> None:
    home = fanuc.workspace().home
    direction = np.array([1, -1, 1, 1, -1, -1])
    robot = actual(fanuc, "backlash")
    assert (robot.errors["backlash"] == 0.1e-3).all()
    np.testing.assert_allclose(
        joint_motion(robot, home[None] + 0.1 * direction), -0.1e-3 * direction[None], atol=1e-18
    )


def test_a_joint_that_stands_still_stays_on_the_side_of_its_last_motion(fanuc: Robot) -> None:
    home = fanuc.workspace().home
    q = np.array([home + 0.1, home + 0.1])
    q[1, 0] += 0.1  # only joint 1 goes on
    motion = joint_motion(actual(fanuc, "backlash"), q)
    np.testing.assert_allclose(motion, -0.1e-3, atol=1e-18)


# --- heat ---


@pytest.mark.parametrize(
    "name", ["fanuc-m1000ia", "fanuc-m900ib-700", "ur5", "panda", "kinova", "planar-3r"]
)
def test_a_warm_arm_is_the_same_arm_enlarged(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    q = random_positions(robot, rng, 5)
    warm = random_actual(robot, ErrorScales(kinds=("thermal",), warmth=50.0), rng)
    nominal, pose = robot.mechanism.forward(q), warm.forward(q)
    np.testing.assert_allclose(
        pose[:, :3, 3], nominal[:, :3, 3] * (1 + 50.0 * STEEL_EXPANSION), atol=1e-12
    )
    np.testing.assert_allclose(pose[:, :3, :3], nominal[:, :3, :3], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "slides"), [("scara", [[0, 0, -1]]), ("gantry", [[1, 0, 0], [0, 1, 0], [0, 0, -1]])]
)
def test_heat_does_not_change_what_a_slide_is_commanded(
    name: str, slides: list[list[float]], rng: np.random.Generator
) -> None:
    robot = load_robot(name)
    q = random_positions(robot, rng, 5)
    warm = actual(robot, "thermal")
    stroke = q[:, robot.prismatic] @ np.array(
        slides, dtype=float
    )  # the axes do not turn with the joints before them
    links = robot.mechanism.forward(q)[:, :3, 3] - stroke
    np.testing.assert_allclose(warm.forward(q)[:, :3, 3], links * (1 + 120e-6) + stroke, atol=1e-12)


def test_ten_kelvin_on_a_metre_of_steel_are_an_eighth_of_a_millimetre(fanuc: Robot) -> None:
    warm = actual(fanuc, "thermal")
    growth = warm.errors["temperature"] * (warm.temperature_c - REFERENCE_C)
    np.testing.assert_allclose(growth, 0.12e-3)  # 12 µm/m/K


def test_heat_and_geometric_errors_multiply(fanuc: Robot, rng: np.random.Generator) -> None:
    # M grown, then exp6(δζ): relative to the cold robot every placement is the growth in front
    # of the same error.
    both, cold = actual(fanuc, "geometric", "thermal"), actual(fanuc, "geometric")
    grown = fanuc.chain.placements.copy()
    grown[:, :3, 3] *= 1 + 10.0 * STEEL_EXPANSION
    q = random_positions(fanuc, rng, 3)
    placements = (
        grown
        @ inverse(fanuc.chain.placements)
        @ fanuc.chain.placements
        @ exp6(cold.errors["placements"])
    )
    geometry = cold.errors
    expected = expm_chain(
        placements, fanuc.chain.twists + geometry["twists"], q + geometry["offsets"]
    )
    np.testing.assert_allclose(both.forward(q), expected, atol=1e-9)
