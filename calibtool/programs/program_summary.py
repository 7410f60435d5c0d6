"""Summary of a corrected program: counts, largest change, uncorrected positions."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from calibtool.programs.numbers import Remark
from calibtool.tables import format_table
from calibtool.units import count_of

_LISTED = 20  # number of lines named for one reason
_COLUMNS = ("file", "line", "name", "kind", "fate", "why")


@dataclass(frozen=True, slots=True)
class Fate:
    """The result for a position that is written in a program.

    source      number of its text
    line, name  its line and its name
    kind        `joint` or `pose`
    fate        `corrected`, `unchanged` or `left` (not corrected)
    why         why it is not corrected, or what should be checked
    """

    source: int
    line: int
    name: str
    kind: str
    fate: str
    why: str = ""


@dataclass(frozen=True)
class CompensatedProgram:
    """The result for a program.

    names         of its texts, as they appear in messages
    texts         its corrected texts; only numbers of changed targets differ
    targets       how many could be read
    changed       how many have new numbers
    largest_mm, largest_deg   the largest change: of the nominal tool's position, and of a joint
    left_alone    what was not corrected, and why
    remarks       corrected targets that should be checked
    notes         other notes
    fates         of every position that is written in it
    inconsistent  how many poses of motions are not corrected while others are
    """

    names: tuple[str, ...]
    texts: tuple[bytes, ...]
    targets: int
    changed: int
    largest_mm: float
    largest_deg: float
    left_alone: tuple[Remark, ...]
    remarks: tuple[Remark, ...]
    notes: tuple[str, ...]
    fates: tuple[Fate, ...] = ()
    inconsistent: int = 0

    @property
    def data(self) -> bytes:
        """The corrected text of a program of one text."""
        return self.texts[0]

    def summary(self, name: str) -> list[str]:
        """Lines for people: counts, the largest change, and every reason with its lines."""
        most = (
            f", at most {self.largest_mm:.3f} mm and {self.largest_deg:.4f} deg"
            if self.changed
            else ""
        )
        alone = ""
        if self.left_alone:
            count = count_of(len(self.left_alone), "position or motion", "positions or motions")
            alone = f"; {count} not corrected"
        lines = [f"{name}: {self.changed} of {self.targets} targets changed{most}{alone}"]
        kinds = (("not corrected", self.left_alone), ("changed, check it", self.remarks))
        for what, remarks in kinds:
            ordered = sorted(remarks, key=lambda remark: (remark.source, remark.why, remark.line))
            for (source, why), group in groupby(
                ordered, key=lambda remark: (remark.source, remark.why)
            ):
                place = name if len(self.names) == 1 else self.names[source]
                lines.append(f"{place}: {what}: {why}: {_places(list(group))}")
        return lines + [f"{name}: note: {note}" for note in self.notes]

    def report(self) -> str:
        """A CSV with all positions and uncorrected motions: file, line, name, kind, fate, why."""
        rows = [(f.source, f.line, f.name, f.kind, f.fate, f.why) for f in self.fates]
        seen = {row[:3] for row in rows}
        rows += [
            (r.source, r.line, r.name, "", "left", r.why)
            for r in self.left_alone
            if (r.source, r.line, r.name) not in seen
        ]
        cells = ([str(cell) for cell in (self.names[row[0]], *row[1:])] for row in sorted(rows))
        return format_table(_COLUMNS, cells)


def _places(remarks: Sequence[Remark]) -> str:
    """`line 3 (P[1])`, or `lines 3, 5, 9 and 14 more`."""
    if len(remarks) == 1:
        return f"line {remarks[0].line}" + (f" ({remarks[0].name})" if remarks[0].name else "")
    numbers = [str(line) for line in sorted({remark.line for remark in remarks})]
    more = f" and {len(numbers) - _LISTED} more" if len(numbers) > _LISTED else ""
    return f"line{'s' if len(numbers) > 1 else ''} {', '.join(numbers[:_LISTED])}{more}"
