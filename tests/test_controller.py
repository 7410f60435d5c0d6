"""The controller's own model: files against a computation apart, and files of other arms."""

import re
from pathlib import Path

import numpy as np
import pytest
from universal import (
    FRAMES,
    KEYS,
    UR5,
    as_conf,
    as_yaml,
    forward,
    forward_dh,
    perturbed,
    random_changes,
)

from calibtool.controller import ControllerModel, read_controller_model
from calibtool.errors import InputError, UsageError
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.source import parse_source

HERE = Path(__file__).parent / "controllers"
Q = np.random.default_rng(5).uniform(-np.pi, np.pi, (12, 6))


def read(text: str, robot: str = "ur5", **more: str) -> ControllerModel:
    return read_controller_model(text, "file", load_robot(robot), **more)


def refused(text: str, robot: str = "ur5", **more: str) -> str:
    with pytest.raises(InputError) as caught:
        read(text, robot, **more)
    message = str(caught.value)
    assert message.startswith("file")
    assert "\n" not in message
    return message


# --- the YAML of the UR driver ------------------------------------------------------------------


def test_the_nominal_frames_are_the_urdf() -> None:
    """Published lengths, as in the driver's default_kinematics.yaml, against example-robot-data."""
    model = read(as_yaml(UR5))
    assert model.position < 1e-6
    assert model.orientation < 1e-6
    nominal = load_robot("ur5").mechanism.forward(Q)
    np.testing.assert_allclose(forward(UR5, Q), nominal, atol=1e-6)
    np.testing.assert_allclose(model.mechanism.forward(Q), nominal, atol=1e-6)


def test_six_frames_composed_are_the_arm(rng: np.random.Generator) -> None:
    frames = perturbed(UR5, rng, 0.3e-3, 1e-3)
    model = read(as_yaml(frames))
    np.testing.assert_allclose(model.mechanism.forward(Q), forward(frames, Q), atol=1e-12)
    assert 0.5e-3 < model.position < 12e-3


def test_a_frame_that_is_turned_over_and_back_is_the_same(rng: np.random.Generator) -> None:
    """Calibrations write roll, pitch, yaw near π, π, π for what is nearly no turn."""
    frames = perturbed(UR5, rng, 0.3e-3, 1e-3)
    over = frames.copy()
    over[:, 3:] = np.column_stack(
        [np.pi + frames[:, 3], np.pi - frames[:, 4], np.pi + frames[:, 5]]
    )
    a, b = (read(as_yaml(each)).mechanism.forward(Q) for each in (frames, over))
    np.testing.assert_allclose(a, b, atol=1e-12)


def test_a_factory_calibration_as_it_is_found() -> None:
    """Short numbers, `1e-05` without a point (for YAML 1.1 a word), a hash among the frames."""
    text = (HERE / "factory_calibration.yaml").read_text(encoding="utf-8")
    values = np.zeros((6, 6))
    for k, name in enumerate(FRAMES):
        part = text[text.index(f"{name}:") :].splitlines()[1:7]
        values[k] = [float(line.split(":")[1]) for line in part]
    model = read(text, "ur10")
    np.testing.assert_allclose(model.mechanism.forward(Q), forward(values, Q), atol=1e-12)
    assert 1e-3 < model.position < 3e-3


def test_flow_style_and_comments_are_yaml_too() -> None:
    frames = [
        f"{name}: {{{', '.join(f'{key}: {value}' for key, value in zip(KEYS, row, strict=True))}}}"
        for name, row in zip(FRAMES, UR5.tolist(), strict=True)
    ]
    for text in (
        "# robot 2\n---\nkinematics:\n  " + "\n  ".join(frames) + "\n",
        f"{{kinematics: {{{', '.join(frames)}}}}}",
    ):
        np.testing.assert_allclose(read(text).mechanism.forward(Q), forward(UR5, Q), atol=1e-12)


def without(text: str, frame: str) -> str:
    return re.sub(rf"  {frame}:\n(    .*\n)+", "", text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (without(as_yaml(UR5), "wrist_2"), ["no frame wrist_2", "shoulder, upper_arm, forearm"]),
        (without(without(as_yaml(UR5), "shoulder"), "wrist_3"), ["no frame shoulder, wrist_3"]),
        (as_yaml(UR5).replace("wrist_1:", "wrist1:"), ["no frame wrist_1", "did you mean wrist1?"]),
        (as_yaml(UR5).replace("    yaw: 0.0\n", "", 1), [":3: ", "kinematics.shoulder has no yaw"]),
        (
            as_yaml(UR5).replace("z: 0.089159", "z: high"),
            [":5: ", "kinematics.shoulder.z is 'high'"],
        ),
        (as_yaml(UR5).replace("z: 0.089159", "z: .nan"), ["kinematics.shoulder.z is '.nan'"]),
        (as_yaml(UR5).replace("z: 0.089159", "z: 1e999"), ["kinematics.shoulder.z is '1e999'"]),
        (as_yaml(UR5).replace("z: 0.089159", "z: [1, 2]"), ["kinematics.shoulder.z is ''"]),
        (as_yaml(UR5).replace("z: 0.089159", "z: 0.0_9"), ["kinematics.shoulder.z is '0.0_9'"]),
        (
            as_yaml(UR5).replace("    y: 0.0\n", "    x: 0.0\n", 1),
            ["kinematics.shoulder' has the key 'x' twice"],
        ),
        ("kinematics:\n  - 1\n", [":2: ", "holds no keys"]),
        ("kinematics: [\n", ["not valid YAML"]),
        ("kinematics:\n\tx: 1\n", ["not valid YAML"]),
        ("kinematics: {}\n---\nkinematics: {}\n", ["not valid YAML"]),
        ("kinematics: " + "[" * 5000, ["not valid YAML: nested too deeply"]),
        ("kinematics:\n" + "#" * 200_000, ["characters"]),
    ],
)
def test_a_yaml_that_is_none(text: str, words: list[str]) -> None:
    message = refused(text)
    for word in words:
        assert word in message


