"""Instrument tables → measurements: columns by the header's names or by a map file, set-up known or registered."""

import re
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from scipy.spatial.transform import Rotation

from calibtool.errors import InputError, NoSolutionError, UsageError
from calibtool.measurement.measurements import Measurements, Setup, check_targets
from calibtool.measurement.registration import register
from calibtool.measurement.simulate import ORIENTATION_NOISE
from calibtool.robot.coupling import JointValues
from calibtool.robot.description import Point, validation_message
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array, readonly
from calibtool.tables import Table, joint_columns_of, joint_positions, parse_table, pose_columns_of
from calibtool.units import TO_SI

POSITION_NOISE = 0.05e-3  # m, stated for an instrument that does not tell its own

LengthUnit = Literal["mm", "m"]
Triple = Annotated[list[str], Field(min_length=3, max_length=3)]
_EULER = r"(?:intrinsic|fixed)-(?:[xyz]{3})"


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class JointColumns(_Strict):
    """One column per joint, in the robot's order; one unit for all, or a list; whose values they are."""

    columns: list[str]
    unit: Literal["deg", "rad", "mm", "m"] | list[Literal["deg", "rad", "mm", "m"]]
    values: JointValues | None = None  # the robot's [coupling] converts those of a controller

    def units(self) -> list[str]:
        return list(self.unit) if isinstance(self.unit, list) else [self.unit] * len(self.columns)


class TargetColumns(_Strict):
    """A target point: measured coordinates, or nominal ones and errors; `on_tool_mm` where its place is known."""

    measured: Triple | None = None
    nominal: Triple | None = None
    error: Triple | None = None
    error_is: Literal["measured-minus-nominal", "nominal-minus-measured"] = "measured-minus-nominal"
    unit: LengthUnit
    on_tool_mm: Point | None = None

    @model_validator(mode="after")
    def _one_form(self) -> "TargetColumns":
        if (self.measured is None) == (self.nominal is None) or (self.nominal is None) != (self.error is None):
            raise ValueError("give either 'measured', or 'nominal' together with 'error'")
        return self


class PoseColumns(_Strict):
    """A 6-D sensor: position, and orientation by a named convention."""

    position: Triple
    unit: LengthUnit
    orientation: Annotated[list[str], Field(min_length=3, max_length=4)]
    convention: Annotated[str, Field(pattern=rf"^({_EULER}|rotation-vector|quaternion-wxyz|quaternion-xyzw)$")]
    orientation_unit: Literal["deg", "rad"] = "rad"


class Instrument(_Strict):
    """Frame of the measured values: the robot's base, or unknown (then it is estimated)."""

    frame: Literal["base", "unknown"] = "unknown"


class Noise(_Strict):
    """Stated standard deviations per coordinate."""

    position_mm: Annotated[float, Field(gt=0)] = POSITION_NOISE * 1e3
    orientation_mrad: Annotated[float, Field(gt=0)] = ORIENTATION_NOISE * 1e3


class ColumnMap(_Strict):
    """The contents of a `--columns` file."""

    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] | None = None
    joints: JointColumns
    targets: list[TargetColumns] = []
    pose: PoseColumns | None = None
    instrument: Instrument = Instrument()
    noise: Noise = Noise()

    @model_validator(mode="after")
    def _one_kind(self) -> "ColumnMap":
        if bool(self.targets) == (self.pose is not None):
            raise ValueError("give either [[targets]] or [pose]")
        known = [target.on_tool_mm is not None for target in self.targets]
        if any(known) and not all(known):
            raise ValueError("on_tool_mm is given for some targets only; give it for all or for none")
        return self


def parse_column_map(text: str, name: str) -> ColumnMap:
    """A column map from TOML text. Raises InputError with the key that is wrong."""
    try:
        return ColumnMap.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{name}: not valid TOML: {error}") from None
    except ValidationError as error:
        raise InputError(f"{name}: {validation_message(error, ColumnMap)}") from None


