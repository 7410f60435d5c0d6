"""A calibration as JSON, complete without URDF, catalogue and calibtool."""

import json
from typing import Any

import numpy as np

from calibtool.calibration import Calibration
from calibtool.compensation.one_step import default_bounds
from calibtool.compensation.step import DAMPED_BELOW
from calibtool.equivalent.regressor import Regressor
from calibtool.errormodel.bending import directions
from calibtool.errormodel.family import Rows
from calibtool.errors import UsageError
from calibtool.export.closed_json import closed_calibration_as_json
from calibtool.export.formula import FORMULA
from calibtool.export.rendering import LARGEST_POSITION, check_words
from calibtool.measurement.setup import Setup
from calibtool.robot.coupling import JointValues
from calibtool.robot.gravity_torque import link_masses
from calibtool.robot.robot import Robot
from calibtool.robot.singularity import GRAM_REGULARISATION

SCHEMA, SCHEMA_VERSION = "calibtool/compensator", 4

# Families of errors by id, and their keys: what a family does stands in FORMULA.
ERROR_KEYS = {
    "placements": "placement_errors_m_rad",
    "twists": "twist_errors_per_rad_or_m",
    "offsets": "offset_errors_rad_or_m",
    "harmonics": "harmonics_rad",
    "pairs": "pairs_rad",
    "gravity": "compliance_rad_per_nm",
    "backlash": "backlash_rad_or_m",
    "wobble": "wobble_rad",
    "bending": "bending_rad_per_nm",
    "payload": "payload_rad_per_nm",
    "temperature": "expansion_per_k",
}


def calibration_as_json(calibration: Calibration, joint_values: JointValues = "serial") -> str:
    """One JSON object, schema `calibtool/compensator`: the rule for q_m (`one_step`), and every
    number for it.

    Units are in the key names (m, rad; `rad_or_m`: in the unit of the joint), frames under
    `formula`. A float is written with as many digits as reading back exactly the same one requires;
    the same calibration gives the same text. joint_values: the kind of the joint values q and q_m.
    """
    check_words(joint_values)
    robot, equivalent = calibration.robot, calibration.equivalent
    if robot.chain.tree is not None:
        if robot.coupled:
            raise UsageError(f"{robot.name}: JSON of closed loops holds no coupled joint values")
        return closed_calibration_as_json(calibration)
    bounds = default_bounds(calibration)
    contents = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "robot": robot.name,
        "formula": FORMULA,
        "joints": _joints(robot),
        "joint_coupling": robot.coupling.tolist(),
        "joint_values": joint_values,
        "nominal_placements_m": robot.chain.placements.tolist(),
        "nominal_twists_per_rad_or_m": robot.chain.twists.tolist(),
        "base_model": _base_model(calibration),
        "equivalent_robot": {
            "p": equivalent.p,
            "virtual_joints": list(equivalent.virtual_joints),
            "virtual_joint_columns": equivalent.virtual_columns,
        },
        "characteristic_length_m": robot.length,
        "largest_position_rad_or_m": LARGEST_POSITION,
        "largest_change_rad_or_m": bounds.of_joints(robot).tolist(),
        "usual_error_rad": {"task": bounds.usual[0], "all": bounds.usual[1]},
        "damped_below": DAMPED_BELOW,
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
            "name": robot.chain.bodies.joints[j],
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
        "across_axes": np.swapaxes(directions(robot), 1, 2).tolist(),
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
    """The set-up of the measurements; the correction does not use it."""
    return {
        "T_instrument_base_m": setup.T_instrument_base.tolist(),
        "targets_m": setup.targets.tolist(),
        "kind": setup.kind.id,
        **{name: array.tolist() for name, array in setup.arrays.items()},
        "frame_known": setup.frame_known,
        "targets_known": setup.targets_known,
    }
