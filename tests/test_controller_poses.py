"""Poses of programs for a UR controller with a factory calibration, simulated apart."""

import re
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from universal import UR5, as_yaml, forward, inverse, perturbed

from calibtool.calibration import Calibration, identify
from calibtool.controller import read_controller_model
from calibtool.errors import InputError, UsageError
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.setup import Setup
from calibtool.programs.compensate import compensate_program
from calibtool.programs.controller_poses import worse_than_untouched
from calibtool.programs.correction import ProgramOptions
from calibtool.programs.program_summary import CompensatedProgram
from calibtool.robot.catalogue import load_robot
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly, transform_points
from calibtool.robot.source import parse_source


@dataclass(frozen=True, eq=False)
class Arm:
    """Six frames of the controller's model and of the actual arm, and the latter's calibration."""

    factory: Array
    actual: Array
    calibration: Calibration

    @property
    def controller(self) -> Mechanism:
        robot = self.calibration.robot
        return read_controller_model(as_yaml(self.factory), "factory.yaml", robot).mechanism


@cache
def arm(seed: int, left: float = 1.0) -> Arm:
    """left: size of the errors that the factory leaves, times 0.1 mm and 0.2 mrad."""
    robot, rng = load_robot("ur5"), np.random.default_rng(seed)
    factory = perturbed(UR5, rng, 0.45e-3, 1.1e-3)
    actual = perturbed(factory, rng, left * 0.1e-3, left * 0.2e-3)
    q = sample_configurations(robot, "full", 40, rng)
    points = transform_points(forward(actual, q), robot.targets)
    measurements = Measurements(
        robot,
        readonly(q),
        readonly(points + rng.normal(size=points.shape) * 0.02e-3),
        None,
        Setup(readonly(np.eye(4)), robot.targets),
        0.02e-3,
        1e-4,
    )
    return Arm(factory, actual, identify(measurements, "complete"))


def nominal() -> Mechanism:
    return load_robot("ur5").mechanism


def commands(count: int, seed: int = 0) -> Array:
    robot = load_robot("ur5")
    return sample_configurations(robot, robot.workspace(), count, np.random.default_rng(seed))


def script(poses: Array) -> str:
    lines = ["def a():", "  set_tcp(p[0, 0, 0, 0, 0, 0])"]
    for T in poses:
        values = [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_rotvec()]
        lines.append(f"  movel(p[{', '.join(f'{v:.9f}' for v in values)}], a=1.2, v=0.25)")
    return "\n".join([*lines, "end", ""])


def poses_in(text: str) -> Array:
    poses = []
    for found in re.findall(r"p\[([^]]*)\]", text)[1:]:  # the first one is set_tcp's
        values = [float(v) for v in found.split(",")]
        T = np.eye(4)
        T[:3, :3] = Rotation.from_rotvec(values[3:]).as_matrix()
        T[:3, 3] = values[:3]
        poses.append(T)
    return np.array(poses)


def corrected(made: Arm, text: str, model: Mechanism | None) -> CompensatedProgram:
    options = ProgramOptions(controller_model=model)
    return compensate_program(made.calibration, text.encode(), "a.script", "ur-script", options)


def off(made: Arm, text: str, q: Array, commanded: Array) -> Array:
    """Distance of the actual tool from the commanded poses when a text is driven."""
    joints = [inverse(made.factory, T, near) for T, near in zip(poses_in(text), q, strict=True)]
    return np.linalg.norm(
        forward(made.actual, np.array(joints))[:, :3, 3] - commanded[:, :3, 3], axis=-1
    )


@pytest.mark.parametrize("seed", [3, 8])
def test_a_corrected_program_is_at_most_as_far_off_as_the_untouched_one(seed: int) -> None:
    made, q = arm(seed), commands(8)
    text = script(nominal().forward(q))
    commanded = poses_in(text)
    before = off(made, text, q, commanded)
    naive = off(made, corrected(made, text, nominal()).data.decode(), q, commanded)
    after = off(made, corrected(made, text, made.controller).data.decode(), q, commanded)
    assert (after <= before).all()
    assert after.max() < 0.3e-3
    assert (
        naive.mean() > 3 * before.mean()
    )  # with the drawing's poses the arm goes to a worse place


def test_the_pose_written_is_the_controller_s_at_the_corrected_joints() -> None:
    """Solved by the controller, it is where the calibrated robot is at the commanded pose."""
    made, q = arm(3), commands(4)
    text = script(nominal().forward(q))
    written = poses_in(corrected(made, text, made.controller).data.decode())
    joints = np.array([inverse(made.factory, T, near) for T, near in zip(written, q, strict=True)])
    np.testing.assert_allclose(made.calibration.forward(joints), poses_in(text), atol=3e-7)


def test_a_controller_that_knows_its_arm_needs_no_correction() -> None:
    """Its model is the calibrated one: poses are right as they are, though joints are not."""
    made, q = arm(3), commands(4)
    text = script(nominal().forward(q))
    result = corrected(made, text, made.calibration.base_mechanism)
    np.testing.assert_allclose(poses_in(result.data.decode()), poses_in(text), atol=2e-7)