def import_table(
    text: str,
    name: str,
    robot: Robot,
    columns: ColumnMap | None = None,
    *,
    frame: Literal["base", "unknown"] | None = None,
    robot_targets: bool = False,
    joint_values: JointValues | None = None,
) -> tuple[Measurements, list[str]]:
    """Measurements from the text of a table, and warnings; unknown parts of the set-up are registered (nominal robot).

    columns: None takes the header's names (docs/file-formats.md). frame: overrides the map's. robot_targets: the targets
    are those of the robot's description, in their order. joint_values: overrides the map's, `serial` if neither says.
    Raises InputError for a bad cell, column or target set; NoSolutionError for too few rows to register.
    """
    table = parse_table(text, name, columns.delimiter if columns else None, columns.decimal if columns else None)
    if columns is None:
        columns = map_from_header(table, robot)
    if len(columns.joints.columns) != robot.n:
        raise InputError(f"{name}: {len(columns.joints.columns)} joint columns, but {robot.name} has {robot.n} joints")
    units = columns.joints.units()
    if len(units) != robot.n:
        raise InputError(f"{name}: {len(units)} joint units for {robot.n} joints")
    for unit, prismatic, column in zip(units, robot.prismatic, columns.joints.columns, strict=True):
        if (unit in ("mm", "m")) != prismatic:
            raise InputError(
                f"{name}: column '{column}' is in {unit}, but its joint is {'prismatic' if prismatic else 'revolute'}"
            )
    values = joint_values or columns.joints.values
    q = robot.serial_from(values or "serial", joint_positions(table, robot, columns.joints.columns, units))

    rotations: Array | None = None
    if columns.pose is not None:
        points = (table.numbers(columns.pose.position) * TO_SI[columns.pose.unit])[:, None, :]
        rotations = _rotations(table, columns.pose)
    else:
        points = np.stack([_target_points(table, target) for target in columns.targets], axis=1)
    seen = ~np.isnan(points[..., 0])
    if not seen.any(axis=-1).all():
        raise InputError(f"{table.place(int(np.argmin(seen.any(axis=-1))))}: no target was measured in this row")
    setup = _setup(columns, robot, points, frame or columns.instrument.frame, robot_targets, name)
    measurements = Measurements(
        robot=robot,
        q=readonly(q),
        points=readonly(points),
        rotations=None if rotations is None else readonly(rotations),
        setup=setup,
        noise_position=columns.noise.position_mm * 1e-3,
        noise_orientation=columns.noise.orientation_mrad * 1e-3,
    )
    warnings = []
    if robot.coupled and values is None:
        warnings.append(
            f"{name}: {robot.name} couples joints and nothing says whose values these are: taken as those of the serial "
            "chain; --joint-values controller converts the controller's"
        )
    if not seen.all():
        first = table.place(int(np.argmin(seen.all(axis=-1))))
        warnings.append(
            f"{first}: {int((~seen.all(axis=-1)).sum())} of {len(q)} rows lack a target; the others of the row count"
        )
    outside = ~robot.within_limits(q)
    if outside.any():
        first = table.place(int(np.argmax(outside)))
        warnings.append(
            f"{first}: {int(outside.sum())} of {len(q)} rows are outside the joint limits of {robot.name}; kept"
        )
    try:
        return replace(measurements, setup=register(measurements)), warnings
    except NoSolutionError as error:
        hint = f" ({warnings[-1]})" if warnings else ""
        raise NoSolutionError(f"{error}{hint}") from None


def select_rows(
    measurements: Measurements, rows: str | None, sample: int | None, seed: int
) -> tuple[Measurements, Measurements]:
    """Chosen rows and the rest: `rows` is 'A:B', from 1 and both included; `sample` draws so many of them at random.

    Raises UsageError for a range or a number that does not fit.
    """
    count = len(measurements)
    chosen = np.arange(count)
    if rows is not None:
        match = re.fullmatch(r"(\d+):(\d+)", rows.strip())
        first, last = (int(match[1]), int(match[2])) if match else (0, 0)
        if not 1 <= first <= last <= count:
            raise UsageError(f"--rows {rows}: expected A:B with 1 <= A <= B <= {count}")
        chosen = chosen[first - 1 : last]
    if sample is not None:
        if sample > len(chosen):
            raise UsageError(f"--sample {sample}: there are only {len(chosen)} rows to draw from")
        chosen = np.sort(np.random.default_rng(seed).permutation(chosen)[:sample])
    return measurements.rows(chosen), measurements.rows(np.setdiff1d(np.arange(count), chosen))