# --- calibration.conf ---------------------------------------------------------------------------


def test_changes_of_dh_parameters_are_the_arm(rng: np.random.Generator) -> None:
    changes = random_changes(rng)
    model = read(as_conf(changes))
    np.testing.assert_allclose(model.mechanism.forward(Q), forward_dh(changes, Q), atol=1e-9)
    assert model.position > 0.3e-3


@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10"])
def test_no_changes_are_the_nominal_arm(name: str) -> None:
    model = read(as_conf({key: np.zeros(6) for key in ("theta", "a", "d", "alpha")}), name)
    np.testing.assert_allclose(
        model.mechanism.forward(Q), load_robot(name).mechanism.forward(Q), atol=1e-6
    )


CONF = as_conf({key: np.full(6, 1e-5) for key in ("theta", "a", "d", "alpha")})


@pytest.mark.parametrize(
    ("text", "robot", "word"),
    [
        (CONF.replace("delta_d =", "delta_x ="), "ur5", "no delta_d"),
        (CONF.replace("1e-05, 1e-05]", "1e-05]", 1), "ur5", "six numbers"),
        (CONF.replace("[ 1e-05", "[ nan", 1), "ur5", "is 'nan'; expected a number"),
        (CONF.replace("[ 1e-05", "1e-05", 1), "ur5", "six numbers"),
        (
            CONF.replace("calibration_status = 2", "calibration_status = 1"),
            "ur5",
            "calibration_status is 1",
        ),
        (CONF.replace("[mounting]", "[other]"), "ur5", "no section [mounting]"),
        (CONF + "delta_d = [0, 0, 0, 0, 0, 0]\n", "ur5", "delta_d"),
        (CONF, "panda", "six revolute joints, and panda is none"),
        (CONF, "kinova", "kinova is not in that form"),
    ],
)
def test_a_conf_that_is_none(text: str, robot: str, word: str) -> None:
    assert word in refused(text, robot)


# --- DH tables and URDFs ------------------------------------------------------------------------


def dh_csv(rows: list[list[object]], header: str = "joint,a_mm,alpha_deg,d_mm,theta_deg") -> str:
    return "\n".join([header, *(",".join(map(str, row)) for row in rows), ""])


STANDARD = [
    [1, 0, 90, 89.159, 0],
    [2, -425, 0, 0, 0],
    [3, -392.25, 0, 0, 0],
    [4, 0, 90, 109.15, 0],
    [5, 0, -90, 94.65, 0],
    [6, 0, 0, 82.3, 0],
]
# Craig's form of the same arm: a and alpha of a row belong to the joint before it.
MODIFIED = [
    [1, 0, 0, 89.159, 0],
    [2, 0, 90, 0, 0],
    [3, -425, 0, 0, 0],
    [4, -392.25, 0, 109.15, 0],
    [5, 0, 90, 94.65, 0],
    [6, 0, -90, 82.3, 0],
]


@pytest.mark.parametrize(("rows", "convention"), [(STANDARD, "standard"), (MODIFIED, "modified")])
def test_both_conventions_are_the_arm(rows: list[list[object]], convention: str) -> None:
    other = "modified" if convention == "standard" else "standard"
    model = read(dh_csv(rows), dh=convention)
    np.testing.assert_allclose(model.mechanism.forward(Q), forward(UR5, Q), atol=1e-12)
    assert f"as --dh {convention} it fits" in refused(dh_csv(rows), dh=other)
    with pytest.raises(UsageError, match=r"^file: .*--dh standard .* or --dh modified"):
        read(dh_csv(rows))


