"""A finding: a statement about the measurements with the numbers behind it."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from typing import Literal

Severity = Literal["note", "warning"]
Numbers = dict[str, float | int | list[float]]


@dataclass(frozen=True)
class Finding:
    """One named finding; `warning` asks for a decision, `note` only informs.

    Units are in the keys of `numbers`.
    """

    name: str
    severity: Severity
    message: str
    numbers: Numbers = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.severity}: {self.message}"

    def as_json(self) -> dict[str, object]:
        """The finding as a plain object."""
        return asdict(self)


_ROWS_OFF = ("rows_out_of_place", "target_out_of_place", "target_order")
_GROSS_MM = 5.0  # a shift that is larger than the errors of an arm


def rows_off(findings: Iterable[Finding]) -> list[int]:
    """Indices, from 0, of the rows that warnings say do not belong to the others, by more than the
    errors of an arm.
    """
    rows: set[int] = set()
    for finding in findings:
        named, shift = finding.numbers.get("rows"), finding.numbers.get("shift_mm", _GROSS_MM)
        if finding.name in _ROWS_OFF and isinstance(named, list) and isinstance(shift, float):
            rows.update(int(row) - 1 for row in named if shift >= _GROSS_MM)
    return sorted(rows)


def listed(rows: Iterable[int], most: int = 6) -> str:
    """Numbers for people, counted from 1: `3, 4, 9 …`."""
    numbers = [str(int(row) + 1) for row in rows]
    return ", ".join(numbers[:most]) + (" …" if len(numbers) > most else "")


def severity(warns: bool) -> Severity:
    """`warning` or `note`."""
    return "warning" if warns else "note"
