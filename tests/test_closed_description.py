"""What a description with closed loops says, and what is wrong in it, in one line with the loop's
name.
"""

from pathlib import Path

import numpy as np
import pytest
from closed_texts import changed, joint, robot_of, written

from calibtool.errors import InputError
from calibtool.evaluation.robot_check import check_robot
from calibtool.robot.catalogue import load_robot
from calibtool.robot.plausibility import implausible

LOOP, BALL = 'joint = "planar"', 'joint = "spherical"'
R1 = (
    'rpy="3.141592653589793 -0.22409309230137087 3.141592653589793"/><axis xyz="0 1 0"/>'
    '<limit lower="-3.1"'
)


# --- reduction ---


@pytest.mark.parametrize(
    ("name", "passive", "mobility"),
    [
        ("fivebar", 2, 2),
        ("hexapod", 15, 6),
        ("delta", 15, 3),
        ("prs3", 6, 3),
        ("palletizer", 2, 6),
        ("palletizer-level", 6, 4),
        ("hybrid", 6, 5),
    ],
)
def test_the_mobility_is_that_of_the_textbook(name: str, passive: int, mobility: int) -> None:
    chain = load_robot(name).chain
    assert chain.mobility == mobility == chain.n
    assert chain.tree.p == passive
    assert chain.tree.joints == chain.n + passive


def test_a_revolute_cut_of_a_planar_loop_keeps_what_the_plane_sees() -> None:
    """Five equations, of which three say nothing that the others do not."""
    robot = changed("fivebar", (LOOP, 'joint = "revolute"'))
    assert [loop.rows for loop in robot.chain.tree.loops] == [(0, 1)]
    expected = load_robot("fivebar")
    q = expected.workspace("full").home[None] + np.array([[0.1, -0.2], [0.0, 0.3]])
    np.testing.assert_allclose(
        robot.mechanism.forward(q), expected.mechanism.forward(q), atol=1e-12
    )


def test_the_spin_of_a_rod_is_idle() -> None:
    """A joint more along the second leg of the hexapod, before its ball: the rod can turn about
    itself.
    """
    fixed = '<joint name="rod2_end_fix" type="fixed">'
    robot = changed("hexapod", (fixed, '<joint name="spin" type="continuous"><axis xyz="0 0 1"/>'))
    tree = robot.chain.tree
    assert robot.chain.bodies.joints[tree.n + tree.p :] == ("spin",)
    q = robot.workspace().home[None] + 0.02 * np.arange(6)
    expected = load_robot("hexapod").mechanism.forward_and_jacobian(q)
    for found, truth in zip(robot.mechanism.forward_and_jacobian(q), expected, strict=True):
        np.testing.assert_allclose(found, truth, atol=1e-11)


def test_joints_between_other_loops_may_stand_in_any_order() -> None:
    """Which frame is A and which is B, and the order of the loops, change no pose."""
    robot = changed(
        "delta",
        ('["platform_12", "rod12_end"]', '["rod12_end", "platform_12"]'),
        ('["platform_21", "rod21_end"]', '["rod21_end", "platform_21"]'),
    )
    q = robot.workspace("full").home[None] + np.array([[0.1, -0.2, 0.05]])
    np.testing.assert_allclose(
        robot.mechanism.forward(q), load_robot("delta").mechanism.forward(q), atol=1e-12
    )


# --- mimic joints ---

FOLLOWING = '<mimic joint="a" multiplier="-1" offset="0.2"/>'


def test_a_mimic_joint_is_a_constraint() -> None:
    """Two links whose second joint turns back what the first turned: the tool keeps its
    orientation.
    """
    urdf = (
        joint("a", "base", "one")
        + joint("b", "one", "two", "0.4 0 0", more=FOLLOWING)
        + joint("f", "two", "tool", "0.3 0 0", "fixed")
    )
    robot = robot_of(urdf, "")
    assert (robot.n, robot.chain.bodies.joints) == (1, ("a", "b"))
    q = np.linspace(-2.5, 2.5, 7)[:, None]
    pose, jacobian = robot.mechanism.forward_and_jacobian(q)
    expected = np.stack(
        [
            0.4 * np.cos(q[:, 0]) + 0.3 * np.cos(0.2),
            0.4 * np.sin(q[:, 0]) + 0.3 * np.sin(0.2),
        ],
        axis=-1,
    )
    np.testing.assert_allclose(pose[:, :2, 3], expected, atol=1e-12)
    np.testing.assert_allclose(jacobian[:, 3:, 0], 0.0, atol=1e-12)


