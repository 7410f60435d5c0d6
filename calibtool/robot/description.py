"""robot.toml: name of a robot, source of its kinematics, targets, workspaces and limits."""

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from calibtool.errors import InputError, UsageError, near_names
from calibtool.robot.denavit_hartenberg import DhConvention
from calibtool.robot.named_files import contents, inside
from calibtool.robot.tool import Choice, chosen, quoted
from calibtool.robot.tree import urdf_tree
from calibtool.robot.urdf_text import Converted

Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]  # mm, a kilometre
Angle = Annotated[float, Field(ge=-1e4, le=1e4)]
Point = tuple[Coordinate, Coordinate, Coordinate]
VirtualJoint = Literal["x", "y", "z", "rx", "ry", "rz"]
ExternalName = Annotated[str, Field(pattern=r"^e[1-6]$")]
JointName = Annotated[str, Field(pattern=r"^j[1-9]\d{0,5}$")]

_IN_FOLDERS = ("robot.toml", "robot.yaml")
_MOST_DOTS = 2000  # of one line: numbers and dotted keys


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class LoopTable(_Strict):
    """A closed loop: two frames, A and B, and the joint that joins them (`loops.FORBIDDEN`), about
    or along z of A.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._-]*$")] | None = None
    frames: tuple[str, str]
    joint: Literal["weld", "revolute", "prismatic", "cylindrical", "spherical", "planar"]


class Placement(_Strict):
    """A frame in the one before it, and the joint that moves it: about its axis, or along it."""

    xyz_mm: Point = (0.0, 0.0, 0.0)
    rpy_deg: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)  # about the fixed axes x, y, z
    axis: tuple[Angle, Angle, Angle] = (0.0, 0.0, 1.0)
    type: Literal["revolute", "prismatic", "fixed"] = "revolute"


class Kinematics(_Strict):
    """Source of the kinematics: one of `urdf` (a path beside robot.toml, of any description that
    `contents.told` knows), `example_robot_data` (a path inside it), numbers (`chain`, or `dh`, rows
    of a table in a convention), and `nominal`, a UR arm of the catalogue, with the `calibration` of
    one arm: the calibration.conf of its controller, or the calibration.yaml of the driver.
    """

    urdf: str | None = None
    example_robot_data: str | None = None
    chain: list[Placement] | None = None
    dh: list[dict[str, float | str]] | None = None
    dh_convention: DhConvention | None = None
    nominal: str | None = None
    calibration: str | None = None
    base_frame: str | None = None  # K_0; the URDF's root link unless named
    tool_frame: str  # of numbers and calibrations: tool0 unless named
    locked_joints: dict[str, float] = {}  # rad or m
    loops: list[LoopTable] = []
    actuated: list[str] | None = (
        None  # joints with a motor, in their order; with loops or mimic joints
    )
    closed_at: dict[str, float] = {}  # rad or m: a closed configuration, the assembly mode
    length: Annotated[float, Field(gt=0, le=1e4)] | None = None  # m, characteristic, with loops

    @model_validator(mode="before")
    @classmethod
    def _tool_of_numbers(cls, data: object) -> object:
        if isinstance(data, dict) and not {"chain", "dh", "nominal"}.isdisjoint(data):
            return {"tool_frame": "tool0", **data}
        return data

    @model_validator(mode="after")
    def _one_source(self) -> "Kinematics":
        sources = ("urdf", "example_robot_data", "chain", "dh", "nominal")
        if sum(getattr(self, source) is not None for source in sources) != 1:
            raise ValueError(
                "give exactly one of 'urdf' and 'example_robot_data', or numbers, 'chain' or 'dh', "
                "or 'nominal' with a 'calibration'"
            )
        if (self.nominal is None) != (self.calibration is None):
            raise ValueError(
                "'nominal' (a UR arm of the catalogue) and 'calibration' (its file) belong together"
            )
        if (self.dh is None) != (self.dh_convention is None):
            raise ValueError("'dh' and 'dh_convention' (standard or modified) belong together")
        return self


class Workspace(_Strict):
    """A box (full edge lengths, along K_0) and an orientation cone (half angle) round the
    tool pose at `home`.

    `roll_deg` bounds the turn about the tool's z axis; it is the cone's angle unless given. `home`
    is written with the names of table columns: `{ j1_deg = 0, j2_mm = 100 }`.
    """

    home: dict[str, float]
    box_m: Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=3, max_length=3)]
    cone_deg: Annotated[float, Field(ge=0, le=180)]
    roll_deg: Annotated[float, Field(ge=0, le=180)] | None = None


class Targets(_Strict):
    """Target points fixed to the flange, in the tool frame."""

    points_mm: Annotated[list[Point], Field(min_length=1)]


class Equivalent(_Strict):
    """Overrides of the equivalent robot: the virtual joints, elementary twists of the tool frame,
    of an arm with n < 6.
    """

    virtual_joints: list[VirtualJoint]


class JointTolerance(_Strict):
    """Expected standard deviations of the geometric errors at one joint."""

    length_mm: Annotated[float, Field(gt=0)]
    angle_mrad: Annotated[float, Field(gt=0)]


class ToleranceTable(_Strict):
    """Expected standard deviations of the errors, the prior of the complete model; `joints` by
    name: j3 = { … }.
    """

    length_mm: Annotated[float, Field(gt=0)] = 1.0
    angle_mrad: Annotated[float, Field(gt=0)] = 1.0
    harmonic_mrad: Annotated[float, Field(gt=0)] = 0.3
    gravity_mrad: Annotated[float, Field(gt=0)] = 1.0
    backlash_mrad: Annotated[float, Field(gt=0)] = 0.2
    joints: dict[JointName, JointTolerance] = {}


class Coupling(_Strict):
    """How the controller's joint values become those of the serial chain: q_serial = C
    q_controller, in rad or m.

    One of `matrix`, C row by row, and `add`, what differs from the identity: `add = { j3 = { j2 = 1
    } }` is a FANUC's serial q3 = J3 + 1 J2.
    """

    matrix: list[list[float]] | None = None
    add: dict[JointName, dict[JointName, float]] = {}

    @model_validator(mode="after")
    def _one_form(self) -> "Coupling":
        if (self.matrix is None) == (not self.add):
            raise ValueError("give exactly one of 'matrix' and 'add'")
        return self


class Mounting(_Strict):
    """Mounting and load of the robot.

    `gravity`: its direction in K_0, of any length (default: that of the URDF's world). The mass at
    the tool holds where a row does not state its own.
    """

    gravity: tuple[float, float, float] | None = None
    payload_kg: Annotated[float, Field(ge=0, le=1e5)] = 0.0

    @model_validator(mode="after")
    def _has_a_direction(self) -> "Mounting":
        if self.gravity is not None and not any(self.gravity):
            raise ValueError("gravity has no direction: it is [0, 0, 0]")
        return self


class ControllerTable(_Strict):
    """What is known of this robot's controllers: that they compute poses with a calibration of each
    arm, made in the factory.

    `always`: every one does; `optional`: those for which it was bought. `reason` says so in a few
    words.
    """

    factory_calibration: Literal["always", "optional"]
    reason: Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^\r\n]*$")]


class Description(_Strict):
    """The contents of a robot.toml."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
    title: str
    notes: list[str] = []
    assumed: str | None = None  # where nobody wrote a robot.toml: what was taken to be so
    kinematics: Kinematics
    limits: dict[str, tuple[float, float]] = {}  # by column name: j1_deg = [-180, 180]
    targets: Targets
    workspaces: dict[str, Workspace] = {}  # the first one is the default; `full` always exists
    equivalent: Equivalent | None = None
    tolerances: ToleranceTable = ToleranceTable()
    mounting: Mounting = Mounting()
    external: dict[
        ExternalName, JointName
    ] = {}  # external axes of programs that are joints of this chain
    coupling: Coupling | None = None  # the controller's joint values are those of the serial chain
    controller: ControllerTable | None = None  # controllers compute poses with the nominal robot

    @model_validator(mode="after")
    def _full_is_built_in(self) -> "Description":
        if "full" in self.workspaces:
            raise ValueError(
                "the workspace 'full' is built in (the whole joint range); choose another name"
            )
        return self


@dataclass(frozen=True)
class Source:
    """A description with the texts that it was read from, to build the robot again."""

    description: Description
    toml_text: str
    urdf_text: str
    place: str  # where it was read, for messages


def parse_source(toml_text: str, urdf_text: str, place: str) -> Source:
    """Validate the text of a robot.toml.

    Raises InputError with `place`, the key and what is wrong.
    """
    return Source(_parse_description(toml_text, place), toml_text, urdf_text, place)


def read_source(path: Path, tool: str | None = None, allowed: tuple[Path, ...] = ()) -> Source:
    """Read `path`: a folder with a robot.toml, a robot.toml, a URDF, or what `contents.told` knows.

    tool: the tool frame of a description that does not name it; UsageError for one that does.
    allowed: folders, besides that of the description, whose files it may name.
    """
    from calibtool.robot.contents import WHAT, converted, told
    from calibtool.robot.numeric_kinematics import numbers_as_urdf

    if path.is_dir():
        inside_it = [path / name for name in _IN_FOLDERS if (path / name).exists()]
        if not inside_it:
            raise InputError(
                f"{path / _IN_FOLDERS[0]}: No such file; give a folder with one, or the file of a "
                "description"
            )
        path = inside_it[0]
    kind, text = told(contents(path), path)
    if kind != "toml":
        return bare_source(converted(kind, text, path, allowed), path.stem, tool, WHAT[kind])
    description = _parse_description(text, str(path))
    kinematics = description.kinematics
    if tool is not None:
        raise UsageError(f"--tool: {path} names its tool_frame, '{kinematics.tool_frame}'")
    if kinematics.chain is not None or kinematics.dh is not None:
        return Source(description, text, numbers_as_urdf(description, str(path)), str(path))
    if kinematics.calibration is not None:
        return Source(description, text, _calibrated(path, kinematics, allowed), str(path))
    if kinematics.urdf is not None:
        urdf_path = inside(path.parent, kinematics.urdf, f"{path}: kinematics.urdf", allowed)
    else:
        name = str(kinematics.example_robot_data)
        urdf_path = inside(example_robot_data(), name, f"{path}: kinematics.example_robot_data")
    kind, urdf_text = told(contents(urdf_path), urdf_path)
    if kind == "toml":
        raise InputError(f"{path}: kinematics.urdf: {urdf_path} is a robot.toml itself")
    urdf_text = converted(kind, urdf_text, urdf_path, allowed).urdf
    return Source(description, text, urdf_text, str(path))


def _calibrated(path: Path, kinematics: Kinematics, allowed: tuple[Path, ...]) -> str:
    """The URDF of `nominal` with its `calibration`."""
    from calibtool.robot.catalogue import load_robot, robot_names
    from calibtool.robot.contents import told
    from calibtool.robot.universal_robots import calibrated_urdf

    place = f"{path}: kinematics.calibration"
    arms = [name for name in robot_names() if name.startswith("ur")]
    if kinematics.nominal not in arms:
        known = near_names(str(kinematics.nominal), arms)
        raise InputError(f"{path}: kinematics.nominal: no UR arm of the catalogue; {known}")
    file = inside(path.parent, str(kinematics.calibration), place, allowed)
    kind, text = told(contents(file), file)
    if kind not in ("ur-conf", "ur-yaml"):
        raise InputError(f"{place}: {file} is no calibration.conf or calibration.yaml of a UR arm")
    return calibrated_urdf(kind, text, str(file), load_robot(str(kinematics.nominal)))


def source_from_urdf(urdf_text: str, name: str, tool: str | None = None) -> Source:
    """A description for a bare URDF: see `bare_source`."""
    return bare_source(Converted(urdf_text), name, tool)


def bare_source(
    said: Converted, name: str, tool: str | None = None, what: str = "a bare URDF"
) -> Source:
    """What a robot.toml would say: see `tool.chosen`; three targets on a circle of 0.1 m.

    what: what the description is, in the line of what was assumed. UsageError where several links
    could be the tool and `tool` does not say which.
    """
    from calibtool.robot.closed_chain import configuration_found  # Pinocchio is only needed here
    from calibtool.robot.urdf import parse_urdf

    parse_urdf(said.urdf, name)
    found = chosen(urdf_tree(said.urdf, name), name, tool, said)
    source = _assumed(found, said, name, what)
    if found.loops and found.actuated is not None and not found.closed_at:
        closed_at = configuration_found(source)
        source = _assumed(replace(found, closed_at=closed_at), said, name, what)
    return source


def _assumed(found: Choice, said: Converted, name: str, what: str) -> Source:
    allowed = "".join(c if c.isascii() and (c.isalnum() or c in "._-") else "-" for c in name)
    safe = allowed.lstrip("._-") or "robot"
    keys = found.toml.replace("\n", ", ")
    mounting = f"\n[mounting]\ngravity = {list(said.gravity)}\n" if said.gravity else ""
    assumed = f"{what}, taken as [kinematics] {keys}; the targets are assumed"
    toml_text = (
        f'name = "{safe}"\ntitle = "{safe}, from {what}"\n'
        f"assumed = {quoted(assumed)}\n\n"
        f'[kinematics]\nurdf = "robot.urdf"\n{found.toml}\n\n'
        "[targets]\npoints_mm = [[100.0, 0.0, 0.0], [-50.0, 86.6, 0.0], [-50.0, -86.6, 0.0]]\n"
        f"{mounting}"
    )
    return parse_source(toml_text, said.urdf, name)


def example_robot_data() -> Path:
    """Where the installed example-robot-data keeps its robots (its wheel has no Python module)."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        located = distribution("example-robot-data").locate_file(
            "cmeel.prefix/share/example-robot-data/robots"
        )
    except PackageNotFoundError:
        raise InputError(
            "example-robot-data is not installed; run: pip install example-robot-data"
        ) from None
    return Path(str(located))


def _parse_description(toml_text: str, place: str) -> Description:
    try:
        return Description.model_validate(parse_toml(toml_text, place))
    except ValidationError as error:
        raise InputError(f"{place}: {validation_message(error, Description)}") from None


def parse_toml(text: str, place: str) -> dict[str, Any]:
    """The keys of a TOML text.

    InputError with `place` for anything else, and for nesting that Python cannot follow.
    """
    if (
        max(line.count(".") for line in text.split("\n")) > _MOST_DOTS
    ):  # tomllib's time grows with the square of a key's
        raise InputError(f"{place}: not valid TOML: a line with more than {_MOST_DOTS} dots")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{place}: not valid TOML: nested too deeply") from None
    except (
        ValueError
    ) as error:  # TOMLDecodeError is one, and so is an integer of thousands of digits
        raise InputError(f"{place}: not valid TOML: {error}") from None


def validation_message(error: ValidationError, model: type[BaseModel]) -> str:
    """A finding of pydantic as one line: key, what is wrong, near names for an unknown key,
    which comes first.
    """
    findings = error.errors()
    first = next(
        (finding for finding in findings if finding["type"] == "extra_forbidden"), findings[0]
    )
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        known = _fields_at(model, first["loc"][:-1])
        return f"unknown key '{key}'" + (
            f"; {near_names(str(first['loc'][-1]), known)}" if known else ""
        )
    message = first["msg"].removeprefix("Value error, ")
    return f"{key}: {message}" if key else message


def _fields_at(model: type[BaseModel], path: tuple[int | str, ...]) -> list[str]:
    """Keys of the model that stands at `path` inside another one, none if that cannot be told."""
    for part in path:
        if isinstance(part, int) or part not in model.model_fields:
            # an element of a list or of a table with free names: the model is already
            # that of its values
            continue
        inner = _models_in(model.model_fields[part].annotation)
        if not inner:
            return []
        model = inner[0]
    return list(model.model_fields)


def _models_in(annotation: object) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in _models_in(argument)]
