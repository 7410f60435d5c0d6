"""Fits with the fine structure of joint motions and the functions of pairs of joints that the
residuals need."""

from dataclasses import replace

import numpy as np

from calibtool.errormodel.families import BY_ID, FAMILIES
from calibtool.errormodel.harmonics import LOW_ORDERS
from calibtool.identification.fine_structure import finer, harmonic_orders, paired
from calibtool.identification.fitting import ROUGHLY, Fit, FitOf, smaller
from calibtool.identification.parameters import Parameters, Part
from calibtool.measurement.measurements import Measurements
from calibtool.robot.se3 import Array

# Harmonics up to which fine structure is sought, in turn: the finer beside the coarser
SOUGHT = (32, 128)


def with_fine_structure(
    measurements: Measurements, every: Fit, probable: np.ndarray, fit_of: FitOf, pairs: bool
) -> Fit:
    """The fit with the harmonics beyond the low orders, and the functions of pairs of joints, that
    its residuals need; the fit itself where they need none.

    The first are searched for with only the sections that are probable without them, so that
    undetermined parameters do not hide them.
    """
    fit = smaller(every, probable, fit_of)
    for highest in SOUGHT:
        has, (wanted, size) = harmonic_orders(fit.parameters), finer(measurements, fit, highest)
        if (wanted <= np.maximum(has, LOW_ORDERS)).all():
            continue
        larger = _with_harmonics(every.parameters, wanted)
        every = fit = fit_of(larger, every.state, every, ROUGHLY, _priors(every, larger, size))
    if pairs and (size := paired(measurements, fit)).any():
        larger = _with_pairs(every.parameters, size > 0)
        every = fit_of(larger, every.state, every, ROUGHLY, _priors(every, larger, size))
    return every


def _priors(fit: Fit, larger: Parameters, size: Array) -> Array:
    """Tolerances of a larger model (p,): those of the fit, and for new parameters the size of their
    joint (n,), rad."""
    known = dict(zip(fit.parameters.names, fit.prior_std, strict=True))
    of_joint = np.zeros(larger.count)
    for part in larger.parts:
        if part.family.id in ("harmonics", "pairs"):
            of_joint[larger.blocks[part.family.id]] = size[part.elements // part.shape[1]]
    return np.array([known.get(name, s) for name, s in zip(larger.names, of_joint, strict=True)])


def _with_pairs(parameters: Parameters, joints: np.ndarray) -> Parameters:
    """The parameters with functions of pairs of joints for some joints (n,) bool."""
    family, robot = BY_ID["pairs"], parameters.robot
    shape = family.shape(robot.n)
    elements = np.flatnonzero(family.free(robot, shape) & joints[:, None])
    return replace(parameters, parts=(*parameters.parts, Part(family, shape, elements)))


def _with_harmonics(parameters: Parameters, wanted: np.ndarray) -> Parameters:
    """The parameters with more harmonics of every joint up to those wanted (n,)."""
    family = BY_ID["harmonics"]
    free = np.zeros(family.shape(parameters.robot.n, int(wanted.max())), dtype=bool)
    others = []
    for part in parameters.parts:
        if part.family is family:
            free[:, : part.shape[1]] = part.free
        else:
            others.append(part)
    for j, order in enumerate(wanted):
        free[j, 2 * LOW_ORDERS : 2 * order] = True
    parts = [*others, Part(family, free.shape, np.flatnonzero(free))]
    parts.sort(key=lambda part: FAMILIES.index(part.family))
    return replace(parameters, parts=tuple(parts))
