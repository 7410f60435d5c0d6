"""A column map from the header of a file, to be completed by hand (`import --map-template`)."""

import json
from collections.abc import Sequence

from calibtool.errors import InputError
from calibtool.measurement.importing.header import parts_found
from calibtool.measurement.importing.sources import SourceTable
from calibtool.measurement.importing.stated import Stated
from calibtool.robot.robot import Robot
from calibtool.tables import Table

_UNKNOWN = "?"


def map_template(source: SourceTable, joints: Table, robot: Robot, stated: Stated) -> str:
    """TOML with the parts that the header defines, and comments that explain the others.

    source: the measured values; joints: the table of the joint values, which may be the same.
    """
    found = parts_found(source, joints, robot, stated)
    assumed = Stated(stated.unit or "mm", stated.angle_unit or "deg", stated.convention)
    guess = parts_found(source, joints, robot, assumed)
    notes: list[str] = []
    for name in ("joints", "measured"):
        error, part = getattr(found, name), getattr(guess, name)
        if isinstance(error, InputError) and not isinstance(part, InputError):
            found, notes = found._replace(**{name: part}), [*notes, f"# Check the unit: {error}"]
    table = source.table
    lines = [
        f"# Column map of {table.name}, for calibtool import --columns. Its columns:",
        *(f"#   {_text(column)}" for column in table.header if column),
        *notes,
        "",
        "[joints]                # in the robot's order: " + ", ".join(robot.chain.model.names[1:]),
    ]
    if isinstance(found.joints, InputError):
        lines += [
            f"# {found.joints}",
            "columns = " + _list([_UNKNOWN] * robot.n),
            'unit = "deg"            # deg or rad; mm or m of a slide; one for all, or a list',
        ]
    else:
        units = found.joints.units()
        lines.append("columns = " + _list(found.joints.columns))
        lines.append("unit = " + (_text(units[0]) if len(set(units)) == 1 else _list(units)))
    if isinstance(found.measured, InputError):
        lines += [
            "",
            f"# {found.measured}",
            "[[targets]]             # one table for each target",
            "measured = " + _list([_UNKNOWN] * 3),
            'unit = "mm"             # mm, m, in',
        ]
    elif found.measured.pose is not None:
        pose = found.measured.pose
        lines += ["", "[pose]", "position = " + _list(pose.position), f'unit = "{pose.unit}"']
        lines += ["orientation = " + _list(pose.orientation), f'convention = "{pose.convention}"']
        if pose.orientation_unit and not pose.convention.startswith("quaternion"):
            lines.append(f'orientation_unit = "{pose.orientation_unit}"')
    else:
        for target in found.measured.targets:
            lines += ["", "[[targets]]"]
            for key in ("measured", "nominal", "error"):
                if (columns := getattr(target, key)) is not None:
                    lines.append(f"{key} = {_list(columns)}")
            lines.append(f'unit = "{target.unit}"')
            lines.append("# on_tool_mm = [0.0, 0.0, 0.0]   # where it is on the tool, if known")
    for name in ("time", "temperature", "payload"):
        part = getattr(found, name)
        prefix = "" if part else "# "
        column, unit = (part.column, part.unit) if part else (_UNKNOWN, _EXAMPLES[name])
        lines += ["", f"{prefix}[{name}]", f"{prefix}column = {_text(column)}"]
        lines.append(f"{prefix}unit = {_text(unit)}")
    lines += [
        "",
        "[instrument]",
        'frame = "unknown"       # or "base": the values are in the frame of the robot\'s base',
        "",
        "[noise]                 # standard deviations per coordinate",
        "position_mm = 0.05",
        "orientation_mrad = 0.1",
    ]
    return "\n".join(lines) + "\n"


_EXAMPLES = {"time": "iso", "temperature": "C", "payload": "kg"}


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)


def _list(values: Sequence[str]) -> str:
    return "[" + ", ".join(map(_text, values)) + "]"
