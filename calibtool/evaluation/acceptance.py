"""Acceptance limits: what `--require` asks for, and whether a method meets it."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

from calibtool.errors import UsageError
from calibtool.evaluation.metrics import STATISTICS, MethodErrors, Statistics
from calibtool.evaluation.pose_test import PoseTest
from calibtool.robot.se3 import Array

_QUANTITIES = ("position", "orientation", "ap", "rp")
_UNITS = {"position": ("mm",), "orientation": ("mrad",), "ap": ("mm", "mrad"), "rp": ("mm", "mrad")}


@dataclass(frozen=True)
class Limit:
    """An upper limit of one statistic, in mm or mrad.

    quantity   `position` or `orientation` of the errors of all configurations, `ap` or `rp` of the
               repeated ones (ISO 9283; the statistic is over the poses)
    """

    quantity: str
    statistic: str
    value: float
    unit: str

    def found(self, method: MethodErrors, test: PoseTest | None) -> float | None:
        """The method's value of the statistic, in the unit of the limit; None where it was not
        measured.

        test: AP of this method alone, and RP.
        """
        values = self._values(method, test)
        return None if values is None else getattr(Statistics.of(values / 1e-3), self.statistic)

    def _values(self, method: MethodErrors, test: PoseTest | None) -> Array | None:
        if self.quantity == "position":
            return method.position_size
        if self.quantity == "orientation":
            return method.orientation_size
        if test is None:
            return None
        turned = self.unit == "mrad"
        if self.quantity == "rp":
            return test.repeatability_turn if turned else test.repeatability
        accuracy = test.accuracy_turn if turned else test.accuracy
        return None if accuracy is None else accuracy[0]


def parse_limit(text: str) -> Limit:
    """A limit from `position_max_mm=0.2`, `orientation_p95_mrad=0.5` or `ap_max_mm=0.1`.

    Raises UsageError otherwise.
    """
    pattern = rf"({'|'.join(_QUANTITIES)})_(\w+)_(mm|mrad)=([0-9.eE+-]+)"
    match = re.fullmatch(pattern, text.strip())
    try:
        value = float(match[4]) if match else -1.0
    except ValueError:
        value = -1.0
    if match is None or match[2] not in STATISTICS or match[3] not in _UNITS[match[1]] or value < 0:
        raise UsageError(
            f"--require {text}: expected position_S_mm=VALUE or orientation_S_mrad=VALUE, or of "
            "repeated poses ap_S_mm, ap_S_mrad, rp_S_mm or rp_S_mrad, S one of "
            f"{', '.join(STATISTICS)}"
        )
    return Limit(match[1], match[2], value, match[3])


def broken_limits(
    methods: list[MethodErrors], limits: list[Limit], tests: Sequence[PoseTest | None] = ()
) -> list[str]:
    """A line for every limit that a method does not meet; tests: AP and RP of each method alone."""
    broken = []
    for method, test in zip_longest(methods, tests):
        for limit in limits:
            place = f"{method.name}: {limit.quantity} {limit.statistic}"
            found = limit.found(method, test)
            if found is None:
                broken.append(f"{place}: {_missing(limit, test)}, so the limit cannot be judged")
            elif not found <= limit.value:  # NaN does not meet a limit
                bound = f"the limit of {limit.value:g} {limit.unit}"
                broken.append(f"{place} {found:.4g} {limit.unit} is above {bound}")
    return broken


def _missing(limit: Limit, test: PoseTest | None) -> str:
    if limit.quantity in ("ap", "rp") and test is None:
        return "no configuration was measured at least three times"
    return "orientation is not measured here"
