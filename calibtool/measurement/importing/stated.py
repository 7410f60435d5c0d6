"""Statements of the user about a table that its header does not contain."""

from dataclasses import dataclass

from calibtool.measurement.importing.column_map import AngleUnit, LengthUnit


@dataclass(frozen=True)
class Stated:
    """Units and conventions that the user states where a header does not; None where not stated.

    unit         of lengths: mm, m or in
    angle_unit   deg or rad
    convention   of three angles: `intrinsic-…`, `extrinsic-…`, `zyx`, `rotation-vector`
                 (docs/file-formats.md)
    """

    unit: LengthUnit | None = None
    angle_unit: AngleUnit | None = None
    convention: str | None = None
