"""Which errors the model of a robot contains: by evidence, then by held-out rows, section by
section (`Family.sections`)."""

from collections.abc import Mapping

import numpy as np

from calibtool.errormodel.families import FAMILIES
from calibtool.errormodel.family import Rows
from calibtool.identification.evidence import most_probable
from calibtool.identification.fine_structure_fit import with_fine_structure
from calibtool.identification.fitting import ROUGHLY, Fit, FitOf, smaller
from calibtool.identification.parameters import Parameters, State
from calibtool.identification.useful_sections import (
    BEYOND_DOUBT,
    evidence_of,
    fine_structure_of,
    sections_of,
    useful,
)
from calibtool.measurement.measurements import Measurements

# Nats by which a section must make the data more probable, where its family is not there anyway
_PARSIMONY = 4.0


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
        sections = sections_of(of.parameters, orders)
        if few and (fine := fine_structure_of(of.parameters)):
            # Held-out rows decide on all of it: the part of one joint is never clear with few rows.
            sections = [(f, s) for f, s in sections if s[0] not in fine[0]]
        kept, certain = np.ones(of.parameters.count, dtype=bool), set[str]()
        for _ in range(2):
            least = [0.0 if family.id in certain else _PARSIMONY for family, _ in sections]
            indices = [s for _, s in sections]
            kept = most_probable(of.theta, of.covariance, of.prior_std, indices, least)
            evidence = evidence_of(of, kept, sections)
            certain = {family.id for family, _, nats in evidence if nats > BEYOND_DOUBT}
        return kept

    fit = fit_of(low, start, None, ROUGHLY)
    if "harmonics" not in orders:
        pairs = "pairs" not in orders
        fit = with_fine_structure(measurements, fit, probable(fit), fit_of, pairs)
    kept = useful(measurements, fit, probable(fit), orders)
    # No gear has a clearance below zero.
    expected = fit.theta + fit.conditional(np.flatnonzero(~kept))[0]
    fit = smaller(fit, kept & ~(fit.parameters.positive & (expected < 0)), fit_of)
    while (below := fit.parameters.positive & (fit.theta < 0)).any():
        fit = smaller(fit, ~below, fit_of)
    return fit
