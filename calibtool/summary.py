"""Contents of a robot or a file as dictionaries: JSON and text of `robots` and `info`."""

import numpy as np

from calibtool.calibration import Calibration
from calibtool.calibration.fit_summary import loss_reduction
from calibtool.calibration.frame_report import frame_report
from calibtool.calibration.learning_curve import LearningCurve
from calibtool.equivalent.joints import equivalent_robot
from calibtool.identification.identification import Posterior
from calibtool.identification.report import parameter_rows, strongest_correlations
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.setup import Setup
from calibtool.robot.coupling import coupling_text
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import log6
from calibtool.units import rounded

_OF_PARAMETER = ("id", "name", "unit", "value", "std", "tolerance", "determined", "at_prior")


def robot_entry(robot: Robot) -> dict[str, object]:
    """One line of the catalogue."""
    kinds = "".join("P" if p else "R" for p in robot.prismatic)
    return {
        "name": robot.name,
        "joints": kinds,
        "title": robot.source.description.title,
        "workspaces": robot.workspace_names,
    }


def robot_summary(robot: Robot) -> dict[str, object]:
    """Joints, limits, axes, targets, workspaces, virtual joints and notes; units in the keys."""
    description = robot.source.description
    home = robot.mechanism.forward(robot.workspace().home[None])[0]
    joints = []
    for j, prismatic in enumerate(robot.prismatic):
        factor, unit = robot.display_unit(j)
        twist = robot.chain.twists[j]
        joints.append(
            {
                "name": robot.chain.bodies.joints[j],
                "kind": "prismatic" if prismatic else "revolute",
                f"lower_{unit}": round(float(robot.lower[j]) * factor, 6),
                f"upper_{unit}": round(float(robot.upper[j]) * factor, 6),
                "axis": rounded(twist[:3] if prismatic else twist[3:], 9),
            }
        )
    return {
        "schema": "calibtool/robot",
        "schema_version": 1,
        **robot_entry(robot),
        "tool_frame": description.kinematics.tool_frame,
        "characteristic_length_m": round(robot.length, 6),
        "joint_table": joints,
        **({"joint_values": f"serial ({coupling_text(robot.coupling)})"} if robot.coupled else {}),
        "targets_mm": [rounded(point * 1e3) for point in robot.targets],
        "home_tool_position_mm": rounded(home[:3, 3] * 1e3, 3),
        "workspace_table": {
            name: {"box_m": list(w.box_m), "cone_deg": w.cone_deg, "home": dict(w.home)}
            for name, w in description.workspaces.items()
        },
        "virtual_joints": list(equivalent_robot(robot).virtual_joints),
        "notes": list(description.notes),
    }


def measurements_summary(measurements: Measurements) -> dict[str, object]:
    """Counts, noise, set-up and, for a simulation, what was simulated."""
    summary: dict[str, object] = {
        "kind": "measurements",
        "schema_version": 1,
        "robot": measurements.robot.name,
        "configurations": len(measurements),
        "observation": measurements.setup.kind.words.format(m=measurements.points.shape[1]),
        "noise_position_mm": measurements.noise_position * 1e3,
        "registration": _setup_summary(measurements.setup),
        "directions": "unknown" if measurements.conditions.direction is None else "known",
        "commanded": "the joints"
        if measurements.commanded is None
        else "poses, apart from the joints",
        "simulated": measurements.truth is not None,
    }
    if measurements.places:
        summary["places"] = list(measurements.places)
    if measurements.kind == "pose":
        summary["noise_orientation_mrad"] = measurements.noise_orientation * 1e3
    if measurements.truth is not None:
        kinds = (family.kind for family in measurements.truth.actual.errors.present)
        summary["errors"] = list(dict.fromkeys(kinds))
    return summary