def test_units_theta_and_constant_rows() -> None:
    """In m and rad; a base row takes back a turned zero of joint 1, a tool row holds the flange."""
    rows = [["base", 0, 0, 0, -0.3]]
    rows += [[j, a / 1e3, np.deg2rad(alpha), d / 1e3, 0.0] for j, a, alpha, d, _ in STANDARD]
    rows[1][4], rows[6][3] = 0.3, 0.0
    rows.append(["tool", 0, 0, 0.0823, 0])
    model = read(dh_csv(rows, "joint,a_m,alpha_rad,d_m,theta_rad"), dh="standard")
    np.testing.assert_allclose(model.mechanism.forward(Q), forward(UR5, Q), atol=1e-12)


def test_a_slide_moves_along_its_axis() -> None:
    """A SCARA, whose third joint slides down: its z axis looks down from there on."""
    rows: list[list[object]] = [[1, 0, 0, 400, 0], [2, 350, 0, 0, 0], [3, 300, 180, 0, 0]]
    rows += [[4, 0, 0, 0, 0], ["tool", 0, 0, 100, 0]]
    robot = load_robot("scara")
    q = robot.lower + (robot.upper - robot.lower) * np.random.default_rng(1).random((5, 4))
    model = read(dh_csv(rows), "scara", dh="modified")
    np.testing.assert_allclose(model.mechanism.forward(q), robot.mechanism.forward(q), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (dh_csv(STANDARD[:5]), "a model of 5 joints, but ur5 has 6"),
        (
            dh_csv([*STANDARD[:2], STANDARD[3], STANDARD[2], *STANDARD[4:]]),
            "file:4: joint '4'; expected 3",
        ),
        (dh_csv([*STANDARD[:3], ["base", 0, 0, 0, 0], *STANDARD[3:]]), "joint 'base'; expected 4"),
        (dh_csv([[1, 0, "x", 89.159, 0], *STANDARD[1:]]), "file:2: column 'alpha_deg' holds 'x'"),
    ],
)
def test_a_dh_table_that_is_none(text: str, word: str) -> None:
    assert word in refused(text, dh="standard")


def test_a_urdf_is_the_arm_between_the_frames_of_the_description() -> None:
    robot = load_robot("ur5")
    text = robot.source.urdf_text
    assert read(text).position == 0.0
    moved = read(text.replace('xyz="0.0 0.0 0.089159"', 'xyz="0.0005 0.0 0.0895"'))
    np.testing.assert_allclose(
        moved.mechanism.forward(Q)[:, :3, 3] - robot.mechanism.forward(Q)[:, :3, 3],
        np.broadcast_to(
            [-0.0005, 0.0, 0.000341], (12, 3)
        ),  # K_0 is turned by 180 deg against the URDF's root
        atol=1e-9,
    )
    assert "frame 'tool0' is not in the URDF" in refused(text.replace("tool0", "flange"))
    with pytest.raises(UsageError, match="--dh is for a table"):
        read(text, dh="standard")


# --- another arm --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "robot", "words"),
    [
        (as_yaml(UR5), "ur3", ["no model of this ur3", "8.5 mm and 30 mrad"]),
        (as_yaml(UR5), "ur10", ["no model of this ur10"]),
        (
            as_yaml(UR5 + np.eye(6)[:, :1] * [0, 0, 0.0734, 0, 0, 0]),
            "ur5",
            ["no model of this ur5"],
        ),  # a UR5e's base
        (dh_csv(STANDARD), "ur10", ["no model of this ur10"]),
        (as_yaml(UR5), "panda", ["six revolute joints"]),
        (load_robot("panda").source.urdf_text, "ur5", ["tool0"]),
        (load_robot("scara").source.urdf_text, "planar-3r", ["file: "]),
        (
            as_conf({**{k: np.zeros(6) for k in ("theta", "a", "alpha")}, "d": np.full(6, 0.05)}),
            "ur5",
            ["no model"],
        ),
        ("hello\n", "ur5", ["no model of a controller; expected a URDF"]),
        ("", "ur5", ["no model of a controller"]),
    ],
)
def test_a_model_of_another_arm(text: str, robot: str, words: list[str]) -> None:
    message = refused(text, robot, **({"dh": "standard"} if text.startswith("joint,") else {}))
    for word in words:
        assert word in message


def described(more: str) -> Robot:
    source = load_robot("ur5").source
    text = source.toml_text.replace('base_frame = "base"\n', more)
    return Robot.from_source(parse_source(text, source.urdf_text, "robot.toml"))


def test_another_base_frame_is_named() -> None:
    """K_0 at the root of a UR's URDF is turned by half a turn against the controller's Base."""
    with pytest.raises(InputError, match="only its base frame is another one"):
        read_controller_model(as_yaml(UR5), "file", described('base_frame = "base_link"\n'))


def test_another_tool_frame_is_named() -> None:
    frames = UR5.copy()
    frames[5, :3] += [0.0, 0.15, 0.0]
    assert "only its tool frame is another one" in refused(as_yaml(frames))


def test_the_file_is_recognised_by_what_it_holds() -> None:
    for text in (
        "\ufeff" + as_yaml(UR5),
        "\n\n" + as_yaml(UR5),
        CONF,
        load_robot("ur5").source.urdf_text,
    ):
        assert read(text).position < 1e-3
