"""Description of how a table was understood, as `import --dry-run` prints it."""

from textwrap import wrap

import numpy as np

from calibtool.errors import NoSolutionError
from calibtool.measurement.importing.column_map import ColumnMap
from calibtool.measurement.importing.imported import Imported
from calibtool.measurement.observation import measured_in_base
from calibtool.robot.robot import Robot
from calibtool.units import TO_SI, count_of

_FIRST_ROWS = 3


def preview(imported: Imported) -> str:
    """Robot, columns, units, frame, noise, numbers of rows, unused columns, and the first rows as
    understood.

    The last lines state the fit of the nominal robot after registration of the unknown parts of the
    set-up, which shows a wrong unit, order of joints or Euler convention.
    """
    measurements, understood = imported.measurements, imported.understood
    robot, columns, table = measurements.robot, understood.columns, understood.source.table
    facts = [
        ("robot", f"{robot.name}, {robot.n} joints"),
        ("file", f"{table.name}: {_spelling(imported)}"),
        ("configurations", f"{len(measurements)}, {_each(imported)} each"),
        ("joints", _joints(columns, robot)),
    ]
    if understood.joints_name != table.name:
        facts.append(("joints from", understood.joints_name))
    if measurements.commanded is not None:
        facts.append(("commanded", "apart: the joints are those that the arm was driven to"))
    if columns.joints_read is not None:
        facts.append(("joints read", ", ".join(columns.joints_read.columns)))
    for i, target in enumerate(columns.targets):
        where = "place on the tool estimated"
        if measurements.setup.targets_known:
            known = " ".join(f"{v:g}" for v in measurements.setup.targets[i] * 1e3)
            where = f"on the tool at {known} mm"
        sign = "+" if target.error_is == "measured-minus-nominal" else "-"
        names = target.measured or [
            f"{a} {sign} {b}" for a, b in zip(target.nominal or [], target.error or [], strict=True)
        ]
        facts.append((f"target {i + 1}", f"{', '.join(names)} [{target.unit}], {where}"))
    if columns.lengths is not None:
        lengths = columns.lengths
        of = {
            "distance": "distances",
            "plane": "heights above a plane",
            "sphere": "distances from a sphere",
            "centre": "distances from the centre of a sphere",
        }[lengths.of]
        facts.append((of, f"{', '.join(lengths.columns) or 'contacts, 0'} [{lengths.unit}]"))
    if columns.place is not None:
        labels = ", ".join(measurements.setup.places) or "one alone, not used"
        facts.append(("set-ups", f"{columns.place.column}: {labels}"))
    if columns.pose is not None:
        pose = columns.pose
        facts.append(("position", f"{', '.join(pose.position)} [{pose.unit}]"))
        unit = f" [{pose.orientation_unit}]" if pose.orientation_unit else ""
        facts.append(("orientation", f"{', '.join(pose.orientation)}{unit}, {pose.convention}"))
    frame = (
        "the robot's base"
        if measurements.setup.frame_known
        else "the instrument's own, to be estimated"
    )
    noise = f"{measurements.noise_position * 1e3:g} mm"
    if measurements.rotations is not None:
        noise += f", {measurements.noise_orientation * 1e3:g} mrad"
    stated = (
        "stated" if understood.noise_stated else "assumed, state it in [noise] of a --columns file"
    )
    facts += [("frame", frame), ("noise", f"{noise} per coordinate ({stated})")]
    facts += [("beside", text) for text in _beside(imported)]
    facts += [
        ("not used", f"{', '.join(names)} ({name})")
        for name, names in understood.ignored.items()
        if names
    ]
    lines = [line for key, value in facts for line in _fact(key, value)]
    return "\n".join([*lines, "", *_first_rows(imported), "", _fit(imported)]) + "\n"