def map_from_header(table: Table, robot: Robot) -> ColumnMap:
    """The column map that a header in calibtool's own names stands for.

    Joints `j1_deg …`; target points `t1_x_mm …` (measured) or `t1_nominal_x_mm …` with `t1_error_x_mm …` (measured minus
    nominal); a single point `x_mm y_mm z_mm`; a pose, when an orientation stands beside it.
    """
    joints = joint_columns_of(table, robot)
    if joints is None:
        raise InputError(
            f"{table.name}: no joint columns j1_deg …; name the columns so, or map them with --columns MAP.toml"
        )
    fields: dict[str, object] = {
        "joints": {"columns": joints, "unit": [column.split("_")[1] for column in joints]},
    }
    targets = _header_targets(table.header)
    pose = pose_columns_of(table)
    if targets:
        fields["targets"] = targets
    elif pose is not None:
        position, orientation = pose
        convention = {"qw": "quaternion-wxyz", "rx_rad": "rotation-vector"}.get(orientation[0], "fixed-xyz")
        unit = "deg" if orientation[0] == "roll_deg" else "rad"
        fields["pose"] = {
            "position": position,
            "unit": position[0].split("_")[1],
            "orientation": orientation,
            "convention": convention,
            "orientation_unit": unit,
        }
    else:
        for unit in ("mm", "m"):
            if all(f"{axis}_{unit}" in table.header for axis in "xyz"):
                fields["targets"] = [{"measured": [f"{axis}_{unit}" for axis in "xyz"], "unit": unit}]
    if len(fields) == 1:
        raise InputError(
            f"{table.name}: no measured points: expected t1_x_mm t1_y_mm t1_z_mm …, x_mm y_mm z_mm or a pose, "
            "or map the columns with --columns MAP.toml"
        )
    return ColumnMap.model_validate(fields)


def _header_targets(header: Sequence[str]) -> list[dict[str, object]]:
    found = sorted({(int(m[1]), m[2]) for c in header if (m := re.fullmatch(r"t(\d+)_(?:\w+_)?[xyz]_(mm|m)", c))})
    targets: list[dict[str, object]] = []
    for number, unit in found:

        def triple(kind: str, number: int = number, unit: str = unit) -> list[str]:
            return [f"t{number}_{kind}{axis}_{unit}" for axis in "xyz"]

        if f"t{number}_nominal_x_{unit}" in header:
            targets.append({"nominal": triple("nominal_"), "error": triple("error_"), "unit": unit})
        else:
            targets.append({"measured": triple(""), "unit": unit})
    return targets


def _target_points(table: Table, target: TargetColumns) -> Array:
    if target.measured is not None:
        points = table.optional_numbers(target.measured)
    else:
        assert target.nominal is not None
        assert target.error is not None
        sign = 1.0 if target.error_is == "measured-minus-nominal" else -1.0
        points = table.optional_numbers(target.nominal) + sign * table.optional_numbers(target.error)
    return points * TO_SI[target.unit]


def _rotations(table: Table, pose: PoseColumns) -> Array:
    values = table.numbers(pose.orientation)
    expected = 4 if pose.convention.startswith("quaternion") else 3
    if values.shape[1] != expected:
        raise InputError(f"{table.name}: {pose.convention} takes {expected} columns, {values.shape[1]} are mapped")
    if expected == 4:
        lengths = np.linalg.norm(values, axis=-1)
        if (np.abs(lengths - 1) > 1e-3).any():
            row = int(np.argmax(np.abs(lengths - 1) > 1e-3))
            raise InputError(f"{table.place(row)}: quaternion of length {lengths[row]:.4g}; expected 1")
        return Rotation.from_quat(values, scalar_first=pose.convention.endswith("wxyz")).as_matrix()
    values = values * TO_SI[pose.orientation_unit]
    if pose.convention == "rotation-vector":
        return Rotation.from_rotvec(values).as_matrix()
    kind, axes = pose.convention.split("-")
    return Rotation.from_euler(axes.upper() if kind == "intrinsic" else axes, values).as_matrix()


def _setup(columns: ColumnMap, robot: Robot, points: Array, frame: str, robot_targets: bool, name: str) -> Setup:
    """What is known of the set-up; unknown parts start at zero and are registered afterwards."""
    m = points.shape[1]
    targets, known = np.zeros((m, 3)), False
    if robot_targets:
        if columns.pose is not None or len(robot.targets) != m:
            raise InputError(f"{name}: {m} measured targets, but {robot.name} describes {len(robot.targets)}")
        targets, known = robot.targets, True
    elif columns.targets and columns.targets[0].on_tool_mm is not None:
        targets, known = np.array([target.on_tool_mm for target in columns.targets]) * 1e-3, True
    if known:
        check_targets(targets, name)
    # Measured points show a collinear set too, whatever is known of the targets.
    whole = points[~np.isnan(points[..., 0]).any(axis=-1)]
    if len(whole):
        check_targets(whole[0], f"{name}: measured points")
    return Setup(
        T_instrument_base=readonly(np.eye(4)),
        targets=readonly(targets),
        R_tool_sensor=readonly(np.eye(3)) if columns.pose is not None else None,
        frame_known=frame == "base",
        targets_known=known,
    )
