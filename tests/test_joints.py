"""The equivalent robot: six independent joint motion errors everywhere in the workspace, virtual
ones fixed in the tool.
"""

from itertools import combinations

import numpy as np
import pytest
from derivatives import assert_derivative
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from calibtool.equivalent.joints import ELEMENTARY, EquivalentRobot, equivalent_robot
from calibtool.errors import InputError
from calibtool.measurement.sampling import sample_configurations
from calibtool.robot.catalogue import load_robot, robot_names
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.source import parse_source

SMALL = [  # whose virtual joints are chosen, not named
    name
    for name in robot_names()
    if load_robot(name).n < 6 and load_robot(name).source.description.equivalent is None
]


def configurations(robot: Robot, count: int = 60, seed: int = 11) -> Array:
    return sample_configurations(robot, robot.workspace(), count, np.random.default_rng(seed))


def elementary(name: str) -> Array:
    """Generator (4, 4) of an elementary motion: a shift or a turn along or about one axis."""
    G = np.zeros((4, 4))
    axis = "xyz".index(name[-1])
    if len(name) == 1:
        G[axis, 3] = 1.0
    else:
        a, b = (axis + 1) % 3, (axis + 2) % 3
        G[b, a], G[a, b] = 1.0, -1.0
    return G


def error_of(moved: Array, pose: Array) -> Array:
    """Spatial twist of a small motion in K_0, first order."""
    D = moved @ np.linalg.inv(pose)
    v = D[:3, 3]  # of the point at the origin of K_0
    return np.concatenate([v, Rotation.from_matrix(D[:3, :3]).as_rotvec()])


def scaled_singular_values(robot: Robot, equivalent: EquivalentRobot, q: Array) -> Array:
    """Singular values of J_ρ at the tool point with translations over the characteristic length."""
    pose, jacobian = equivalent.forward_and_jacobian(robot.mechanism, q)
    at_tool = jacobian.copy()
    for k in range(len(q)):
        for c in range(equivalent.p):
            at_tool[k, :3, c] += np.cross(jacobian[k, 3:, c], pose[k, :3, 3])
    at_tool[:, :3] /= robot.length
    return np.linalg.svd(at_tool, compute_uv=False)


def with_virtual_joints(name: str, joints: str) -> Robot:
    source = load_robot(name).source
    text = source.toml_text + f"\n[equivalent]\nvirtual_joints = [{joints}]\n"
    return Robot.from_source(parse_source(text, source.urdf_text, name))


@pytest.mark.parametrize("name", ["gantry", "planar-3r", "scara", "ur5"])
def test_columns_are_the_motions_that_the_joints_make(name: str) -> None:
    """Actuated joints move the chain; a virtual joint moves the tool
    along or about its own axis.
    """
    robot = load_robot(name)
    equivalent = equivalent_robot(robot)
    q = configurations(robot, 3)
    pose, jacobian = equivalent.forward_and_jacobian(robot.mechanism, q)
    for k in range(3):

        def moved(rho: Array, k: int = k) -> Array:
            T = robot.mechanism.forward((q[k] + rho[: robot.n])[None])[0]
            for joint, value in zip(equivalent.virtual_joints, rho[robot.n :], strict=True):
                T = T @ expm(value * elementary(joint))
            return error_of(T, pose[k])

        assert_derivative(moved, jacobian[k], np.zeros(equivalent.p), step=1e-4)


def test_every_robot_has_at_least_six_joint_motion_errors(robot: Robot) -> None:
    equivalent = equivalent_robot(robot)
    assert equivalent.p == max(robot.n, 6)
    assert len(set(equivalent.virtual_joints)) == max(6 - robot.n, 0)


def test_the_equivalent_robot_can_make_every_pose_error_in_its_workspace(robot: Robot) -> None:
    sigma = scaled_singular_values(robot, equivalent_robot(robot), configurations(robot))
    assert sigma.shape == (60, 6)
    assert sigma[:, -1].min() > 0.02


@pytest.mark.parametrize("name", SMALL)
def test_hardly_any_other_choice_of_virtual_joints_is_better_conditioned(name: str) -> None:
    robot = load_robot(name)
    q = configurations(robot, 200)  # not those by which the choice was made

    def worst(joints: tuple[str, ...]) -> float:
        sigma = scaled_singular_values(robot, EquivalentRobot(robot.n, joints), q)
        return float(((1.0 / np.maximum(sigma, 1e-12) ** 2).sum(axis=-1) ** -0.5).min())

    chosen = worst(equivalent_robot(robot).virtual_joints)
    best = max(worst(joints) for joints in combinations(ELEMENTARY, 6 - robot.n))
    assert chosen >= 0.9 * best


def test_a_scara_gets_turns_about_the_tool_s_x_and_y() -> None:
    # docs/method.md, virtual joints
    assert set(equivalent_robot(load_robot("scara")).virtual_joints) == {"rx", "ry"}


def test_a_planar_arm_gets_the_shift_and_the_turns_out_of_its_plane() -> None:
    # Its tool's z points along the last link and x down (robots/planar-3r): x, ry and rz
    # leave the plane.
    robot = load_robot("planar-3r")
    tool = robot.mechanism.forward(configurations(robot, 1))[0, :3, :3]
    assert np.allclose(np.abs(tool[2]), [1, 0, 0], atol=1e-9)
    assert set(equivalent_robot(robot).virtual_joints) == {"x", "ry", "rz"}


@pytest.mark.parametrize("name", ["panda", "ur5", "xarm7"])
def test_an_arm_of_six_or_more_joints_gets_none(name: str) -> None:
    assert equivalent_robot(load_robot(name)).virtual_joints == ()


def test_the_description_s_choice_is_honoured() -> None:
    assert equivalent_robot(with_virtual_joints("scara", '"rx", "rz"')).virtual_joints == (
        "rx",
        "rz",
    )


@pytest.mark.parametrize(
    ("name", "joints"), [("scara", '"rx"'), ("scara", '"rx", "rx"'), ("ur5", '"rx"')]
)
def test_a_choice_of_another_number_is_refused(name: str, joints: str) -> None:
    with pytest.raises(
        InputError, match=r"equivalent\.virtual_joints: \d different ones are needed"
    ):
        with_virtual_joints(name, joints)


def test_the_choice_is_the_same_every_time() -> None:
    for name in SMALL:
        assert equivalent_robot(load_robot(name)) == equivalent_robot(load_robot(name))