def calibration_summary(calibration: Calibration) -> dict[str, object]:
    """Base model with rank and singular values, network and training."""
    base, training = calibration.base, calibration.training
    position, orientation = base.residual_rms
    base_summary: dict[str, object] = {
        "model": base.model,
        "residual_rms_mm": position * 1e3,
        "residual_rms_mrad": None if orientation is None else orientation * 1e3,
    }
    if base.held_out:
        base_summary["held_out_rms_in_stated_noises"] = dict(base.held_out)
    if base.parameters:
        base_summary |= {
            "parameters": base.parameters,
            "rank": base.rank,
            "observable_rank": base.observable_rank,
            "iterations": base.iterations,
            "singular_values": [float(f"{s:.6g}") for s in base.singular_values],
            "unobservable": list(base.unobservable),
        }
    if base.posterior is not None:
        base_summary |= _posterior_summary(calibration, base.posterior)
    if base.flagged is not None:
        flagged = base.flagged
        base_summary["flagged"] = {
            "configurations": [int(row) + 1 for row in flagged.rows],
            "residual_mm": [float(f"{v * 1e3:.6g}") for v in flagged.position],
            "standard_deviations": [float(f"{v:.6g}") for v in flagged.deviation],
            "cluster": flagged.cluster,
            "dropped": flagged.dropped,
        }
    network: dict[str, object] = {"used": calibration.network is not None}
    if calibration.validation is not None:
        network["cross_validation"] = {
            "folds": calibration.validation.folds,
            "gain_percent": calibration.validation.gain,
            "standard_error_percent": calibration.validation.standard_error,
        }
    if training is not None:
        network |= {
            "regressor": training.regressor,
            "loss": training.loss,
            "regularisation": training.regularisation,
            "optimizer": training.optimiser,
            "members": len(calibration.networks),
            "effective_weights": training.effective,
            "hidden": training.hidden,
            "training_configurations": len(training.training_rows),
            "validation_configurations": len(training.validation_rows),
            "restarts": len(training.restart_losses),
            "iterations": training.history.chosen,
            "stopped": training.history.reason,
            "loss_reduction_percent": loss_reduction(training),
        }
    return {
        "kind": "calibration",
        "schema_version": 1,
        "robot": calibration.robot.name,
        "configurations": calibration.configurations,
        "base": base_summary,
        "network": network,
        "virtual_joints": list(calibration.equivalent.virtual_joints),
        "registration": _setup_summary(calibration.setup),
        "frame": None if (report := frame_report(calibration)) is None else report.as_json(),
    }


def _posterior_summary(calibration: Calibration, posterior: Posterior) -> dict[str, object]:
    parameters = posterior.parameters
    rows = parameter_rows(calibration.base)
    return {
        "effective_parameters": posterior.effective,
        "estimated_noise_mm": posterior.noise_factor * calibration.noise_position * 1e3,
        "log_evidence": posterior.log_evidence,
        "families": parameters.orders,
        "parameter_table": [{key: getattr(row, key) for key in _OF_PARAMETER} for row in rows],
        "correlations": [
            {"parameters": [a, b], "correlation": value}
            for a, b, value in strongest_correlations(posterior)
        ],
    }


def learning_curve_summary(curve: LearningCurve) -> dict[str, object]:
    """Cross-validated errors, and what more configurations would buy."""
    last = int(curve.configurations[-1])
    return {
        "configurations": [int(count) for count in curve.configurations],
        "position_rms_mm": [float(error) * 1e3 for error in curve.error],
        "floor_mm": curve.floor * 1e3,
        "predicted": [
            {"configurations": count, "position_rms_mm": curve.predicted(count) * 1e3}
            for count in (2 * last, 4 * last)
        ],
    }


def learning_curve_lines(curve: LearningCurve, count: int) -> list[str]:
    """The same for people."""
    pairs = zip(curve.configurations, curve.error, strict=True)
    points = ", ".join(f"{size}: {error * 1e3:.3g} mm" for size, error in pairs)
    return [
        f"learning curve (rms per coordinate on held-out rows, noise included): {points}",
        f"{count} more configurations would give about {curve.predicted(2 * count) * 1e3:.3g} mm, "
        f"no number of them less than {curve.floor * 1e3:.3g} mm",
    ]


def _setup_summary(setup: Setup) -> dict[str, object]:
    twist = log6(setup.T_instrument_base)
    return {
        "frame": "known" if setup.frame_known else "estimated",
        "targets": "known" if setup.targets_known else "estimated",
        "base_in_instrument_mm": rounded(setup.T_instrument_base[:3, 3] * 1e3),
        "base_in_instrument_rotation_vector_deg": rounded(np.rad2deg(twist[3:])),
        "targets_on_tool_mm": [rounded(point * 1e3) for point in setup.targets],
    }
