"""Labelled places with too few rows to determine their position."""

import re

import numpy as np

from calibtool.measurement.checks.finding import Finding, Numbers
from calibtool.measurement.kinds.instrument import InstrumentKind
from calibtool.measurement.measurements import Measurements
from calibtool.units import count_of

_OWN = "(?:base|board|plane|sphere|camera)"  # names of what each place has one of


def lonely_places(measurements: Measurements) -> list[Finding]:
    """A finding for every place that has no more readings than its set-up has unknowns."""
    setup, place = measurements.setup, measurements.place
    if place is None or not (isinstance(setup.kind, InstrumentKind) or not setup.kind.given):
        return []
    read = (setup.kind.weights(measurements.readings, 1.0, 1.0) > 0).sum(axis=-1)
    found = []
    for g, label in enumerate(measurements.places):
        own = [name for name in setup.free_names if re.match(rf"{_OWN}{g + 1}\.", name)]
        unknowns = 6 if isinstance(setup.kind, InstrumentKind) else len(own)
        rows = np.flatnonzero(place == g)
        equations = int(read[rows].sum())
        if not unknowns or equations > unknowns:
            continue
        message = (
            f"{label}: {count_of(len(rows), 'row')} with {equations} readings, but {unknowns} are "
            "needed to determine where it is: its rows give no information about the arm; measure "
            f"at least {_enough(unknowns, equations, len(rows))} rows there"
        )
        numbers: Numbers = {
            "place": g + 1,
            "equations": equations,
            "unknowns": unknowns,
        }
        found.append(Finding("lonely_place", "warning", message, numbers))
    return found


def _enough(unknowns: int, equations: int, rows: int) -> int:
    """The number of rows that give twice as many readings as there are unknowns."""
    each = max(equations / max(rows, 1), 1.0)
    return int(np.ceil(2 * unknowns / each))
