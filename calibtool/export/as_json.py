"""A calibration as JSON: complete, so that a reader needs no URDF, no catalogue and no calibtool."""

import json
from typing import Any

import numpy as np

from calibtool.calibration import Calibration
from calibtool.equivalent.regressor import Regressor
from calibtool.errormodel.family import Rows
from calibtool.measurement.measurements import Setup
from calibtool.robot.damped import GRAM_REGULARISATION, MIN_SINGULARITY_DISTANCE
from calibtool.robot.gravity import link_masses
from calibtool.robot.model import Robot

SCHEMA, SCHEMA_VERSION = "calibtool/compensator", 1

# Families of errors by id, and their keys: what a family does stands in FORMULA.
ERROR_KEYS = {
    "placements": "placement_errors_m_rad",
    "twists": "twist_errors_per_rad_or_m",
    "offsets": "offset_errors_rad_or_m",
    "harmonics": "harmonics_rad",
    "gravity": "compliance_rad_per_nm",
    "backlash": "backlash_rad_or_m",
    "payload": "payload_rad_per_nm",
    "temperature": "expansion_per_k",
}

# How q_m is computed from the other keys, for a reader who has nothing but the file.
FORMULA = {
    "purpose": "q_m = correct(q): command q_m, and the calibrated robot's tool goes where the nominal robot's would be at q",
    "units": "m and rad; rad_or_m: in the unit of that joint; indices j count from 1, virtual_joint_columns from 0",
    "twist": "(v, w): three linear elements first, then three angular ones",
    "pose": "4x4 homogeneous matrix T_a_b = [[R, p], [0, 1]], row by row: pose of frame b in frame a",
    "frames": "K_0 is the robot's base, K_{n+1} its tool; placement M_j is the pose of joint frame j in joint frame j - 1 "
    "with joint j at zero, M_{n+1} that of the tool; twist xi_j of joint j is written in its own frame",
    "exp6": "exp6((v, w)) = matrix exponential of [[S(w), v], [0, 0]], S(w) b = w x b; log6 is its inverse, |w| <= pi",
    "adjoint": "Ad(T) = [[R, S(p) R], [0, R]]: twists of frame b to frame a for T = T_a_b",
    "network": "N(q) = output_scale * (W2 tanh(W1 s + b1) + b2), s = (q - input_centre) / input_scale, element by element; "
    "W1, b1 = hidden_weights, hidden_bias; W2, b2 = output_weights, output_bias; p elements: the n actuated joints, "
    "then the virtual ones; N(q) = 0 if network is null (Eq. 16)",
    "random_features": "if network.kind is 'random-features': N(q) = output_scale * W cos(frequencies s + phases), "
    "W = output_weights, s as above",
    "joint_coupling": "q of the serial chain = joint_coupling times the joint values that the controller shows, rad or m; "
    "q and q_m here are those of the serial chain, the controller's are inverse(joint_coupling) q_m",
    "nominal": "T_nominal(q) = M_1 exp6(xi_1 q_1) ... M_n exp6(xi_n q_n) M_{n+1}, M = nominal_placements_m, "
    "xi = nominal_twists_per_rad_or_m (Eq. 7)",
    "base": "T_base(q): the same product with M = placements_m = M_j exp6(placement_errors_m_rad_j), "
    "xi = nominal_twists_per_rad_or_m + twist_errors_per_rad_or_m, and q + offset_errors_rad_or_m + m(q) for q (Eq. 8)",
    "payload": "a payload turns the frame before joint j by payload_rad_per_nm[j][1] n_j about its origin, in front of "
    "exp6(placement_errors): n_j is the moment of payload_kg g at the origin of T_nominal(q) about that of F0_j, the "
    "product up to M_j of the nominal robot at q, written in F0_j without its part along w_j; joint j moves by "
    "payload_rad_per_nm[j][0] times that part more",
    "growth": "the translation of nominal_placements_m[j] is 1 + expansion_per_k[j] warmth_k times as long, in "
    "placements_m and in front of the payload's turn",
    "joint_motion": "m_j(q) = sum over h = 1, 2, ... of harmonics_rad[j][2h - 2] sin(h q_j) + harmonics_rad[j][2h - 1] "
    "cos(h q_j), minus compliance_rad_per_nm[j] tau_j(q)",
    "backlash": "q_m of `correction` is for the middle of the backlash; for rows in the order of motion add "
    "backlash_rad_or_m[j] d_j to its joint j, d_j = -1, 0, +1 the direction of the joint's last motion, 0 if unknown",
    "torque": "tau_j(q) = - sum over links i = j..n of link_masses_kg[i] g . (v_j + w_j x c_i), g = gravity_m_per_s2, "
    "(v_j, w_j) = Ad(F_j) xi_j and c_i = F_i centres_of_mass_m[i] of the nominal robot at q",
    "jacobian": "J, 6 x p: column j = 1..n is Ad(F_j) xi_j, xi_j and F_j those of the base, F_j the product up to and "
    "with the exponential of joint j; then, of Ad(T_base(q)), each of virtual_joint_columns (Eq. 14)",
    "calibrated": "T_calibrated(q) = exp6(J N(q)) T_base(q)",
    "error": "e = log6(T_calibrated(q) inverse(T_nominal(q))) (Eqs. 9, 10)",
    "weighting": "replace e and every column of J, (v, w), by ((v + w x t) / characteristic_length_m, w), t the position in "
    "T_calibrated(q)",
    "distance": "d = 1 / sqrt(trace(inverse(G))), G = J J' + gram_regularisation I: how far J is from a singularity",
    "motion": "rho = J' inverse(G + lambda^2 I) e, lambda = max(0, min_singularity_distance - d) (Eq. 15); where lambda > 0 "
    "the motion is damped and a part of the error stays",
    "correction": "base_model.name 'nominal': q_m = q - (the first n elements of N(q)), nothing else is needed "
    "(Eqs. 23, 24); any other: q_m = q - (the first n elements of rho) (Eq. 24)",
}


