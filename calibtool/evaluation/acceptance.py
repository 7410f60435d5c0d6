"""Acceptance limits on an evaluation, such as `position_max_mm=0.2`."""

import re
from dataclasses import dataclass

from calibtool.errors import UsageError
from calibtool.evaluation.metrics import STATISTICS, MethodErrors, statistics


@dataclass(frozen=True)
class Limit:
    """An upper limit of one statistic: position in mm, orientation in mrad."""

    quantity: str
    statistic: str
    value: float

    @property
    def unit(self) -> str:
        """Of the value: mm or mrad."""
        return "mm" if self.quantity == "position" else "mrad"


def parse_limit(text: str) -> Limit:
    """A limit from `position_max_mm=0.2` or `orientation_p95_mrad=0.5`. UsageError otherwise."""
    match = re.fullmatch(r"(position|orientation)_(\w+)_(mm|mrad)=([0-9.eE+-]+)", text.strip())
    try:
        value = float(match[4]) if match else -1.0
    except ValueError:
        value = -1.0
    if match is None or match[2] not in STATISTICS or (match[1] == "position") != (match[3] == "mm") or value < 0:
        raise UsageError(
            f"--require {text}: expected position_S_mm=VALUE or orientation_S_mrad=VALUE, S one of {', '.join(STATISTICS)}"
        )
    return Limit(match[1], match[2], value)


def broken_limits(methods: list[MethodErrors], limits: list[Limit]) -> list[str]:
    """A line for every limit that a method does not meet."""
    broken = []
    for method in methods:
        for limit in limits:
            sizes = method.position_size if limit.quantity == "position" else method.orientation_size
            place = f"{method.name}: {limit.quantity} {limit.statistic}"
            if sizes is None:
                broken.append(f"{place}: orientation is not measured here, so the limit cannot be judged")
                continue
            found = statistics(sizes, 1e-3)[limit.statistic]
            if not found <= limit.value:  # NaN is no success
                broken.append(f"{place} {found:.4g} {limit.unit} is above the limit of {limit.value:g} {limit.unit}")
    return broken
