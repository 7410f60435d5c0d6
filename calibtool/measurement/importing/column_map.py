"""The column map (`--columns MAP.toml`): meaning, unit and convention of the columns of a table."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from calibtool.errors import InputError
from calibtool.measurement.simulate import ORIENTATION_NOISE
from calibtool.robot.coupling import JointValues
from calibtool.robot.description import Point
from calibtool.robot.orientation import numbers_in
from calibtool.robot.toml_text import parse_toml, read_model

POSITION_NOISE = 0.05e-3  # m: stated for an instrument whose noise is not given

LengthUnit = Literal["mm", "m", "in"]
AngleUnit = Literal["deg", "rad"]
TimeUnit = Literal["s", "ms", "iso"]
Frame = Literal["base", "unknown"]
Triple = Annotated[list[str], Field(min_length=3, max_length=3)]

CONVENTIONS = (
    "intrinsic-xyz, extrinsic-xyz (any axes), zyx (= intrinsic-zyx), rotation-vector, "
    "quaternion-wxyz, -xyzw, matrix (nine numbers, row by row), matrix-columns"
)


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class JointColumns(_Strict):
    """One column per joint, in the robot's order; one unit for all, or a list; whether the values
    are the serial chain's or the controller's.
    """

    columns: list[str]
    unit: Literal["deg", "rad", "mm", "m"] | list[Literal["deg", "rad", "mm", "m"]]
    values: JointValues | None = None  # needed on a robot with [coupling], which converts them

    def units(self) -> list[str]:
        """One unit per joint."""
        return list(self.unit) if isinstance(self.unit, list) else [self.unit] * len(self.columns)


class TargetColumns(_Strict):
    """A target point: measured coordinates, or nominal ones and errors; `on_tool_mm` if known."""

    measured: Triple | None = None
    nominal: Triple | None = None
    error: Triple | None = None
    error_is: Literal["measured-minus-nominal", "nominal-minus-measured"] = "measured-minus-nominal"
    unit: LengthUnit
    on_tool_mm: Point | None = None

    @model_validator(mode="after")
    def _one_form(self) -> "TargetColumns":
        if (self.measured is None) == (self.nominal is None) or (self.nominal is None) != (
            self.error is None
        ):
            raise ValueError("give either 'measured', or 'nominal' together with 'error'")
        return self

    @property
    def columns(self) -> list[str]:
        """Every column that the target is read from."""
        return [*(self.measured or []), *(self.nominal or []), *(self.error or [])]


class PoseColumns(_Strict):
    """A 6-D sensor: position, and orientation by a named convention."""

    position: Triple
    unit: LengthUnit
    orientation: Annotated[list[str], Field(min_length=3, max_length=9)]
    convention: str
    orientation_unit: AngleUnit | None = None  # of angles and vectors
    of: Literal["sensor", "board"] = "sensor"  # on the tool, or of a fixed board in its camera

    @field_validator("convention")
    @classmethod
    def _known(cls, value: str) -> str:
        check_convention(value)
        return value

    @model_validator(mode="after")
    def _complete(self) -> "PoseColumns":
        angles = self.convention == "zyx" or numbers_in(self.convention) == 3
        if self.orientation_unit is None and angles:
            raise ValueError(f"{self.convention} needs orientation_unit = 'deg' or 'rad'")
        return self


class LengthColumns(_Strict):
    """Lengths instead of points: distances to fixed points (wires, a ball-bar), one column each, or
    the height of the probe's tip above a plane or a sphere; `centre`: from a sphere's centre.
    """

    columns: list[str]  # none: contacts with planes or spheres, heights of zero
    unit: LengthUnit
    of: Literal["distance", "plane", "sphere", "centre"] = "distance"

    @model_validator(mode="after")
    def _measured(self) -> "LengthColumns":
        if not self.columns and self.of not in ("plane", "sphere"):
            raise ValueError("columns: at least one, unless planes or spheres are touched")
        return self


class PlaceColumn(_Strict):
    """Labels of the places of rows: stations, placements, boards, planes, spheres."""

    column: str


class ReferenceColumns(_Strict):
    """A target fixed to the base, measured again with every configuration."""

    measured: Triple
    unit: LengthUnit


class TimeColumn(_Strict):
    """Time stamps: seconds or milliseconds from any start, or ISO 8601 (`iso`)."""

    column: str
    unit: TimeUnit


class TemperatureColumn(_Strict):
    """A temperature in °C or K."""

    column: str
    unit: Literal["C", "K"]


class PayloadColumn(_Strict):
    """The mass at the tool in kg or g."""

    column: str
    unit: Literal["kg", "g"]


class JoinColumns(_Strict):
    """The columns by which rows of table and joint file match: names, or stamps with a unit."""

    measured: str
    joints: str
    unit: TimeUnit | None = None


class Instrument(_Strict):
    """Frame of the measured values: the robot's base, or unknown (then it is estimated)."""

    frame: Frame = "unknown"