def test_a_mimic_joint_may_follow_one_beside_the_tools_way() -> None:
    urdf = (
        joint("lead", "base", "wheel")
        + joint("a", "base", "one", more='<mimic joint="lead" multiplier="2"/>')
        + joint("f", "one", "tool", "0.3 0 0", "fixed")
    )
    robot = robot_of(urdf, "")
    assert robot.chain.bodies.joints == ("lead", "a")
    pose = robot.mechanism.forward(np.array([[0.3]]))[0, :2, 3]
    np.testing.assert_allclose(pose, 0.3 * np.array([np.cos(0.6), np.sin(0.6)]), atol=1e-12)


def test_a_mimic_joint_of_a_locked_one_is_refused() -> None:
    urdf = (
        joint("a", "base", "one")
        + joint("b", "one", "two", "0.4 0 0", more=FOLLOWING)
        + joint("f", "two", "tool", "0.3 0 0", "fixed")
    )
    with pytest.raises(InputError, match="joint 'b' mimics 'a', which is locked"):
        robot_of(urdf, "locked_joints = { a = 0.0 }")


def test_a_joint_that_mimics_itself_is_refused() -> None:
    urdf = (
        joint("a", "base", "one")
        + joint("b", "one", "two", "0.4 0 0", more='<mimic joint="b"/>')
        + joint("f", "two", "tool", "0.3 0 0", "fixed")
    )
    with pytest.raises(InputError, match="joint 'b' mimics itself"):
        robot_of(urdf, "")


@pytest.mark.parametrize(
    ("first", "second", "third"), [("c", "b", "a"), ("b", "a", "a"), ("b", "c", "a")]
)
def test_joints_that_mimic_each_other_are_refused(first: str, second: str, third: str) -> None:
    def follows(name: str) -> str:
        return f'<mimic joint="{name}"/>'

    urdf = (
        joint("a", "base", "one", more=follows(first))
        + joint("b", "one", "two", "0.4 0 0", more=follows(second))
        + joint("c", "two", "three", "0.4 0 0", more=follows(third))
        + joint("f", "three", "tool", "0.3 0 0", "fixed")
    )
    with pytest.raises(InputError, match="mimic each other: take <mimic> from") as caught:
        robot_of(urdf, "")
    assert "\n" not in str(caught.value)


def test_a_tool_that_no_joint_moves_is_refused() -> None:
    tool = '<parent link="dist1"/><child link="tool0"/>'
    with pytest.raises(InputError, match="mine: no joint moves the tool frame 'tool0'; name a"):
        changed("fivebar", (tool, tool.replace("dist1", "base")))


def test_limits_of_passive_joints_in_the_wrong_order_are_reported() -> None:
    robot = changed("fivebar", ('lower="-3.1" upper="3.1"', 'lower="3.1" upper="-3.1"'))
    assert any("the passive joint 'p1', 'p2' is above" in each for each in implausible(robot))
    assert not any("passive" in each for each in implausible(load_robot("fivebar")))


def test_a_characteristic_length_in_mm_is_reported() -> None:
    robot = changed("fivebar", ("length = 0.46", "length = 460"))
    assert implausible(robot)[0] == "kinematics.length = 460 looks like mm: it is in m"


# --- one motor ---


def test_a_crank_is_closed_from_few_starts_over_its_whole_range() -> None:
    """A slider-crank: x = r cos q + √(l² − r² sin² q)."""
    urdf = (
        joint("q", "base", "crank")
        + joint("p", "crank", "rod", "0.1 0 0")
        + joint("w", "rod", "tool", "0.3 0 0")
        + joint("s", "base", "slide", kind="prismatic", axis="1 0 0")
    )
    q0 = 1.2
    low = float(np.arcsin(0.1 * np.sin(q0) / 0.3))
    x = float(0.1 * np.cos(q0) + 0.3 * np.cos(low))
    loops = '[{ frames = ["slide", "tool"], joint = "planar" }]'
    robot = robot_of(
        urdf,
        f'actuated = ["q"]\nloops = {loops}\n'
        f"closed_at = {{ q = {q0}, p = {-q0 - low}, s = {x} }}\nlocked_joints = {{ w = 0.0 }}",
    )
    q = np.linspace(-2.9, 2.9, 200)
    along = 0.1 * np.cos(q) + np.sqrt(0.09 - 0.01 * np.sin(q) ** 2)
    pose = robot.mechanism.forward(q[:, None])
    np.testing.assert_allclose(pose[:, 0, 3], along, rtol=0, atol=1e-12)
    assert len(robot.mechanism.starts().theta) <= 64


