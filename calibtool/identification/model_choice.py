"""Which errors the model of a robot contains: by evidence, then by held-out rows, section by
section (`Family.sections`)."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np

from calibtool.errormodel.families import BY_ID, FAMILIES
from calibtool.errormodel.family import Family, Rows
from calibtool.errormodel.harmonics import LOW_ORDERS
from calibtool.identification.evidence import log_density_ratio, most_probable
from calibtool.identification.fine_structure import WORTHWHILE, finer, harmonic_orders, paired
from calibtool.identification.fitting import CONVERGED, ROUGHLY, Fit
from calibtool.identification.held_out import TYPICAL, HeldOut, typical
from calibtool.identification.parameters import Parameters, Part, State
from calibtool.measurement.measurements import Measurements
from calibtool.robot.se3 import Array

# nats by which a section must make the data more probable, where its family is not there anyway
_PARSIMONY = 4.0
_CLEARLY, _AT_ALL = 1.0, 0.5  # standard errors by which held-out rows are predicted better
_BEYOND_DOUBT = 30.0  # nats: with more, a family is there, and held-out rows are not compared
# harmonics up to which fine structure is sought, in turn: the finer beside the coarser
_FINE = (32, 128)


class FitOf(Protocol):
    """A fit of some parameters to the measurements, from a state and, where there is one, another
    fit."""

    def __call__(
        self,
        parameters: Parameters,
        state: State,
        start: Fit | None,
        converged: float,
        prior_std: Array | None = None,
    ) -> Fit: ...


def offered(measurements: Measurements, orders: Mapping[str, int]) -> Parameters:
    """All parameters from which sections are chosen, without fine structure; orders: of families
    that are fixed, by id."""
    rows = Rows(measurements.robot, measurements.q, measurements.conditions)
    every = {family.id: family.orders[-1] if family.known(rows) else 0 for family in FAMILIES}
    every |= {family.id: 1 for family in FAMILIES if family.always} | dict(orders)
    return Parameters.of(measurements.robot, measurements.setup, **every)


def chosen_fit(measurements: Measurements, orders: Mapping[str, int], fit_of: FitOf) -> Fit:
    """The fit of the errors that the data support. orders: those of families that are fixed, by id.

    First harmonics beyond the low orders, then functions of pairs of joints, are added to the
    joints whose residuals need them. Then sections that are more probably absent are removed; one
    of a family that is certainly there need not be clear itself. At last held-out rows decide,
    because the evidence assumes white noise: sections without which held-out rows are predicted as
    well are removed, and fine structure that does not predict them clearly better.
    """
    start = State.nominal(measurements.robot, measurements.setup)
    low = offered(measurements, orders)
    few = low.count > measurements.equations

    def probable(of: Fit) -> np.ndarray:
        sections = _sections(of.parameters, orders)
        if few and (fine := _fine_structure(of.parameters)):
            # Held-out rows decide on all of it: the part of one joint is never clear with few rows.
            sections = [(f, s) for f, s in sections if s[0] not in fine[0]]
        kept, certain = np.ones(of.parameters.count, dtype=bool), set[str]()
        for _ in range(2):
            least = [0.0 if family.id in certain else _PARSIMONY for family, _ in sections]
            indices = [s for _, s in sections]
            kept = most_probable(of.theta, of.covariance, of.prior_std, indices, least)
            certain = {f.id for f, s, nats in _evidence(of, kept, sections) if nats > _BEYOND_DOUBT}
        return kept

    fit = fit_of(low, start, None, ROUGHLY)
    if "harmonics" not in orders:
        pairs = "pairs" not in orders
        fit = _with_fine_structure(measurements, fit, probable(fit), fit_of, pairs)
    kept = _useful(measurements, fit, probable(fit), orders)
    # No gear has a clearance below zero.
    expected = fit.theta + fit.conditional(np.flatnonzero(~kept))[0]
    fit = _smaller(fit, kept & ~(fit.parameters.positive & (expected < 0)), fit_of)
    while (below := fit.parameters.positive & (fit.theta < 0)).any():
        fit = _smaller(fit, ~below, fit_of)
    return fit


def _with_fine_structure(
    measurements: Measurements, every: Fit, probable: np.ndarray, fit_of: FitOf, pairs: bool
) -> Fit:
    """The fit with the harmonics beyond the low orders, and the functions of pairs of joints, that
    its residuals need; the fit itself where they need none.

    The first are searched for with only the sections that are probable without them, so that
    undetermined parameters do not hide them.
    """
    fit = _smaller(every, probable, fit_of)
    for highest in _FINE:
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


def _sections(parameters: Parameters, fixed: Collection[str]) -> list[tuple[Family, np.ndarray]]:
    return [(family, index) for family, index in parameters.sections if family.id not in fixed]


def _evidence(
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


def _smaller(fit: Fit, kept: np.ndarray, fit_of: FitOf) -> Fit:
    """The converged fit of the parameters that are kept (p,)."""
    smaller = fit.parameters.only(kept)
    return fit_of(smaller, fit.reduced(smaller), fit, CONVERGED)


def _useful(
    measurements: Measurements, fit: Fit, kept: np.ndarray, fixed: Collection[str]
) -> np.ndarray:
    """Of the parameters that are kept (p,) bool, those that help to predict held-out rows.

    Fine structure that hardly improves the prediction is removed, and so are doubtful sections
    without which held-out rows are not predicted worse.
    """
    dropped = np.flatnonzero(~kept)
    fine = [] if "harmonics" in fixed else _fine_structure(fit.parameters)
    pairs = slice(0, 0) if "pairs" in fixed else fit.parameters.blocks["pairs"]
    of_pairs = np.flatnonzero(kept[pairs]) + pairs.start
    sections, is_fine = _sections(fit.parameters, fixed), fit.parameters.fine_structure
    coarse = [(f, s) for f, s in sections if not is_fine[s[0]]]
    doubtful = [(nats, s) for _, s, nats in _evidence(fit, kept, coarse) if nats < _BEYOND_DOUBT]
    if not (doubtful or fine or len(of_pairs)):
        return kept
    held_out = HeldOut.of(measurements, fit)
    now = held_out.squares(dropped)
    if len(of_pairs):
        trial = np.union1d(dropped, of_pairs)
        without = held_out.squares(trial)
        if not _better(now, without, _CLEARLY):
            dropped, now = trial, without
    for section in fine:
        trial = np.union1d(dropped, section)
        without = held_out.squares(trial)
        worthwhile = typical(now, without) < WORTHWHILE * typical(without, without)
        if not (worthwhile and _better(now, without, _CLEARLY)):
            dropped, now = trial, without
            break
    for _, section in sorted(doubtful, key=lambda pair: pair[0]):
        trial = np.union1d(dropped, section)
        without = held_out.squares(trial)
        if len(trial) > len(dropped) and not _better(now, without, _AT_ALL):
            dropped, now = trial, without
    result = np.ones(fit.parameters.count, dtype=bool)
    result[dropped] = False
    return result


def _fine_structure(parameters: Parameters) -> list[np.ndarray]:
    """Parameters (k,) beyond each of the orders in which fine structure is sought, all of it
    first."""
    for part in parameters.parts:
        if part.family.id == "harmonics":
            order = part.elements % part.shape[1] // 2 + 1
            start = parameters.blocks["harmonics"].start
            beyond = [start + np.flatnonzero(order > h) for h in (LOW_ORDERS, *_FINE[:-1])]
            return [index for index in beyond if len(index)]
    return []


def _better(squares: Array, than: Array, errors: float) -> bool:
    """Whether squared residuals (M,) of held-out rows are smaller than others by more than some
    standard errors."""
    most = TYPICAL * than.mean()
    gain = np.minimum(than, most) - np.minimum(squares, most)
    return bool(gain.mean() > errors * gain.std() / np.sqrt(len(gain)))


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
