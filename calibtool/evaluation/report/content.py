"""Contents of the page: sections of lines, tables and drawings, all as text."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class PageTable:
    """Rows of cells under headers, headers of rows first. folded: shown on request."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    folded: bool = False


@dataclass(frozen=True)
class Drawing:
    """A figure of `plots`, its caption, and a description for readers who cannot see it."""

    kind: str
    caption: str
    alt: str


@dataclass(frozen=True)
class PageSection:
    """A heading with lines, drawings and tables; a line where there is nothing to show.

    printed: on paper, too.
    """

    id: str
    title: str
    lines: Sequence[str] = ()
    drawings: Sequence[Drawing] = ()
    tables: Sequence[PageTable] = ()
    printed: bool = True


@dataclass(frozen=True)
class Change:
    """One error before and after, in `unit`, its reduction and the measuring noise, as text."""

    what: str
    before_value: float
    after_value: float
    unit: str
    reduction: str
    noise: str = "–"

    @property
    def before(self) -> str:
        """The value before, with its unit."""
        return number(self.before_value, self.unit)

    @property
    def after(self) -> str:
        """The value after, with its unit."""
        return number(self.after_value, self.unit)


@dataclass(frozen=True)
class Judgement:
    """A limit in words, what was found, and whether that meets it."""

    asked: str
    found: str
    met: bool


@dataclass(frozen=True)
class Verdict:
    """One calibration against the nominal robot, and against every limit."""

    name: str
    changes: Sequence[Change]
    judgements: Sequence[Judgement]
    proven: bool = True

    @property
    def met(self) -> bool:
        """Every limit is met."""
        return all(judgement.met for judgement in self.judgements)

    @property
    def badge(self) -> tuple[str, str]:
        """The verdict in a word, and `good`, `bad` or `doubt`. On training rows it is in doubt."""
        if not self.met:
            return "not met", "bad"
        return ("met", "good") if self.proven else ("met on training rows only", "doubt")


def number(value: float | None, unit: str = "") -> str:
    """A measured value with three decimals, more where it is small; – where there is none."""
    if value is None:
        return "–"
    text = f"{value:.3f}" if abs(value) >= 0.01 or value == 0 else f"{value:.2g}"
    return f"{text} {unit}".strip()
