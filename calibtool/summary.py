"""What a robot or a file holds, as plain dictionaries: the JSON of `robots` and
`info`, and their text.
"""

import numpy as np

from calibtool.calibration import Calibration
from calibtool.calibration.frame_report import frame_report
from calibtool.calibration.learning_curve import LearningCurve
from calibtool.equivalent.joints import equivalent_robot
from calibtool.equivalent.training import TrainingReport
from calibtool.identification.identification import Identification, Posterior
from calibtool.identification.report import parameter_rows, strongest_correlations
from calibtool.measurement.checks import design_findings
from calibtool.measurement.measurements import Measurements, Setup
from calibtool.robot.coupling import coupling_text
from calibtool.robot.robot import Robot
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
    """Joints with limits and axes, targets, workspaces, virtual joints and notes;
    units in the keys.
    """
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
        **({"joint_values": f"serial ({coupling_text(robot.coupling)})"} if robot.coupled else {}),
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
        "observation": measurements.setup.kind.words.format(m=measurements.points.shape[1]),
        "noise_position_mm": measurements.noise_position * 1e3,
        "registration": _setup_summary(measurements.setup),
        "directions": "unknown" if measurements.conditions.direction is None else "known",
        "commanded": "the joints"
        if measurements.commanded is None
        else "poses, apart from the joints",
        "simulated": measurements.truth is not None,
    }
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
        "registration": _setup_summary(calibration.setup),
        "frame": None if (report := frame_report(calibration)) is None else report.as_json(),
    }


def calibration_lines(calibration: Calibration) -> list[str]:
    """A few lines for people: what was determined, how well it fits, what is suspicious, whether
    the network helps.
    """
    base, training = calibration.base, calibration.training
    noise = f"stated noise {calibration.noise_position * 1e3:.3g} mm"
    fit = f"residual {base.residual_rms[0] * 1e3:.3g} mm rms per coordinate, {noise}"
    if base.residual_rms[1] is not None:
        fit += (
            f"; {base.residual_rms[1] * 1e3:.3g} mrad, stated "
            f"{calibration.noise_orientation * 1e3:.3g}"
        )
    result = [
        f"{base.model}: {calibration.robot.name}, {calibration.configurations} "
        f"configurations, {fit}"
    ]
    if base.posterior is not None:
        result += _complete_lines(calibration)
    elif base.model == "local-poe":
        result += _rank_lines(base)
    report = frame_report(calibration)
    result += [] if report is None else report.lines()
    result += [str(finding) for finding in design_findings(calibration.robot, calibration.q)]
    if base.flagged is not None and len(base.flagged.rows):
        result += _flagged_lines(calibration)
    validation = calibration.validation
    if validation is not None:
        verdict = f"cross-validated gain {validation}"
        members = (
            "" if training is None else f"{training.effective:.1f} effective weights of a member"
        )
        used = (
            f"{len(calibration.networks)} members, {members}"
            if calibration.networks
            else "not used"
        )
        result.append(f"network: {used} ({verdict})")
    elif training is not None:
        gain = _loss_reduction(training)
        judged = "validation" if len(training.validation_rows) else "training"
        if calibration.network is None:
            result.append(f"network: not used, it does not lower the {judged} loss ({gain:+.1f} %)")
        else:
            result.append(
                f"network: {training.hidden} hidden nodes, {training.loss} loss, "
                f"{training.optimiser}, iteration {training.history.chosen}, {judged} loss "
                f"{-gain:+.1f} %"
            )
    return result


def _rank_lines(base: Identification) -> list[str]:
    result = []
    if base.parameters:
        kept = base.singular_values[: base.rank]
        result.append(
            f"rank {base.rank} of {base.parameters} parameters ({base.observable_rank} could "
            f"be determined), singular values {kept[-1]:.3g} to {kept[0]:.3g}, "
            f"{base.iterations} iterations"
        )
    if base.unobservable:
        missing = base.observable_rank - base.rank
        result.append(
            f"warning: {missing} directions are not observable from these configurations, such as "
            f"{base.unobservable[0]}"
        )
    return result


def _complete_lines(calibration: Calibration) -> list[str]:
    base = calibration.base
    posterior = base.posterior
    assert posterior is not None
    parameters = posterior.parameters
    told = [
        part.family.told(calibration.robot, base.errors[part.family.id], part.free)
        for part in parameters.parts
        if not part.family.always
    ]
    functions = ", ".join(told) or "geometry alone"
    estimated = posterior.noise_factor * calibration.noise_position * 1e3
    result = [
        f"{posterior.effective:.1f} of {base.observable_rank} directions determined "
        f"({parameters.count} parameters), {functions}, estimated noise {estimated:.3g} mm, "
        f"{base.iterations} iterations"
    ]
    if not 0.5 <= posterior.noise_factor <= 2.0:
        result.append(
            f"warning: the residuals say {estimated:.3g} mm of noise, stated are "
            f"{calibration.noise_position * 1e3:.3g} mm: either the statement is wrong or the "
            "robot does what the model cannot describe"
        )
    if base.unobservable:
        names = ", ".join(base.unobservable[:6]) + (" …" if len(base.unobservable) > 6 else "")
        result.append(
            f"{len(base.unobservable)} parameters stay at their tolerance (not observable "
            f"here): {names}"
        )
    return result


def _flagged_lines(calibration: Calibration) -> list[str]:
    flagged = calibration.base.flagged
    assert flagged is not None
    done = (
        "left out"
        if flagged.dropped
        else "kept; --loss-function cauchy lowers their weight, --drop-flagged leaves them out"
    )
    count = len(flagged.rows)
    result = [f"warning: {count} {'row does' if count == 1 else 'rows do'} not fit ({done})"]
    order = np.argsort(-flagged.deviation)[:5]
    result += [
        f"  configuration {flagged.rows[k] + 1}: {flagged.position[k] * 1e3:.3g} mm, "
        f"{flagged.deviation[k]:.1f} times the noise"
        for k in order
    ]
    if flagged.cluster:
        result.append(f"  {flagged.cluster}")
    return result


def _posterior_summary(calibration: Calibration, posterior: Posterior) -> dict[str, object]:
    parameters = posterior.parameters
    rows = parameter_rows(calibration.base)
    return {
        "effective_parameters": posterior.effective,
        "estimated_noise_mm": posterior.noise_factor * calibration.noise_position * 1e3,
        "log_evidence": posterior.log_evidence,
        "families": parameters.orders,
        "parameter_table": [
            {
                "id": row.id,
                "name": row.name,
                "unit": row.unit,
                "value": row.value,
                "std": row.std,
                "tolerance": row.tolerance,
                "determined": row.determined,
                "at_prior": row.at_prior,
            }
            for row in rows
        ],
        "correlations": [
            {"parameters": [a, b], "correlation": value}
            for a, b, value in strongest_correlations(posterior)
        ],
    }


def _loss_reduction(training: TrainingReport) -> float:
    """Reduction of the loss by the best network, in percent."""
    without = training.loss_without
    return 100.0 * (1.0 - float(training.restart_losses.min()) / without) if without > 0 else 0.0


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
        "base_in_instrument_mm": _rounded(setup.T_instrument_base[:3, 3] * 1e3),
        "base_in_instrument_rotation_vector_deg": _rounded(np.rad2deg(twist[3:])),
        "targets_on_tool_mm": [_rounded(point * 1e3) for point in setup.targets],
    }


def _rounded(values: Array) -> list[float]:
    return [round(float(v), 6) + 0.0 for v in values]
