"""Sections of a model: the evidence for each, and whether held-out rows are predicted better with
it."""

from collections.abc import Collection

import numpy as np

from calibtool.errormodel.family import Family
from calibtool.errormodel.harmonics import LOW_ORDERS
from calibtool.identification.evidence import log_density_ratio
from calibtool.identification.fine_structure import WORTHWHILE
from calibtool.identification.fine_structure_fit import SOUGHT
from calibtool.identification.fitting import Fit
from calibtool.identification.held_out import HeldOut, better, typical
from calibtool.identification.parameters import Parameters
from calibtool.measurement.measurements import Measurements

_CLEARLY, _AT_ALL = 1.0, 0.5  # standard errors by which held-out rows are predicted better
# Nats: with more, a family is there, and held-out rows are not compared
BEYOND_DOUBT = 30.0


def sections_of(parameters: Parameters, fixed: Collection[str]) -> list[tuple[Family, np.ndarray]]:
    """Families and indices (k,) of the sections of parameters, without those of fixed families."""
    return [(family, index) for family, index in parameters.sections if family.id not in fixed]


def evidence_of(
    fit: Fit, kept: np.ndarray, sections: list[tuple[Family, np.ndarray]]
) -> list[tuple[Family, np.ndarray, float]]:
    """Of the sections that are kept, kept (p,) bool: the nats by which each makes the data more
    probable, when the others that are kept follow."""
    step, covariance = fit.conditional(np.flatnonzero(~kept))
    theta = fit.theta + step
    return [
        (f, s, -log_density_ratio(theta[s], covariance[np.ix_(s, s)], fit.prior_std[s]))
        for f, s in sections
        if kept[s[0]]
    ]


def useful(
    measurements: Measurements, fit: Fit, kept: np.ndarray, fixed: Collection[str]
) -> np.ndarray:
    """Of the parameters that are kept (p,) bool, those that help to predict held-out rows.

    Fine structure that hardly improves the prediction is removed, and so are doubtful sections
    without which held-out rows are not predicted worse.
    """
    dropped = np.flatnonzero(~kept)
    fine = [] if "harmonics" in fixed else fine_structure_of(fit.parameters)
    pairs = slice(0, 0) if "pairs" in fixed else fit.parameters.blocks["pairs"]
    of_pairs = np.flatnonzero(kept[pairs]) + pairs.start
    sections, is_fine = sections_of(fit.parameters, fixed), fit.parameters.fine_structure
    coarse = [(f, s) for f, s in sections if not is_fine[s[0]]]
    doubtful = [(nats, s) for _, s, nats in evidence_of(fit, kept, coarse) if nats < BEYOND_DOUBT]
    if not (doubtful or fine or len(of_pairs)):
        return kept
    held_out = HeldOut.of(measurements, fit)
    now = held_out.squares(dropped)
    if len(of_pairs):
        trial = np.union1d(dropped, of_pairs)
        without = held_out.squares(trial)
        if not better(now, without, _CLEARLY):
            dropped, now = trial, without
    for section in fine:
        trial = np.union1d(dropped, section)
        without = held_out.squares(trial)
        worthwhile = typical(now, without) < WORTHWHILE * typical(without, without)
        if not (worthwhile and better(now, without, _CLEARLY)):
            dropped, now = trial, without
            break
    for _, section in sorted(doubtful, key=lambda pair: pair[0]):
        trial = np.union1d(dropped, section)
        without = held_out.squares(trial)
        if len(trial) > len(dropped) and not better(now, without, _AT_ALL):
            dropped, now = trial, without
    result = np.ones(fit.parameters.count, dtype=bool)
    result[dropped] = False
    return result


def fine_structure_of(parameters: Parameters) -> list[np.ndarray]:
    """Parameters (k,) beyond each of the orders in which fine structure is sought, all of it
    first."""
    for part in parameters.parts:
        if part.family.id == "harmonics":
            order = part.elements % part.shape[1] // 2 + 1
            start = parameters.blocks["harmonics"].start
            beyond = [start + np.flatnonzero(order > h) for h in (LOW_ORDERS, *SOUGHT[:-1])]
            return [index for index in beyond if len(index)]
    return []