class Noise(_Strict):
    """Stated standard deviations per coordinate."""

    position_mm: Annotated[float, Field(gt=0)] = POSITION_NOISE * 1e3
    orientation_mrad: Annotated[float, Field(gt=0)] = ORIENTATION_NOISE * 1e3


class ColumnMap(_Strict):
    """The contents of a `--columns` file; missing parts are found by the header's names."""

    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] | None = None
    joints: JointColumns | None = None
    joints_read: JointColumns | None = None
    targets: list[TargetColumns] = []
    pose: PoseColumns | None = None
    lengths: LengthColumns | None = None
    place: PlaceColumn | None = None
    references: list[ReferenceColumns] = []
    time: TimeColumn | None = None
    temperature: TemperatureColumn | None = None
    payload: PayloadColumn | None = None
    join: JoinColumns | None = None
    instrument: Instrument = Instrument()
    noise: Noise = Noise()

    @property
    def columns(self) -> set[str]:
        """Every column that the map uses."""
        parts: list[list[str]] = [target.columns for target in self.targets]
        parts += [reference.measured for reference in self.references]
        parts += [part.columns for part in (self.joints, self.joints_read) if part]
        single = (self.time, self.temperature, self.payload, self.place)
        parts += [[part.column] for part in single if part]
        parts += [self.lengths.columns] if self.lengths else []
        if self.pose is not None:
            parts.append([*self.pose.position, *self.pose.orientation])
        return {column for part in parts for column in part}

    def with_joint_values(self, values: JointValues) -> "ColumnMap":
        """The same with a kind of joint values; also of those read back, unless they state it."""
        joints, read = self.joints, self.joints_read
        if joints is not None:
            joints = joints.model_copy(update={"values": values})
        if read is not None and read.values is None:
            read = read.model_copy(update={"values": values})
        return self.model_copy(update={"joints": joints, "joints_read": read})

    @model_validator(mode="after")
    def _one_kind(self) -> "ColumnMap":
        if bool(self.targets) + (self.pose is not None) + (self.lengths is not None) > 1:
            raise ValueError("give either [[targets]], [pose] or [lengths]")
        known = [target.on_tool_mm is not None for target in self.targets]
        if any(known) and not all(known):
            raise ValueError(
                "on_tool_mm is given for some targets only; give it for all or for none"
            )
        return self


def parse_column_map(text: str, name: str) -> ColumnMap:
    """A column map from TOML text. Raises InputError with the key that is wrong."""
    keys = parse_toml(text, name)
    if not keys:
        raise InputError(f"{name}: empty; expected tables such as [joints] and [[targets]]")
    return read_model(ColumnMap, keys, name)


def check_convention(value: str) -> None:
    """ValueError unless `value` is a convention; Euler angles need `intrinsic` or `extrinsic`."""
    if value != "zyx" and not numbers_in(value):
        raise ValueError(f"unknown convention '{value}'; known: {CONVENTIONS}")
