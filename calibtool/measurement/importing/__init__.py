"""Import of files of instruments: tables, SpatialAnalyzer's points, Excel sheets, joint files."""

from calibtool.measurement.importing.assemble import import_table, read_table, template_of
from calibtool.measurement.importing.column_map import ColumnMap, parse_column_map
from calibtool.measurement.importing.commanded_targets import CommandedFile
from calibtool.measurement.importing.imported import Imported, JointFile, Understood
from calibtool.measurement.importing.preview import preview
from calibtool.measurement.importing.references import undo_instrument_motion
from calibtool.measurement.importing.row_selection import choose_rows
from calibtool.measurement.importing.second_arm_columns import SecondArm
from calibtool.measurement.importing.stated_units import Stated

__all__ = [
    "ColumnMap",
    "CommandedFile",
    "Imported",
    "JointFile",
    "SecondArm",
    "Stated",
    "Understood",
    "choose_rows",
    "import_table",
    "parse_column_map",
    "preview",
    "read_table",
    "template_of",
    "undo_instrument_motion",
]
