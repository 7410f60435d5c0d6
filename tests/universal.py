"""A UR5 apart from calibtool: its six frames, a factory calibration of them, and its files."""

from collections.abc import Mapping

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

FRAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
KEYS = ("x", "y", "z", "roll", "pitch", "yaw")
QUARTER = np.pi / 2
# Published lengths of the UR5 (CB series), m; every joint turns about its frame's z axis.
UR5 = np.array(
    [
        [0, 0, 0.089159, 0, 0, 0],
        [0, 0, 0, QUARTER, 0, 0],
        [-0.425, 0, 0, 0, 0, 0],
        [-0.39225, 0, 0.10915, 0, 0, 0],
        [0, -0.09465, 0, QUARTER, 0, 0],
        [0, 0.0823, 0, -QUARTER, 0, 0],
    ]
)
# The same as standard DH parameters: a, alpha, d.
A = np.array([0, -0.425, -0.39225, 0, 0, 0])
ALPHA = np.array([QUARTER, 0, 0, QUARTER, -QUARTER, 0])
D = np.array([0.089159, 0, 0, 0.10915, 0.09465, 0.0823])


def placement(values: np.ndarray) -> np.ndarray:
    """T of x y z roll pitch yaw, fixed axes."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", values[3:]).as_matrix()
    T[:3, 3] = values[:3]
    return T


def turn(axis: str, angle: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
    return T


def forward(frames: np.ndarray, q: np.ndarray) -> np.ndarray:
    """T_base_tool (N, 4, 4) of six frames (6, 6) at q (N, 6)."""
    poses = []
    for row in q:
        T = np.eye(4)
        for values, angle in zip(frames, row, strict=True):
            T = T @ placement(values) @ turn("z", angle)
        poses.append(T)
    return np.array(poses)


def forward_dh(changes: Mapping[str, np.ndarray], q: np.ndarray) -> np.ndarray:
    """T_base_tool (N, 4, 4) of standard DH parameters with changes of a, alpha, d, theta."""
    poses = []
    for row in q:
        T = np.eye(4)
        for j, angle in enumerate(row):
            T = T @ turn("z", angle + changes["theta"][j])
            T[:3, 3] += T[:3, 2] * (D[j] + changes["d"][j])
            T[:3, 3] += T[:3, 0] * (A[j] + changes["a"][j])
            T = T @ turn("x", ALPHA[j] + changes["alpha"][j])
        poses.append(T)
    return np.array(poses)


def inverse(frames: np.ndarray, pose: np.ndarray, q_near: np.ndarray) -> np.ndarray:
    """q (6,) near q_near at which six frames bring the tool to a pose (4, 4)."""

    def left(q: np.ndarray) -> np.ndarray:
        T = forward(frames, q[None])[0]
        return np.concatenate(
            [T[:3, 3] - pose[:3, 3], Rotation.from_matrix(T[:3, :3] @ pose[:3, :3].T).as_rotvec()]
        )

    solved = least_squares(left, q_near, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert np.abs(solved.fun).max() < 1e-8
    return np.asarray(solved.x)


def perturbed(
    frames: np.ndarray, rng: np.random.Generator, length: float, angle: float
) -> np.ndarray:
    """Six frames with normal errors of a length in m and an angle in rad in every number."""
    return frames + rng.normal(size=(6, 6)) * np.repeat([length, angle], 3)


def as_yaml(frames: np.ndarray) -> str:
    """What the UR driver's ur_calibration writes."""
    lines = ["kinematics:"]
    for name, values in zip(FRAMES, frames.tolist(), strict=True):
        lines += [
            f"  {name}:",
            *(f"    {key}: {value!r}" for key, value in zip(KEYS, values, strict=True)),
        ]
    return "\n".join([*lines, "  hash: calib_12345678901234567890", ""])


def as_conf(changes: Mapping[str, np.ndarray]) -> str:
    """What a controller keeps."""
    lists = [
        f"delta_{key} = [ {', '.join(map(repr, values.tolist()))}]"
        for key, values in changes.items()
    ]
    more = [
        "joint_checksum = [ 0x6e0f7bf, 0xa32a713f, 0xf636a50, 0x9ec2338a, 0xa1afded8, 0xb29b2979]"
    ]
    status = "calibration_status = 2 # 0 == notInitialized / 1 == notLinearised / 2 == Linearised"
    return "\n".join(["[mounting]", *lists, *more, status, ""])


def random_changes(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Changes of the size of a factory calibration; of parallel axes metres that cancel."""
    changes = {
        "theta": rng.normal(size=6) * 1e-4,
        "a": rng.normal(size=6) * 2e-4,
        "d": rng.normal(size=6) * 2e-4,
        "alpha": rng.normal(size=6) * 5e-4,
    }
    changes["a"][5] = changes["alpha"][5] = 0.0
    changes["d"][1:4] += np.array(
        [1.0, -3.0, 2.0]
    )  # axes 2, 3, 4 lean by some 1e-4: 1 m moves them by 1e-4 m
    return changes
