"""Import of what instruments write: tables by header or by map, SpatialAnalyzer's points, Excel
sheets, joint files.
"""

from calibtool.measurement.importing.assemble import (
    Imported,
    JointFile,
    Understood,
    import_table,
    read_table,
)
from calibtool.measurement.importing.column_map import ColumnMap, parse_column_map
from calibtool.measurement.importing.commanded_targets import CommandedFile
from calibtool.measurement.importing.header import Stated
from calibtool.measurement.importing.preview import preview
from calibtool.measurement.importing.row_selection import choose_rows, select_rows

__all__ = [
    "ColumnMap",
    "CommandedFile",
    "Imported",
    "JointFile",
    "Stated",
    "Understood",
    "choose_rows",
    "import_table",
    "parse_column_map",
    "preview",
    "read_table",
    "select_rows",
]
