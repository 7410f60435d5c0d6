"""What a robot or a file holds, as plain dictionaries: the JSON of `robots` and `info`, and their text."""

import numpy as np

from calibtool.calibration import Calibration
from calibtool.equivalent.joints import equivalent_robot
from calibtool.equivalent.training import TrainingReport
from calibtool.measurement.measurements import Measurements, Setup
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array, log6


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
    """Joints with limits and axes, targets, workspaces, virtual joints and notes; units in the keys."""
    description = robot.source.description
    home = robot.mechanism.forward(robot.home(robot.workspace(None)[1])[None])[0]
    joints = []
    for j, prismatic in enumerate(robot.prismatic):
        factor, unit = (1e3, "mm") if prismatic else (180.0 / np.pi, "deg")
        twist = robot.chain.twists[j]
        joints.append(
            {
                "name": str(robot.chain.model.names[j + 1]),
                "kind": "prismatic" if prismatic else "revolute",
                f"lower_{unit}": round(float(robot.lower[j]) * factor, 6),
                f"upper_{unit}": round(float(robot.upper[j]) * factor, 6),
                "axis": [round(float(v), 9) + 0.0 for v in (twist[:3] if prismatic else twist[3:])],
            }
        )
    return {
        "schema": "calibtool/robot",
        "schema_version": 1,
        **robot_entry(robot),
        "tool_frame": description.kinematics.tool_frame,
        "characteristic_length_m": round(robot.length, 6),
        "joint_table": joints,
        "targets_mm": [[round(float(v) * 1e3, 6) for v in point] for point in robot.targets],
        "home_tool_position_mm": [round(float(v) * 1e3, 3) for v in home[:3, 3]],
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
        "observation": f"{measurements.points.shape[1]} target points" if measurements.kind == "points" else "6-D pose",
        "noise_position_mm": measurements.noise_position * 1e3,
        "registration": _setup_summary(measurements.setup),
        "simulated": measurements.truth is not None,
    }
    if measurements.kind == "pose":
        summary["noise_orientation_mrad"] = measurements.noise_orientation * 1e3
    if measurements.truth is not None:
        actual = measurements.truth.actual
        parts = {
            "geometric": any(
                a.any() for a in (actual.geometry.placements, actual.geometry.twists, actual.geometry.offsets)
            ),
            "gear": bool(actual.gear.any()),
            "gravity": bool(actual.compliance.any()),
            "backlash": bool(actual.backlash.any()),
            "thermal": actual.expansion != 0.0,
        }
        summary["errors"] = [name for name, present in parts.items() if present]
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
    if base.parameters:
        base_summary |= {
            "parameters": base.parameters,
            "rank": base.rank,
            "observable_rank": base.observable_rank,
            "iterations": base.iterations,
            "singular_values": [float(f"{s:.6g}") for s in base.singular_values],
            "unobservable": list(base.unobservable),
        }
    network: dict[str, object] = {"used": calibration.network is not None}
    if training is not None:
        network |= {
            "loss": training.loss,
            "optimizer": training.optimiser,
            "hidden": training.hidden,
            "training_configurations": len(training.training_rows),
            "validation_configurations": len(training.validation_rows),
            "restarts": len(training.restart_losses),
            "iterations": training.history.chosen,
            "stopped": training.history.reason,
            "loss_reduction_percent": _loss_reduction(training),
        }
    return {
        "kind": "calibration",
        "schema_version": 1,
        "robot": calibration.robot.name,
        "configurations": calibration.configurations,
        "base": base_summary,
        "network": network,
        "virtual_joints": list(calibration.equivalent.virtual_joints),
        "registration": _setup_summary(base.setup),
    }


def calibration_lines(calibration: Calibration) -> list[str]:
    """A few lines for people: what was determined, how well it fits, whether the network helps."""
    base, training = calibration.base, calibration.training
    noise = f"stated noise {calibration.noise_position * 1e3:.3g} mm"
    fit = f"residual {base.residual_rms[0] * 1e3:.3g} mm rms per coordinate, {noise}"
    if base.residual_rms[1] is not None:
        fit += f"; {base.residual_rms[1] * 1e3:.3g} mrad, stated {calibration.noise_orientation * 1e3:.3g}"
    result = [f"{base.model}: {calibration.robot.name}, {calibration.configurations} configurations, {fit}"]
    if base.parameters:
        kept = base.singular_values[: base.rank]
        result.append(
            f"rank {base.rank} of {base.parameters} parameters ({base.observable_rank} could be determined), "
            f"singular values {kept[-1]:.3g} to {kept[0]:.3g}, {base.iterations} iterations"
        )
    if base.unobservable:
        missing = base.observable_rank - base.rank
        result.append(
            f"warning: {missing} directions are not observable from these configurations, such as {base.unobservable[0]}"
        )
    if training is None:
        return result
    gain = _loss_reduction(training)
    judged = "validation" if len(training.validation_rows) else "training"
    if calibration.network is None:
        result.append(f"network: not used, it does not lower the {judged} loss ({gain:+.1f} %)")
    else:
        result.append(
            f"network: {training.hidden} hidden nodes, {training.loss} loss, {training.optimiser}, iteration "
            f"{training.history.chosen}, {judged} loss {-gain:+.1f} %"
        )
    return result


def _loss_reduction(training: TrainingReport) -> float:
    """Reduction of the loss by the best network, in percent."""
    without = training.loss_without
    return 100.0 * (1.0 - float(training.restart_losses.min()) / without) if without > 0 else 0.0


def _setup_summary(setup: Setup) -> dict[str, object]:
    twist = log6(setup.T_instrument_base)
    return {
        "frame": "known" if setup.frame_known else "estimated",
        "targets": "known" if setup.targets_known else "estimated",
        "base_in_instrument_mm": _rounded(setup.T_instrument_base[:3, 3] * 1e3),
        "base_in_instrument_rotation_vector_deg": _rounded(np.rad2deg(twist[3:])),
        "targets_on_tool_mm": [_rounded(point * 1e3) for point in setup.targets],
    }


def _rounded(values: Array) -> list[float]:
    return [round(float(v), 6) + 0.0 for v in values]
