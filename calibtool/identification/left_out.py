"""What the sections that a model leaves out mean for ± of the parameters that it has."""

import numpy as np

from calibtool.errormodel.tolerances import Tolerances
from calibtool.identification.equations import normal_equations
from calibtool.identification.evidence import inverse
from calibtool.identification.fitting import Fit
from calibtool.identification.parameters import Parameters
from calibtool.measurement.measurements import Measurements
from calibtool.robot.se3 import Array


def left_out_variance(
    measurements: Measurements,
    offered: Parameters,
    tolerances: Tolerances | None,
    fitted: Fit,
    prior_std: Array,
    covariance: Array,
) -> Array:
    """Variance (p,) to be added to that of every parameter of a fit, SI squared.

    A section is left out where poses are predicted as well without it: the robot does not have it,
    or other parameters take up what it does, and are then not what they are of the whole robot.
    With everything that was offered, the posterior is N(θ̂ + δ, Σ'), of mean square Σ'_kk + δ_k²
    about the estimate; what exceeds Σ_kk is returned. δ = Σ'_kd g_d/σ² for the parameters d that
    were left out, because at θ̂ the gradient of the others is zero.

    prior_std (p,) and covariance Σ (p, p) are those of the fit. Where tolerances of a group were
    re-estimated, its parameters that were left out have the same scale.
    """
    larger, kept = _together(measurements, fitted.parameters, offered)
    if kept.all():
        return np.zeros(len(prior_std))
    stated = larger.prior_std(tolerances)
    std = stated.copy()
    std[kept] = prior_std
    for group in larger.groups:
        if (own := group[kept[group]]).size:
            rest = group[~kept[group]]
            std[rest] *= std[own[0]] / stated[own[0]]
    equations = normal_equations(measurements, larger, fitted.state, fitted.row_weight)
    information = equations.information / fitted.noise_factor**2
    every = inverse(information + np.diag(std**-2.0), on_the_way=True)
    shift = every[:, ~kept] @ equations.gradient[~kept] / fitted.noise_factor**2
    squares = (np.diag(every) + shift**2)[kept]
    return np.asarray(np.maximum(squares - np.diag(covariance), 0.0))


def _together(
    measurements: Measurements, parameters: Parameters, offered: Parameters
) -> tuple[Parameters, np.ndarray]:
    """Parameters of both, and which of them the first has, in the same order: bool."""
    highest = {
        family: max(of.orders.get(family, 0) for of in (parameters, offered))
        for family in parameters.orders | offered.orders
    }
    every = Parameters.of(measurements.robot, measurements.setup, **highest)
    every = every.only(np.isin(every.names, [*parameters.names, *offered.names]))
    return every, np.isin(every.names, parameters.names)
