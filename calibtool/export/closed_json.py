"""A calibration of a robot with closed loops as JSON, complete for a reader without other files."""

import json
from typing import Any

import numpy as np

from calibtool.calibration import Calibration
from calibtool.compensation.weighted_error import Task
from calibtool.errormodel.family import Rows
from calibtool.robot.closed_chain import ClosedChain
from calibtool.robot.gravity_torque import gravity_model
from calibtool.robot.loops import FORBIDDEN
from calibtool.robot.se3 import Array

SCHEMA, SCHEMA_VERSION = "calibtool/closed-compensator", 1

FORMULA = {
    "units": "m, rad; joint positions in the unit of each joint. Twists are (v, w), linear part "
    "first; poses are 4 x 4 matrices T_a_b, of frame b in frame a; exp maps twists to poses",
    "joints": "0 to n-1 have a motor and are q, in this order; n to n+p-1 are passive; the others "
    "stand at closed_at. parents, carriers and tool name the joint that carries a placement, -1 "
    "the base K_0",
    "placements": "first those of the joints, then A and B of every loop, the last that of the "
    "tool",
    "tree": "F_i = F_parent(i) M_i exp(x_i t_i), M_i a placement, x_i a twist, t_i the position of "
    "joint i; a cut frame or the tool is F_carrier M",
    "closure": "loop l: E = T_0_A^-1 T_0_B; the translation of E and its rotation vector are zero "
    "in the components `equations` (0 to 2 and 3 to 5; with fewer than three of the rotation, of "
    "the axes z alone: 3 is -E[1][2], 4 is E[0][2]). A mimic joint: t_joint = factor t_leader + "
    "offset. For given q these p equations determine the passive joints: of their solutions, the "
    "one that is reached from closed_at without a singularity",
    "nominal": "T_nominal(q): tree and closure with nominal_placements_m and "
    "nominal_twists_per_rad_or_m",
    "motion": "d_j = offset_errors[j] + sum over h of a_jh sin(h q_j) + b_jh cos(h q_j) "
    "(harmonics_rad: a_j1, b_j1, a_j2, ...) - compliance_rad_per_nm[j] tau_j(q) + "
    "payload_rad_per_nm[j][0] mu_j(q). tau is the derivative of the potential energy of the links "
    "(link_masses_kg at centres_of_mass_m of the joints' frames, gravity_m_per_s2) by q_j along "
    "the nominal closed mechanism; mu_j = payload_kg gravity . dp/dq_j, p the nominal tool point, "
    "0 for slides",
    "base": "T_base(q): tree and closure with placements_m, twists_per_rad_or_m and q + d",
    "calibrated": "T(q) = exp(J(q) N(q)) T_base(q); J (6 x p_rho): spatial columns of the closed "
    "mechanism by q, then Ad(T_base) of the virtual joints (columns virtual_joint_columns). "
    "N(q) = output_scale (W2 tanh(W1 (q - input_centre) / input_scale + b1) + b2); "
    "if network.kind is gaussian-process output_scale W2 exp(-|s - points_i|^2 / 2), "
    "s = (q - input_centre) / input_scale; 0 for null",
    "correction": "q_m near q with the task components of T(q_m) against T_nominal(q) equal: "
    "R' (p - p_c) and R' log(R R_c'), R' = R_c transposed, of the components in `task`",
}


def closed_calibration_as_json(calibration: Calibration) -> str:
    """One JSON object, schema `calibtool/closed-compensator`: every number of the exact correction.

    Units are in the key names, frames and rules under `formula`. The same calibration gives the
    same text.
    """
    robot, chain, equivalent = calibration.robot, calibration.robot.chain, calibration.equivalent
    assert isinstance(chain, ClosedChain)
    tree, errors, conditions = chain.tree, calibration.errors, calibration.conditions
    rows = Rows(robot, robot.workspace("full").home[None], conditions)
    masses, centres = _masses(calibration)
    task = Task.of(equivalent)
    network = calibration.network
    contents: dict[str, Any] = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "robot": robot.name,
        "formula": FORMULA,
        "joints": [
            {
                "name": name,
                "kind": "prismatic" if slide else "revolute",
                "role": "actuated" if j < tree.n else "passive" if j < tree.n + tree.p else "idle",
                "lower_rad_or_m": _finite(robot.lower[j] if j < tree.n else tree.lower[j]),
                "upper_rad_or_m": _finite(robot.upper[j] if j < tree.n else tree.upper[j]),
            }
            for j, (name, slide) in enumerate(zip(chain.bodies.joints, tree.slides, strict=True))
        ],
        "parents": list(tree.parents),
        "carriers": list(tree.carriers),
        "tool": tree.tool,
        "loops": [
            {
                "name": loop.name,
                "joint": loop.joint,
                "forbidden": list(FORBIDDEN[loop.joint]),
                "equations": list(loop.rows),
            }
            for loop in tree.loops
        ],
        "mimic_joints": [
            {"joint": f.joint, "leader": f.leader, "factor": f.factor, "offset_rad_or_m": f.offset}
            for f in tree.followers
        ],
        "closed_at_rad_or_m": tree.closed_at.tolist(),
        "characteristic_length_m": robot.length,
        "nominal_placements_m": chain.placements.tolist(),
        "nominal_twists_per_rad_or_m": chain.twists.tolist(),
        "base_model": {
            "name": calibration.base.model,
            "placements_m": errors.standing(conditions).placements.tolist(),
            "twists_per_rad_or_m": errors.twists.tolist(),
            "offset_errors_rad_or_m": errors["offsets"].tolist(),
            "harmonics_rad": errors["harmonics"].tolist(),
            "compliance_rad_per_nm": errors["gravity"].tolist(),
            "payload_rad_per_nm": errors["payload"].tolist(),
            "backlash_rad_or_m": errors["backlash"].tolist(),
            "link_masses_kg": masses.tolist(),
            "centres_of_mass_m": centres.tolist(),
            "gravity_m_per_s2": chain.bodies.gravity.tolist(),
            "payload_kg": float(rows.payload),
        },
        "virtual_joints": list(equivalent.virtual_joints),
        "virtual_joint_columns": equivalent.virtual_columns,
        "task": list(range(6) if task.components is None else task.components),
        "network": None
        if network is None
        else {"kind": network.id}
        | {name: getattr(network, name).tolist() for name in network.fields},
        "configurations": calibration.configurations,
        "noise_position_m": calibration.noise_position,
        "noise_orientation_rad": calibration.noise_orientation,
        "provenance": calibration.provenance,
    }
    return json.dumps(contents, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _masses(calibration: Calibration) -> tuple[Array, Array]:
    """Masses (J,) kg and their centres (J, 3) in the joints' frames, m, by the chain's numbers."""
    chain = calibration.robot.chain
    inertias = list(gravity_model(calibration.robot).inertias)
    own = [inertias[chain.model_joints[j]] for j in range(chain.n_all)]
    return np.array([i.mass for i in own]), np.array([np.array(i.lever) for i in own])