def _fact(key: str, value: str) -> list[str]:
    """A name and its value, wrapped to lines of 80 columns."""
    return wrap(
        f"{key:<15} {value}",
        80,
        subsequent_indent=" " * 16,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _spelling(imported: Imported) -> str:
    source = imported.understood.source
    if source.points is not None:
        return (
            f"SpatialAnalyzer points, layout {source.points.layout}, targets "
            f"{', '.join(source.points.targets)}"
        )
    if source.format == "excel":
        return "Excel sheet"
    named = {",": "comma", ";": "semicolon", "\t": "tab", " ": "blanks"}.get(
        source.table.delimiter, source.table.delimiter
    )
    return (
        f"table separated by {named}, decimal {'comma' if source.table.decimal == ',' else 'point'}"
    )


def _each(imported: Imported) -> str:
    """What was measured in each row."""
    measurements = imported.measurements
    if measurements.values is not None:
        return count_of(measurements.values.shape[1], "length")
    if measurements.rotations is not None:
        return "1 6-D pose"
    return count_of(measurements.points.shape[1], "target")


def _joints(columns: ColumnMap, robot: Robot) -> str:
    assert columns.joints is not None
    pairs = zip(columns.joints.columns, columns.joints.units(), strict=True)
    text = ", ".join(f"j{i + 1} = {column} [{unit}]" for i, (column, unit) in enumerate(pairs))
    if not robot.coupled:
        return text
    return f"{text}; {columns.joints.values}"


def _beside(imported: Imported) -> list[str]:
    auxiliary, columns = imported.auxiliary, imported.understood.columns
    result = []
    if columns.time is not None:
        result.append(f"time stamps {columns.time.column} [{columns.time.unit}]")
    if columns.payload is not None:
        result.append(f"payload {columns.payload.column} [{columns.payload.unit}]")
    if columns.temperature is not None:
        result.append(f"temperature {columns.temperature.column} [{columns.temperature.unit}]")
    if auxiliary.reference_points is not None:
        result.append(f"{auxiliary.reference_points.shape[1]} reference points on the base")
    return result


def _first_rows(imported: Imported) -> list[str]:
    """Small tables of the first rows: line and joints in deg or mm, then the points in mm."""
    measurements = imported.measurements
    robot = measurements.robot
    scale = np.array([1 / TO_SI["mm" if prismatic else "deg"] for prismatic in robot.prismatic])
    lines = [str(line) for line in imported.understood.lines[:_FIRST_ROWS]]
    count = len(lines)
    many = measurements.points.shape[1] > 1
    joints = [
        [line, *(_number(v) for v in row)]
        for line, row in zip(lines, measurements.q[:count] * scale, strict=True)
    ]
    points = [
        [line, *([f"{i + 1}"] if many else []), *(_number(v * 1e3) for v in point)]
        for line, row in zip(lines, measurements.points[:count], strict=True)
        for i, point in enumerate(row)
    ]
    target = ["target"] if many else []
    return [
        *_aligned([["line", *robot.joint_columns], *joints]),
        "",
        *_aligned([["line", *target, "x_mm", "y_mm", "z_mm"], *points]),
    ]


def _aligned(rows: list[list[str]]) -> list[str]:
    """Rows of cells, flush right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(cell.rjust(width) for cell, width in zip(cells, widths, strict=True))
        for cells in rows
    ]


def _number(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.3f}"


def _fit(imported: Imported) -> str:
    """Distance of the nominal robot from the measured points after registration."""
    try:
        measurements = imported.registered().measurements
    except NoSolutionError as error:
        return f"nominal robot: {error}"
    poses = measurements.robot.mechanism.forward(measurements.q)
    setup = measurements.setup
    readings = measured_in_base(measurements, setup)
    moved = setup.kind.displacements(readings, setup, poses)
    values = measurements.values
    seen = measurements.seen if values is None else np.isfinite(values)
    distances = np.linalg.norm(moved, axis=-1)[seen] * 1e3
    who = "nominal robot" if measurements.setup.known else "nominal robot after registration"
    size = f"{np.sqrt((distances**2).mean()):.3f} mm rms, {distances.max():.3f} mm max"
    return f"{who}: {size} from the points"
