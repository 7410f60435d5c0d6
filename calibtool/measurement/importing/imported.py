"""The result of an import: measurements, how the table was understood, and warnings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from calibtool.errors import NoSolutionError, UsageError
from calibtool.measurement.auxiliary import AuxiliaryReadings
from calibtool.measurement.importing.column_map import ColumnMap
from calibtool.measurement.importing.joint_files import JOIN_TOLERANCE, Join
from calibtool.measurement.importing.row_selection import choose_rows
from calibtool.measurement.importing.sources import SourceTable
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.registration import register
from calibtool.measurement.sampling import spread_rows
from calibtool.measurement.setup import Setup
from calibtool.measurement.streams import JointStream
from calibtool.robot.se3 import readonly

# Evenly spaced ones of a longer table; the set-up has at most some twenty unknowns
REGISTRATION_ROWS = 20_000


class JointFile(NamedTuple):
    """The file of the joint values, and how its rows match, see `joint_files.join_rows`."""

    data: bytes | str
    name: str
    join: Join = "index"
    tolerance_s: float = JOIN_TOLERANCE
    encoding: str | None = None


@dataclass(frozen=True)
class Understood:
    """How the files were read, for people (`preview.preview`)."""

    source: SourceTable
    columns: ColumnMap
    joints_name: str
    noise_stated: bool
    ignored: dict[str, list[str]]  # columns that nothing is read from, by file
    lines: np.ndarray  # (N,) in the measured table
    notes: tuple[str, ...] = ()  # what had to be found out

    @property
    def remarks(self) -> list[str]:
        """Remarks for people on how the files were read, one line each."""
        unused = {name: columns for name, columns in self.ignored.items() if columns}
        return [
            *self.notes,
            *(f"{name}: not used: {', '.join(columns)}" for name, columns in unused.items()),
        ]


class Imported(NamedTuple):
    """Measurements, warnings, auxiliary readings, how files were read, the stream of joints."""

    measurements: Measurements
    warnings: list[str]
    auxiliary: AuxiliaryReadings
    understood: Understood
    stream: JointStream | None = None

    def split(
        self, rows: str | None, sample: int | None, seed: int
    ) -> "tuple[Imported, Imported | None]":
        """The chosen rows and the rest (None if there is none), see `choose_rows`."""
        chosen, others = choose_rows(len(self.measurements), rows, sample, seed)
        return self.rows(chosen), self.rows(others) if len(others) else None

    def rows(self, index: np.ndarray) -> "Imported":
        """Some of the rows: their indices (k,)."""
        return self._replace(
            measurements=self.measurements.rows(index),
            auxiliary=self.auxiliary.rows(index),
            understood=replace(self.understood, lines=self.understood.lines[index]),
            stream=None if self.stream is None else self.stream.rows(index),
        )

    def with_clock_offset(self, offset: float) -> "Imported":
        """The same with the joints taken from their stream at the stamps plus an offset, s.

        Raises UsageError where there is no stream.
        """
        if self.stream is None:
            raise UsageError("a clock offset needs joints as a stream: --joints FILE --join time")
        stream = replace(self.stream, offset=offset)
        q = readonly(stream.at(offset)[0])
        conditions = replace(self.measurements.conditions, direction=readonly(stream.directions()))
        return self._replace(
            measurements=replace(self.measurements, q=q, conditions=conditions),
            auxiliary=replace(self.auxiliary, q_commanded=q),
            stream=stream,
        )

    def with_setup(self, setup: Setup) -> "Imported":
        """The same with another set-up."""
        return self._replace(measurements=replace(self.measurements, setup=setup))

    def registered(self, without: Sequence[int] = ()) -> "Imported":
        """The same with the unknown parts of the set-up fitted to these rows (nominal robot).

        without: indices of rows that are kept but not fitted, because they do not belong to the
        others. Raises NoSolutionError for too few rows, with a warning about the table, which may
        be the reason.
        """
        fitting = np.setdiff1d(np.arange(len(self.measurements)), without)
        used = fitting[spread_rows(len(fitting), REGISTRATION_ROWS)]
        try:
            return self.with_setup(register(self.measurements.rows(used)))
        except NoSolutionError as error:
            hint = f" ({self.warnings[0]})" if self.warnings else ""
            raise NoSolutionError(f"{error}{hint}") from None