def test_poses_of_a_perfect_arm_are_corrected_for_its_controller() -> None:
    """No joint is to be corrected, but a controller with another model is told other poses."""
    made, q = arm(3), commands(4)
    measurements = Measurements(
        load_robot("ur5"),
        readonly(q),
        readonly(transform_points(nominal().forward(q), load_robot("ur5").targets)),
        None,
        Setup(readonly(np.eye(4)), load_robot("ur5").targets),
        1e-6,
        1e-4,
    )
    perfect = Arm(made.factory, UR5, identify(measurements, "nominal"))
    text = script(nominal().forward(q))
    result = corrected(perfect, text, made.controller)
    assert result.changed == 4
    assert off(perfect, text, q, poses_in(text)).min() > 0.5e-3
    assert off(perfect, result.data.decode(), q, poses_in(text)).max() < 1e-6


def test_joint_targets_are_corrected_alike_whatever_the_controller_s_model() -> None:
    made, q = arm(3), commands(3)
    text = "".join(f"movej([{', '.join(f'{v:.9f}' for v in row)}])\n" for row in q)
    results = [corrected(made, text, model).data for model in (None, nominal(), made.controller)]
    assert results[0] == results[1] == results[2] != text.encode()


def test_a_start_beside_a_pose_chooses_the_branch_and_stays() -> None:
    """The controller solves the written pose near `qnear`, and the actual tool is where it
    was asked to be.
    """
    made, q = arm(3), commands(2)
    poses = nominal().forward(q)
    lines = []
    for T, row in zip(poses, q, strict=True):
        values = [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_rotvec()]
        near = ", ".join(f"{v:.9f}" for v in row)
        lines.append(
            f"movej(get_inverse_kin(p[{', '.join(f'{v:.9f}' for v in values)}], qnear=[{near}]))"
        )
    text = "\n".join(["set_tcp(p[0, 0, 0, 0, 0, 0])", *lines, ""])
    written = corrected(made, text, made.controller).data.decode()
    assert re.findall(r"qnear=.*", written) == re.findall(r"qnear=.*", text)
    assert off(made, written, q, poses).max() < 0.3e-3
    assert (off(made, written, q, poses) < off(made, text, q, poses)).all()


def test_what_would_be_worse_than_untouched_is_found() -> None:
    """Nominal joints are farther off than the controller's own, the actual arm's nearer."""
    made, q = arm(3), commands(6)
    T = nominal().forward(q)
    right = np.array([inverse(made.actual, each, near) for each, near in zip(T, q, strict=True)])
    assert worse_than_untouched(made.calibration, made.controller, T, q, q).all()
    assert not worse_than_untouched(made.calibration, made.controller, T, q, right).any()


def test_a_row_that_would_be_worse_is_left_and_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    made, q = arm(3), commands(3)
    text = script(nominal().forward(q))
    monkeypatch.setattr(
        "calibtool.programs.controller_poses.worse_than_untouched",
        lambda calibration, model, T, q, q_m: np.arange(len(q)) == 1,
    )
    result = corrected(made, text, made.controller)
    (remark,) = result.left_alone
    assert remark.line == 4
    assert "already brings the tool nearer" in remark.why
    before, after = text.splitlines(), result.data.decode().splitlines()
    assert [one == other for one, other in zip(before, after, strict=True)] == [
        True,
        True,
        False,
        True,
        False,
        True,
    ]


# --- the answer is asked for --------------------------------------------------------------------


def described(kind: str | None) -> Robot:
    source = load_robot("ur5").source
    text = re.sub(r"\[controller\]\n.*\n.*\n", "", source.toml_text)
    if kind is not None:
        text += f'\n[controller]\nfactory_calibration = "{kind}"\nreason = "bought with the arm"\n'
    return Robot.from_source(parse_source(text, source.urdf_text, "robot.toml"))


@pytest.mark.parametrize(
    ("kind", "word"), [("always", "has a model"), ("optional", "may have a model")]
)
def test_poses_for_a_controller_that_may_have_a_model_of_its_own(kind: str, word: str) -> None:
    made = arm(3)
    robot = described(kind)
    known = replace(made, calibration=replace(made.calibration, robot=robot))
    text = script(nominal().forward(commands(1)))
    with pytest.raises(
        UsageError, match=rf"^a\.script: .*{word} of its own \(bought with the arm\)"
    ) as caught:
        corrected(known, text, None)
    assert "--controller nominal or --controller FILE" in str(caught.value)
    assert corrected(known, text, robot.mechanism).changed == 1
    assert corrected(known, "movej([0, -1.4, 1.7, -1.9, -1.6, 0])\n", None).changed == 1


def test_robots_that_state_nothing_of_it_are_taken_as_drawn() -> None:
    made = arm(3)
    silent = replace(made, calibration=replace(made.calibration, robot=described(None)))
    assert corrected(silent, script(nominal().forward(commands(1))), None).changed == 1


@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10"])
def test_every_built_in_ur_states_it(name: str) -> None:
    known = load_robot(name).source.description.controller
    assert known is not None
    assert known.factory_calibration == "always"


@pytest.mark.parametrize(
    ("table", "word"),
    [
        ('factory_calibration = "sometimes"\nreason = "x"', "controller.factory_calibration"),
        ('factory_calibration = "always"', "controller.reason"),
        ('factory_calibration = "always"\nreason = ""', "controller.reason"),
        ('factory_calibration = "always"\nreason = "x"\nmodel = "y"', "controller.model"),
    ],
)
def test_a_wrong_controller_table(table: str, word: str) -> None:
    source = load_robot("planar-3r").source
    with pytest.raises(InputError, match=word):
        parse_source(f"{source.toml_text}\n[controller]\n{table}\n", source.urdf_text, "robot.toml")