def calibration_as_json(calibration: Calibration) -> str:
    """One JSON object, schema `calibtool/compensator`, that says how q_m (Eq. 24) is computed and holds every number for it.

    Units stand in the key names (m, rad; `rad_or_m`: in the unit of the joint), frames under `formula`. A float is written
    with as many digits as it takes to read exactly the same one; the same calibration gives the same text.
    """
    robot, equivalent = calibration.robot, calibration.equivalent
    contents = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "robot": robot.name,
        "formula": FORMULA,
        "joints": _joints(robot),
        "joint_coupling": robot.coupling.tolist(),
        "nominal_placements_m": robot.chain.placements.tolist(),
        "nominal_twists_per_rad_or_m": robot.chain.twists.tolist(),
        "base_model": _base_model(calibration),
        "equivalent_robot": {
            "p": equivalent.p,
            "virtual_joints": list(equivalent.virtual_joints),
            "virtual_joint_columns": equivalent.virtual_columns,
        },
        "characteristic_length_m": robot.length,
        "min_singularity_distance": MIN_SINGULARITY_DISTANCE,
        "gram_regularisation": GRAM_REGULARISATION,
        "network": None if calibration.network is None else _network(calibration.network),
        "setup": _setup(calibration.setup),
        "frame": None if calibration.frame is None else calibration.frame.name,
        "configurations": calibration.configurations,
        "noise_position_m": calibration.noise_position,
        "noise_orientation_rad": calibration.noise_orientation,
        "provenance": calibration.provenance,
    }
    return json.dumps(contents, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _joints(robot: Robot) -> list[dict[str, Any]]:
    return [
        {
            "name": robot.chain.model.names[j + 1],
            "kind": "prismatic" if robot.prismatic[j] else "revolute",
            "unit": robot.joint_units[j],
            "lower_rad_or_m": float(robot.lower[j]),
            "upper_rad_or_m": float(robot.upper[j]),
        }
        for j in range(robot.n)
    ]


def _base_model(calibration: Calibration) -> dict[str, Any]:
    robot, errors, conditions = calibration.robot, calibration.errors, calibration.conditions
    rows = Rows(robot, np.zeros((1, robot.n)), conditions)
    masses, centres, gravity = link_masses(robot)
    return {
        "name": calibration.base.model,
        **{key: errors[family].tolist() for family, key in ERROR_KEYS.items()},
        "link_masses_kg": masses.tolist(),
        "centres_of_mass_m": centres.tolist(),
        "gravity_m_per_s2": gravity.tolist(),
        "payload_kg": float(rows.payload),
        "warmth_k": float(rows.warmth),
        "placements_m": errors.standing(conditions).placements.tolist(),
    }


def _network(network: Regressor) -> dict[str, Any]:
    arrays = {
        f"{name}_rad_or_m" if unit in ("q", "rho") else name: getattr(network, name).tolist()
        for name, (unit, _, _) in network.fields.items()
    }
    return {"kind": network.id, **arrays}


def _setup(setup: Setup) -> dict[str, Any]:
    """Where the measurements were made; no part of the correction."""
    return {
        "T_instrument_base_m": setup.T_instrument_base.tolist(),
        "targets_m": setup.targets.tolist(),
        "kind": setup.kind.id,
        **{name: array.tolist() for name, array in setup.arrays.items()},
        "frame_known": setup.frame_known,
        "targets_known": setup.targets_known,
    }