# --- what is wrong ---

BAD = [
    pytest.param(
        "fivebar",
        [('["tip1", "tip2"]', '["tip1", "tool0"]')],
        "loop 'loop1': frames 'tip1' and 'tool0' are on the same link",
        id="a link and itself",
    ),
    pytest.param(
        "hexapod",
        [('["platform_3", "rod3_end"]', '["platform_3", "platform_2"]')],
        "loop 'loop2': frames 'platform_3' and 'platform_2' are on the same link",
        id="a link and itself, hexapod",
    ),
    pytest.param(
        "fivebar",
        [
            ('<origin xyz="0.23 0.0 0.05"', '<origin xyz="0.23 0.0 0.06"'),
            ('xyz="0.23 0.0 0.0"', 'xyz="0.023 0.0 0.0"'),
        ],
        "loop 'loop1' does not close: its frames are .* mm apart",
        id="rods too short",
    ),
    pytest.param(
        "delta",
        [('xyz="0.0 0.0 0.8"', 'xyz="0.0 0.0 0.08"')],
        "loop 'loop[1-5]' does not close: its frames are .* mm apart",
        id="rods of the delta too short",
    ),
    pytest.param(
        "fivebar",
        [("p1 = -1.6511640051052074", "p1 = -1.2")],
        "loop 'loop1' does not close: .* at kinematics.closed_at, which chooses the assembly mode; "
        "a closed configuration "
        "from there is p1 = -1.65116: write it there",
        id="closed_at is not closed",
    ),
    pytest.param(
        "fivebar",
        [("p1 = -1.6511640051052074", "p1 = 1.6"), ("p2 = 1.6511640051052074", "p2 = -1.6")],
        "loop 'loop1' does not close: .* at kinematics.closed_at",
        id="another assembly mode, nearly",
    ),
    pytest.param(
        "fivebar",
        [(LOOP, 'joint = "weld"')],
        "loop 'loop1': over-constrained: the mechanism has 1 independent motions for 2 actuators",
        id="over-constrained",
    ),
    pytest.param(
        "prs3",
        [
            (
                '{ frames = ["platform_2", "rod2_end"], joint = "spherical" }',
                '{ name = "leg 2", frames = ["platform_2", "rod2_end"], joint = "weld" }',
            )
        ],
        "loop 'leg 2' does not close: .* 120 deg turned",
        id="over-constrained 3-PRS",
    ),
    pytest.param(
        "hexapod",
        [('"j5", "j6"]', '"j5"]')],
        "the tool moves while every actuator stands still, by joints such as 'j6': name",
        id="a forgotten actuator",
    ),
    pytest.param(
        "delta",
        [('actuated = ["j1", "j2", "j3"]', 'actuated = ["j1", "j3"]')],
        "the tool moves while every actuator stands still, by joints such as 'j2': name",
        id="a forgotten actuator of the delta",
    ),
    pytest.param(
        "hexapod",
        [('"j5", "j6"]', '"j5", "j7"]')],
        "kinematics.actuated: 'j7' is no movable joint of the URDF; known: ",
        id="an unknown actuator",
    ),
    pytest.param(
        "hexapod",
        [('"j5", "j6"]', '"j5", "j6", "j6"]')],
        "kinematics.actuated names 'j6' twice",
        id="an actuator twice",
    ),
    pytest.param(
        "fivebar",
        [('actuated = ["j1", "j2"]\n', "")],
        "kinematics.actuated is missing",
        id="no actuators",
    ),
    pytest.param(
        "fivebar",
        [('["tip1", "tip2"]', '["tip1", "tip3"]')],
        "loop 'loop1': frame 'tip3' is not in the URDF; did you mean",
        id="an unknown frame",
    ),
    pytest.param(
        "hexapod",
        [("j1 = 0.8322096426977961", "j1 = 1.8322096426977961")],
        "kinematics.closed_at: 'j1' = 1.83221 m is outside its limits 0.55 to 1.15",
        id="closed outside the limits",
    ),
    pytest.param(
        "hexapod",
        [("j1 = 0.8322096426977961", "j1 = true")],
        "kinematics.closed_at.j1: .*number",
        id="a truth value is no number",
    ),
    pytest.param(
        "hexapod",
        [("j1 = 0.8322096426977961", 'j1 = "0.8322"')],
        "kinematics.closed_at.j1: .*number",
        id="a text is no number",
    ),
    pytest.param(
        "hexapod",
        [("closed_at = { j1", "closed_at = { jx")],
        "kinematics.closed_at: 'jx' is no movable joint; known: ",
        id="an unknown joint closed",
    ),
    pytest.param(
        "delta",
        [('{ frames = ["platform_32", "rod32_end"], joint = "spherical" },\n', "")],
        "joints .* move neither the tool nor a frame of a loop; lock them",
        id="a rod that hangs",
    ),
    pytest.param(
        "delta",
        [
            ('{ frames = ["platform_12"', '{ name = "rod", frames = ["platform_12"'),
            ('{ frames = ["platform_32"', '{ name = "rod", frames = ["platform_32"'),
        ],
        "kinematics.loops: two loops have the name 'rod'",
        id="two loops of one name",
    ),
    pytest.param(
        "delta",
        [('{ frames = ["platform_12"', '{ name = "loop3", frames = ["platform_12"')],
        "kinematics.loops: two loops have the name 'loop3'",
        id="the name of a loop that has none",
    ),
    pytest.param(
        "fivebar",
        [(f"{LOOP} }},", f'{LOOP} }},\n{{ frames = ["tip2", "tip1"], {LOOP} }},')],
        "loop 'loop2' joins the same frames as loop 'loop1'; leave one out",
        id="a loop twice",
    ),
    pytest.param(
        "hexapod",
        [("loops = [", 'loops = [{ frames = ["rod6_end", "platform_6"], joint = "revolute" },')],
        "loop 'loop6' joins the same frames as loop 'loop1'; leave one out",
        id="a leg twice",
    ),
    pytest.param(
        "fivebar",
        [('["tip1", "tip2"]', '["base", "tip2"]')],
        "loop 'loop1': over-constrained: .* 2 independent motions for 2 actuators, and 'j2' cannot "
        "move",
        id="a motor that is held",
    ),
    pytest.param(
        "hexapod",
        [('["platform_6", "rod6_end"], ' + BALL, '["platform_6", "rod6_end"], joint = "weld"')],
        "mine: loop 'loop5': over-constrained: .* 3 independent motions for 6 actuators",
        id="one leg welded",
    ),
    pytest.param(
        "delta",
        [('"platform_12", "rod12_end"], ' + BALL, '"platform_12", "rod12_end"], joint = "weld"')],
        "mine: loop 'loop1': over-constrained: ",
        id="one rod welded",
    ),
    pytest.param(
        "fivebar",
        [('<limit lower="-3.1" upper="3.1"', '<limit lower="-0.1" upper="0.1"')],
        "kinematics.closed_at: the passive joint 'p1' is at -1.65116 rad, outside of its limits",
        id="closed outside of passive limits",
    ),
    pytest.param(
        "prs3",
        [(R1, R1.replace('lower="-3.1"', 'lower="0.3"'))],
        "kinematics.closed_at: the passive joint 'r1' is at 0 rad, outside of its limits 0.3 to",
        id="a rod outside of its limits",
    ),
    pytest.param(
        "fivebar",
        [(LOOP, 'joint = "ball"')],
        "kinematics.loops.0.joint",
        id="an unknown kind of joint",
    ),
]


