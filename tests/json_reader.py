"""What a stranger makes of an exported JSON file: its `formula` in numpy and scipy,
nothing of calibtool.
"""

import numpy as np
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

Array = np.ndarray


def model_from_json(c: dict, q: Array) -> tuple[Array, Array, Array]:
    """T_nominal, T_calibrated and J_rho at q, as the file's `formula` says them."""
    n, base = len(c["joints"]), c["base_model"]

    def exp6(twist: Array) -> Array:
        return expm(np.block([[hat(twist[3:]), twist[:3, None]], [np.zeros((1, 4))]]))

    def adjoint(T: Array) -> Array:
        return np.block([[T[:3, :3], hat(T[:3, 3]) @ T[:3, :3]], [np.zeros((3, 3)), T[:3, :3]]])

    def frames(M: Array, xi: Array, q: Array) -> tuple[list[Array], list[Array]]:
        T, frames, columns = np.eye(4), [], []
        for j in range(n):
            T = T @ M[j] @ exp6(xi[j] * q[j])
            frames.append(T)
            columns.append(adjoint(T) @ xi[j])
        return frames, columns

    N = network_from_json(c, q)
    nominal_twists = np.array(c["nominal_twists_per_rad_or_m"])
    joints, nominal_columns = frames(np.array(c["nominal_placements_m"]), nominal_twists, q)
    T_nominal = joints[-1] @ c["nominal_placements_m"][n]
    twists = nominal_twists + base["twist_errors_per_rad_or_m"]
    moved = q + base["offset_errors_rad_or_m"]
    for j, row in enumerate(base["harmonics_rad"]):
        moved[j] += sum(a * np.sin((h // 2 + 1) * q[j]) for h, a in enumerate(row) if h % 2 == 0)
        moved[j] += sum(b * np.cos((h // 2 + 1) * q[j]) for h, b in enumerate(row) if h % 2 == 1)
    together = [(k, other) for k in range(n) for other in range(k + 1, n)]
    for j, row in enumerate(base["pairs_rad"]):
        for i in range(len(row) // 4):
            both = q[together[i][0]] + q[together[i][1]]
            between = q[together[i][0]] - q[together[i][1]]
            waves = [np.sin(both), np.cos(both), np.sin(between), np.cos(between)]
            moved[j] += np.dot(row[4 * i : 4 * i + 4], waves)
    for j in range(n):
        for i in range(j, n):
            centre = (joints[i] @ [*base["centres_of_mass_m"][i], 1])[:3]
            velocity = nominal_columns[j][:3] + np.cross(nominal_columns[j][3:], centre)
            torque = -base["link_masses_kg"][i] * np.dot(base["gravity_m_per_s2"], velocity)
            moved[j] -= base["compliance_rad_per_nm"][j] * torque
    placements = np.array(base["placements_m"])
    for j in range(n):
        F0 = (joints[j - 1] if j else np.eye(4)) @ c["nominal_placements_m"][j]
        moment = np.zeros(3)
        for i in range(j, n):
            centre = (joints[i] @ [*base["centres_of_mass_m"][i], 1])[:3]
            weight = base["link_masses_kg"][i] * np.array(base["gravity_m_per_s2"])
            moment += np.cross(centre - F0[:3, 3], weight)
        load = base["payload_kg"] * np.array(base["gravity_m_per_s2"])
        local = F0[:3, :3].T @ np.cross(T_nominal[:3, 3] - F0[:3, 3], load)
        axis, (wind, bend) = nominal_twists[j][3:], base["payload_rad_per_nm"][j]
        moved[j] += wind * (local @ axis)
        turn, wobble = bend * (local - (local @ axis) * axis), base["wobble_rad"][j]
        for k, vector in enumerate(np.array(base["across_axes"][j])):
            angle = base["bending_rad_per_nm"][j][k] * (F0[:3, :3] @ vector) @ moment
            angle += wobble[2 * k] * np.sin(q[j]) + wobble[2 * k + 1] * np.cos(q[j])
            turn += angle * vector
        grown = np.array(c["nominal_placements_m"][j])
        grown[:3, 3] *= 1 + base["expansion_per_k"][j] * base["warmth_k"]
        turned = grown @ exp6(np.concatenate([np.zeros(3), turn])) @ np.linalg.inv(grown)
        placements[j] = turned @ placements[j]
    base_frames, columns = frames(placements, twists, moved)
    T_base = base_frames[-1] @ base["placements_m"][n]
    columns += [adjoint(T_base)[:, k] for k in c["equivalent_robot"]["virtual_joint_columns"]]
    J = np.stack(columns, axis=1)
    return T_nominal, exp6(J @ N) @ T_base, J


def network_from_json(c: dict, q: Array) -> Array:
    net = c["network"]
    if net is None:
        return np.zeros(c["equivalent_robot"]["p"])
    s = (q - net["input_centre_rad_or_m"]) / net["input_scale_rad_or_m"]
    if net["kind"] == "gaussian-process":
        k = np.exp(-0.5 * ((s - np.array(net["points"])) ** 2).sum(axis=1))
        return np.array(net["output_weights"]) @ k * net["output_scale_rad_or_m"]
    hidden = np.tanh(np.array(net["hidden_weights"]) @ s + net["hidden_bias"])
    return (np.array(net["output_weights"]) @ hidden + net["output_bias"]) * net[
        "output_scale_rad_or_m"
    ]


def hat(w: Array) -> Array:
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def correct_from_json(c: dict, q: Array) -> tuple[Array, str]:
    """What a stranger makes of the file: q_m and its status, by `formula` alone."""
    n, length, most = (
        len(c["joints"]),
        c["characteristic_length_m"],
        np.array(c["largest_change_rad_or_m"]),
    )
    low, high = (
        [joint[f"{side}_rad_or_m"] for joint in c["joints"]] for side in ("lower", "upper")
    )
    if not (np.abs(q) <= c["largest_position_rad_or_m"]).all():
        return q, "not-finite"
    T_c, T, J_rho = model_from_json(c, q)
    kept = (
        [k for k in range(6) if k not in c["equivalent_robot"]["virtual_joint_columns"]]
        if n < 6
        else range(6)
    )

    def error(T: Array) -> Array:
        turn = Rotation.from_matrix(T[:3, :3] @ T_c[:3, :3].T).as_rotvec()
        return np.concatenate([(T[:3, 3] - T_c[:3, 3]) / length, turn])

    def task(rows: Array) -> Array:
        return (
            rows
            if n >= 6
            else np.concatenate([T_c[:3, :3].T @ rows[:3], T_c[:3, :3].T @ rows[3:]])[kept]
        )

    inside = (q >= np.array(low) - 1e-9) & (q <= np.array(high) + 1e-9)
    lower = np.where(inside, np.maximum(-most, np.minimum(0, low - q)), -most)
    upper = np.where(inside, np.minimum(most, np.maximum(0, high - q)), most)

    def bounded_step(A: Array, a: Array, D: Array | None = None) -> tuple[Array, float]:
        def solved(A: Array, a: Array, held: np.ndarray, L: float) -> tuple[Array, float, float]:
            G = (A @ A.T if n >= 6 else A.T @ A + np.diag(held.astype(float))) + 0.0
            G += c["gram_regularisation"] * np.eye(len(G))
            d = 1 / np.sqrt(np.trace(np.linalg.inv(G)))
            L = max(L, max(0.0, c["damped_below"] - d) ** 2)
            G += L * np.eye(len(G))

            def S(a: Array) -> Array:
                return -A.T @ np.linalg.solve(G, a) if n >= 6 else -np.linalg.solve(G, A.T @ a)

            D = S(a)
            return (D + S(a + A @ D) if L > 0 else D), d, L

        held = np.zeros(n, dtype=bool)
        first, distance, L = solved(A, a, held, 0.0)
        D = first if D is None else D
        for _ in range(3):
            outside = np.maximum(lower - D, D - upper)
            if not outside.max() > 0:
                break
            held[outside.argmax()] = True
            H = np.where(held, np.clip(D, lower, upper), 0.0)
            D, _, L = solved(np.where(held, 0.0, A), a + A @ H, held, L)
            D = D + H
        return np.clip(D, lower, upper), distance

    e, p = error(T), T[:3, 3]
    J = np.block([[np.eye(3), -hat(p)], [np.zeros((3, 3)), np.eye(3)]]) @ J_rho[:, :n]
    J[:3] /= length
    network = -network_from_json(c, q)[:n] if c["base_model"]["name"] == "nominal" else None
    D, distance = bounded_step(task(J), task(e), network)
    if n < 6:
        D_A, (D_J, _) = D, bounded_step(J, e)
        cost = np.sum((J @ (D_A - D_J)) ** 2)
        allowed = 0.75 * max(0.0, e @ e - np.sum((e + J @ D_J) ** 2))
        D = D_J + np.sqrt(allowed / cost) * (D_A - D_J) if cost > allowed else D_A

    def squares(a: Array, b: Array) -> Array:
        return np.array([a @ b, task(a) @ task(b)])

    before, slope = squares(e, e), 2 * squares(e, J @ D)
    least = []
    left = error(model_from_json(c, q + D)[1])
    for s, g, after in zip(before, slope, squares(left, left), strict=True):
        h = after - s - g
        least.append(1.0 if 2 * h <= -g else -g / (2 * h) if g < 0 else 0.0)
    t = min(1.0, 1.5 * min(least))
    left = error(model_from_json(c, q + t * D)[1])
    dropped = not (squares(left, left) < before).all()
    q_m, stays = (q, before) if dropped else (q + t * D, squares(left, left))

    more = (np.sqrt(stays) > [c["usual_error_rad"]["all"], c["usual_error_rad"]["task"]]).any()
    stopped, far = (lower >= D) | (upper <= D), np.abs(D) >= most
    verdicts = [
        ("uncorrected", dropped and more),
        (
            "out-of-limits",
            bool((q_m < np.array(low) - 1e-9).any() or (q_m > np.array(high) + 1e-9).any()),
        ),
        ("near-singular", distance < c["damped_below"]),
        ("out-of-limits", more and (stopped & ~far).any()),
        ("limited", more and (stopped & far).any()),
        ("partial", more),
    ]
    return q_m, next((status for status, holds in verdicts if holds), "ok")
