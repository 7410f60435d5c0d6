"""What a fit found, for people: a few lines, and the table of its parameters."""

import numpy as np

from calibtool.calibration.calibration import Calibration, CrossValidation
from calibtool.calibration.frame_report import frame_report
from calibtool.equivalent.gaussian_process import GaussianProcess
from calibtool.equivalent.training import TrainingReport
from calibtool.identification.identification import Identification
from calibtool.identification.report import parameter_rows, strongest_correlations
from calibtool.measurement.checks import design_findings
from calibtool.units import count_of, millimetres

_CORRELATED = 0.9  # pairs of parameters with a larger correlation are listed


def fit_summary(calibration: Calibration) -> str:
    """The lines of `fit_lines`, every parameter with its standard deviation, and the pairs that
    the measurements hardly distinguish.
    """
    result = fit_lines(calibration)
    posterior = calibration.base.posterior
    if posterior is None:
        return "\n".join(result)
    rows = parameter_rows(calibration.base)
    determined = [row for row in rows if not row.at_prior]
    width = max((len(row.id) for row in determined), default=0)
    result.append("parameters:")
    for row in determined:
        result.append(
            f"  {row.id:<{width}}  {row.value:+10.4f} ± {row.std:.4f} {row.unit}"
            f"  ({row.determined:.0%} determined, tolerance {row.tolerance:.3g})"
        )
    others = len(rows) - len(determined)
    if others:
        result.append(f"  {others} more stay at zero: these configurations do not determine them")
    pairs = [pair for pair in strongest_correlations(posterior) if abs(pair[2]) > _CORRELATED]
    if pairs:
        result.append("correlations:")
        result += [f"  {a}, {b}: {value:+.3f}" for a, b, value in pairs]
    return "\n".join(result)


def fit_lines(calibration: Calibration) -> list[str]:
    """Lines for people: parameters, quality of the fit, warnings, use of the network."""
    base, training = calibration.base, calibration.training
    noise = f"stated noise {millimetres(calibration.noise_position)}"
    fit = f"residual {millimetres(base.residual_rms[0])} rms per coordinate, {noise}"
    if base.residual_rms[1] is not None:
        fit += (
            f"; {base.residual_rms[1] * 1e3:.3g} mrad, stated "
            f"{calibration.noise_orientation * 1e3:.3g}"
        )
    result = [
        f"{base.model} model of {calibration.robot.name}, "
        f"{count_of(calibration.configurations, 'configuration')}: {fit}"
    ]
    if base.held_out:
        result.append(_compared(base))
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
        result.append(_learned_line(calibration, validation))
    elif training is not None and training.regularisation == "bayes" and not calibration.networks:
        result.append(
            "neural network: not used: where some configurations are left out, the others do not "
            "determine the model"
        )
    elif training is not None:
        gain = loss_reduction(training)
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


def _learned_line(calibration: Calibration, validation: CrossValidation) -> str:
    """The learned model that was tried, whether it is used, and the verdict."""
    training, networks = calibration.training, calibration.networks
    process = training is not None and training.regressor == GaussianProcess.id
    effective = "" if training is None else f", {training.effective:.1f} effective weights"
    used = "not used"
    if networks and process:
        used = f"{count_of(networks[0].hidden, 'point')}{effective}"
    elif networks:
        used = f"{len(networks)} members{effective} of a member"
    kind = "Gaussian process" if process else "neural network"
    return f"{kind}: {used} (cross-validated gain {validation})"


def _compared(base: Identification) -> str:
    """Why this model was chosen."""
    errors = ", ".join(f"{name} {value:.3g}" for name, value in sorted(base.held_out.items()))
    why = {
        "nominal": "registration alone is used: no other model predicts held-out rows better",
        "local-poe": "local POE is used: it predicts held-out rows clearly better",
        "complete": "complete is used: no simpler model predicts held-out rows clearly better",
    }[base.model]
    if base.posterior is not None and "geometry" in base.held_out:
        parts = base.posterior.parameters.parts
        if all(part.family.always for part in parts if len(part.elements)):
            why = (
                "geometry and joint offsets alone are used: nothing else predicts held-out rows "
                "clearly better"
            )
    return f"{why} (rms in multiples of the stated noise: {errors})"


def _rank_lines(base: Identification) -> list[str]:
    result = []
    if base.parameters:
        kept = base.singular_values[: base.rank]
        result.append(
            f"rank {base.rank} of {base.parameters} parameters ({base.observable_rank} can "
            f"be determined at best), singular values {kept[-1]:.3g} to {kept[0]:.3g}, "
            f"{base.iterations} iterations"
        )
    if base.unobservable:
        missing = base.observable_rank - base.rank
        result.append(
            f"warning: {missing} combinations of parameters cannot be determined from these "
            f"configurations, such as {base.unobservable[0]}"
        )
    return result


def _complete_lines(calibration: Calibration) -> list[str]:
    base = calibration.base
    posterior = base.posterior
    assert posterior is not None
    parameters = posterior.parameters
    described = [
        part.family.describe(calibration.robot, base.errors[part.family.id], part.free)
        for part in parameters.parts
        if not part.family.always
    ]
    functions = ", ".join(described)
    estimated = posterior.noise_factor * calibration.noise_position * 1e3
    result = [
        f"found beside errors of the geometry: {functions}"
        if described
        else "found: errors of the geometry alone",
        f"the measurements determine {posterior.effective:.1f} of {base.observable_rank} "
        f"combinations of {parameters.count} parameters; the residuals are those of "
        f"{estimated:.3g} mm of noise",
    ]
    if not 0.5 <= posterior.noise_factor <= 2.0:
        result.append(
            f"warning: the residuals are those of {estimated:.3g} mm of noise, but "
            f"{millimetres(calibration.noise_position)} are stated: "
            + (
                "either the stated noise is wrong, or the robot has errors that the model does not "
                "describe"
                if posterior.noise_factor > 1.0
                else "the stated noise is too large"
            )
        )
    if base.unobservable:
        names = ", ".join(base.unobservable[:6]) + (" …" if len(base.unobservable) > 6 else "")
        count = len(base.unobservable)
        result.append(
            f"{count_of(count, 'parameter is', 'parameters are')} not seen in these configurations "
            f"and {'stays' if count == 1 else 'stay'} near zero, within the tolerance: {names}"
        )
    return result


def _flagged_lines(calibration: Calibration) -> list[str]:
    flagged = calibration.base.flagged
    assert flagged is not None
    count = len(flagged.rows)
    it_has, it = ("it has", "it") if count == 1 else ("they have", "them")
    region = "" if count == 1 else ", unless they are one region of the workspace"
    done = (
        f"{it_has} been left out"
        if flagged.dropped
        else f"{it_has} less weight{region}; --drop-flagged leaves {it} out"
    )
    result = [f"warning: {count_of(count, 'row does', 'rows do')} not fit: {done}"]
    order = np.argsort(-flagged.deviation)[:5]
    result += [
        f"  configuration {flagged.rows[k] + 1}: {millimetres(flagged.position[k])}, "
        f"{flagged.deviation[k]:.1f} times the noise"
        for k in order
    ]
    if flagged.cluster:
        result.append(f"  {flagged.cluster}")
    return result


def loss_reduction(training: TrainingReport) -> float:
    """Reduction of the loss by the best network, in percent."""
    without = training.loss_without
    return 100.0 * (1.0 - float(training.restart_losses.min()) / without) if without > 0 else 0.0