@pytest.mark.parametrize(("name", "pairs", "message"), BAD)
def test_what_is_wrong_is_one_line(name: str, pairs: list, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        changed(name, *pairs)
    assert str(caught.value).startswith("mine: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "given"),
    [("fivebar", "x, rx, ry, rz"), ("delta", "x, rx, ry"), ("palletizer-level", "z, rx")],
)
def test_virtual_joints_that_the_joints_are_themselves_are_refused(name: str, given: str) -> None:
    named = ", ".join(f'"{joint}"' for joint in given.split(", "))
    robot = changed(name, ("[targets]", f"[equivalent]\nvirtual_joints = [{named}]\n[targets]"))
    with pytest.raises(InputError, match=f"virtual_joints: {given} and the joints move .* alike"):
        check_robot(robot, "mine")


def test_tolerances_of_joints_are_those_of_the_motors_and_the_tool() -> None:
    two = "j2 = { length_mm = 3, angle_mrad = 4 }, j7 = { length_mm = 5, angle_mrad = 6 }"
    table = f"[tolerances]\njoints = {{ {two} }}\n"
    robot = changed("hexapod", ("[targets]", f"{table}[targets]"))
    from calibtool.errormodel.families import BY_ID
    from calibtool.errormodel.tolerances import Tolerances

    shape = robot.chain.placements[:, 0, :1].shape[0], 6
    found = BY_ID["placements"].tolerance(robot, Tolerances.of_robot(robot), shape)
    assert found.shape == shape
    np.testing.assert_allclose(found[1], [3e-3] * 3 + [4e-3] * 3)
    np.testing.assert_allclose(found[-1], [5e-3] * 3 + [6e-3] * 3)
    np.testing.assert_allclose(np.delete(found, [1, shape[0] - 1], axis=0), 1e-3)


# --- robots --check ---


def test_the_check_shows_the_closed_mechanism(tmp_path: Path) -> None:
    fixed = '<joint name="rod2_end_fix" type="fixed">'
    path = written(
        tmp_path,
        "hexapod",
        (fixed, '<joint name="spin" type="continuous"><axis xyz="0 0 1"/>'),
        ('name = "hexapod"\n', 'name = "mine"\n'),
    )
    value = check_robot(load_robot(path), path).as_json()["closed_loops"]
    assert value["mobility"] == 6
    assert value["idle_joints"] == ["spin"]
    assert len(value["passive_joints"]) == 15
    assert value["loops"][0] == {
        "name": "loop1",
        "frames": ["platform_2", "rod2_end"],
        "joint": "spherical",
        "equations": 3,
    }
    assert 50 < value["joint_range_that_closes_percent"] < 90


@pytest.mark.parametrize(
    ("name", "identifiable"),
    [
        ("fivebar", 23),
        ("hexapod", 57),
        ("delta", 54),
        ("prs3", 48),
        ("palletizer", 45),
        ("hybrid", 60),
    ],
)
def test_as_many_parameters_are_identifiable_as_the_mathematics_says(
    name: str, identifiable: int
) -> None:
    """docs/closed-loops.md, of the geometry with three targets."""
    from calibtool.identification.parameters import Parameters, State
    from calibtool.measurement.observation import observation_matrix
    from calibtool.measurement.sampling import sample_configurations
    from calibtool.measurement.setup import Setup
    from calibtool.robot.se3 import readonly

    robot = load_robot(name)
    setup = Setup(readonly(np.eye(4)), robot.targets)
    parameters = Parameters.of(robot, setup, twists=1)
    q = sample_configurations(robot, robot.workspace(), 100, np.random.default_rng(0))
    context = State.nominal(robot, setup).errors.context(q)
    seen = observation_matrix(setup, context.frames.tool) @ parameters.pose_columns(context)
    sizes = np.linalg.svd(seen.reshape(-1, parameters.count), compute_uv=False)
    assert (sizes > 1e-9 * sizes[0]).sum() == identifiable
    assert sizes[identifiable - 1] > 1e3 * sizes[identifiable]


def test_an_ideal_hexapod_has_42_identifiable_parameters() -> None:
    """Centres of its twelve ideal joints, and the zeros of its six legs: the textbook number."""
    from calibtool.errormodel.families import BY_ID
    from calibtool.errormodel.robot_errors import RobotErrors
    from calibtool.measurement.sampling import sample_configurations

    robot = load_robot("hexapod")
    q = sample_configurations(robot, robot.workspace(), 60, np.random.default_rng(0))
    context = RobotErrors.of(robot).context(q)
    labels = list(robot.chain.labels)
    legs = [labels.index(f"u{k}x") for k in range(1, 7)]
    tips = [labels.index(f"loop{k}.a") for k in range(1, 6)]
    centres = [6 * k + c for k in (*legs, *tips) for c in range(3)]
    tool = [6 * (len(labels) - 1) + c for c in range(6)]
    columns = BY_ID["placements"].columns((len(labels), 6), context)[:, :, centres + tool]
    columns = np.concatenate([columns, context.offset_columns], axis=-1)
    sizes = np.linalg.svd(columns.reshape(6 * len(q), -1), compute_uv=False)
    assert columns.shape[-1] == 45
    assert (sizes > 1e-9 * sizes[0]).sum() == 42
