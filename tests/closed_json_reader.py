"""What a stranger makes of an exported JSON file with closed loops: its `formula` in numpy and
scipy,
nothing of calibtool.
"""

import numpy as np
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

Array = np.ndarray


def hat(w: Array) -> Array:
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def exp6(twist: Array) -> Array:
    v, w = twist[:3], twist[3:]
    T, t = np.eye(4), np.linalg.norm(w)
    if t < 1e-12:
        T[:3, 3] = v
        return T
    W, s, c = hat(w / t), np.sin(t), np.cos(t)
    T[:3, :3] = np.eye(3) + s * W + (1 - c) * W @ W
    T[:3, 3] = (np.eye(3) + (1 - c) / t * W + (t - s) / t * W @ W) @ v
    return T


def adjoint(T: Array) -> Array:
    return np.block([[T[:3, :3], hat(T[:3, 3]) @ T[:3, :3]], [np.zeros((3, 3)), T[:3, :3]]])


def placed(c: dict, placements: Array, twists: Array, theta: Array) -> tuple[list, list]:
    """Frames F_i of the joints, then A and B of every loop and the tool."""
    frames: dict[int, Array] = {-1: np.eye(4)}
    while len(frames) <= len(theta):
        for j, parent in enumerate(c["parents"]):
            if j not in frames and parent in frames:
                frames[j] = frames[parent] @ placements[j] @ exp6(twists[j] * theta[j])
    carriers = [*c["carriers"], c["tool"]]
    ends = [frames[k] @ M for k, M in zip(carriers, placements[len(theta) :], strict=True)]
    return [frames[j] for j in range(len(theta))], ends


def open_by(c: dict, placements: Array, twists: Array, theta: Array) -> Array:
    """The equations of closure at θ."""
    _, ends = placed(c, placements, twists, theta)
    left = []
    for k, loop in enumerate(c["loops"]):
        E = np.linalg.inv(ends[2 * k]) @ ends[2 * k + 1]
        turn = Rotation.from_matrix(E[:3, :3]).as_rotvec()
        if sum(row >= 3 for row in loop["equations"]) < 3:
            turn = np.array([-E[1, 2], E[0, 2], 0.0])
        left += [np.concatenate([E[:3, 3], turn])[row] for row in loop["equations"]]
    for mimic in c["mimic_joints"]:
        led = mimic["factor"] * theta[mimic["leader"]] + mimic["offset_rad_or_m"]
        left.append(theta[mimic["joint"]] - led)
    return np.array(left)


def closed(c: dict, placements: Array, twists: Array, q: Array) -> Array:
    """θ by small steps from closed_at."""
    theta = np.array(c["closed_at_rad_or_m"])
    n, start = len(q), np.array(c["closed_at_rad_or_m"])[: len(q)]
    passive = [j for j, joint in enumerate(c["joints"]) if joint["role"] == "passive"]

    def equations(x: Array) -> Array:
        theta[passive] = x
        return open_by(c, placements, twists, theta)

    for part in np.linspace(0.0, 1.0, 4):
        theta[:n] = start + part * (q - start)
        theta[passive] = fsolve(equations, theta[passive], xtol=1e-13)
    return theta


def jacobian(c: dict, placements: Array, twists: Array, q: Array) -> Array:
    """Spatial columns of the closed mechanism, by differences of the tool."""
    columns = []
    for j in range(len(q)):
        step = np.zeros(len(q))
        step[j] = 1e-5
        poses = [tool(c, placements, twists, q + s * step) for s in (1, -1)]
        turn = poses[0] @ np.linalg.inv(poses[1])
        rotation = Rotation.from_matrix(turn[:3, :3]).as_rotvec()
        shift = turn[:3, 3] + 0.5 * np.cross(turn[:3, 3], rotation)
        columns.append(np.concatenate([shift, rotation]) / 2e-5)
    return np.array(columns).T


def tool(c: dict, placements: Array, twists: Array, q: Array) -> Array:
    return placed(c, placements, twists, closed(c, placements, twists, q))[1][-1]


def nominal_of(c: dict) -> tuple[Array, Array]:
    return np.array(c["nominal_placements_m"]), np.array(c["nominal_twists_per_rad_or_m"])


def nominal_pose(c: dict, q: Array) -> Array:
    return tool(c, *nominal_of(c), q)


def energy(c: dict, q: Array) -> float:
    """Potential energy of the links along the nominal mechanism."""
    placements, twists = nominal_of(c)
    base = c["base_model"]
    frames, _ = placed(c, placements, twists, closed(c, placements, twists, q))
    return -sum(
        mass * np.dot(base["gravity_m_per_s2"], (T @ [*centre, 1.0])[:3])
        for T, mass, centre in zip(
            frames, base["link_masses_kg"], base["centres_of_mass_m"], strict=True
        )
    )


def calibrated_pose(c: dict, q: Array) -> Array:
    base = c["base_model"]
    placements = np.array(base["placements_m"])
    twists = np.array(base["twists_per_rad_or_m"])
    moved = q + base["offset_errors_rad_or_m"]
    for j, row in enumerate(base["harmonics_rad"]):
        for h in range(len(row) // 2):
            angle = (h + 1) * q[j]
            moved[j] += row[2 * h] * np.sin(angle) + row[2 * h + 1] * np.cos(angle)
    if np.any(base["compliance_rad_per_nm"]):
        for j in range(len(q)):
            step = np.zeros(len(q))
            step[j] = 1e-5
            torque = (energy(c, q + step) - energy(c, q - step)) / 2e-5
            moved[j] -= base["compliance_rad_per_nm"][j] * torque
    T_base = tool(c, placements, twists, moved)
    net = c["network"]
    if net is None:
        return T_base
    J = jacobian(c, placements, twists, moved)
    J = np.concatenate([J, adjoint(T_base)[:, c["virtual_joint_columns"]]], axis=1)
    s = (q - net["input_centre"]) / np.array(net["input_scale"])
    hidden = np.tanh(np.array(net["hidden_weights"]) @ s + net["hidden_bias"])
    motions = (np.array(net["output_weights"]) @ hidden + net["output_bias"]) * net["output_scale"]
    return exp6(J @ motions) @ T_base


def corrected(c: dict, q: Array) -> Array:
    """q_m by scipy, from q."""
    commanded = nominal_pose(c, q)
    R = commanded[:3, :3].T

    def error(x: Array) -> Array:
        pose = calibrated_pose(c, x)
        turn = Rotation.from_matrix(pose[:3, :3] @ R).as_rotvec()
        both = np.concatenate([R @ (pose[:3, 3] - commanded[:3, 3]), R @ turn])
        return both[c["task"]]

    found: Array = fsolve(error, q, xtol=1e-11)
    return found
