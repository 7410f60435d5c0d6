"""robot.toml: name of a robot, source of its kinematics, targets, workspaces and limits."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from calibtool.robot.denavit_hartenberg import DhConvention

Number = Annotated[float, Field(strict=True)]  # no truth value, and no text
Coordinate = Annotated[Number, Field(ge=-1e6, le=1e6)]  # mm, a kilometre
Angle = Annotated[Number, Field(ge=-1e4, le=1e4)]
Point = tuple[Coordinate, Coordinate, Coordinate]
VirtualJoint = Literal["x", "y", "z", "rx", "ry", "rz"]
ExternalName = Annotated[str, Field(pattern=r"^e[1-6]$")]
JointName = Annotated[str, Field(pattern=r"^j[1-9]\d{0,5}$")]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class LoopTable(_Strict):
    """A closed loop: frames A and B, and their joint (`loops.FORBIDDEN`), about or along z of A."""

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
    `contents.recognise` knows), `example_robot_data` (a path inside it), numbers (`chain`, or `dh`,
    rows of a table in a convention), and `nominal`, a UR arm of the catalogue, with the
    `calibration` of one arm: the calibration.conf of its controller, or the calibration.yaml of the
    driver.
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
    locked_joints: dict[str, Number] = {}  # rad or m
    loops: list[LoopTable] = []
    # Joints with a motor, in their order; with loops or mimic joints.
    actuated: list[str] | None = None
    closed_at: dict[str, Number] = {}  # rad or m: a closed configuration, the assembly mode
    length: Annotated[Number, Field(gt=0, le=1e4)] | None = None  # m, characteristic, with loops

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

    home: dict[str, Number]
    box_m: Annotated[list[Annotated[Number, Field(ge=0)]], Field(min_length=3, max_length=3)]
    cone_deg: Annotated[Number, Field(ge=0, le=180)]
    roll_deg: Annotated[Number, Field(ge=0, le=180)] | None = None


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

    length_mm: Annotated[Number, Field(gt=0)]
    angle_mrad: Annotated[Number, Field(gt=0)]


class ToleranceTable(_Strict):
    """Expected standard deviations of the errors; `joints` by name: j3 = { … }."""

    length_mm: Annotated[Number, Field(gt=0)] = 1.0
    angle_mrad: Annotated[Number, Field(gt=0)] = 1.0
    harmonic_mrad: Annotated[Number, Field(gt=0)] = 0.3
    gravity_mrad: Annotated[Number, Field(gt=0)] = 1.0
    backlash_mrad: Annotated[Number, Field(gt=0)] = 0.2
    joints: dict[JointName, JointTolerance] = {}


class Coupling(_Strict):
    """How the controller's joint values become those of the serial chain: q_serial = C
    q_controller, in rad or m.

    One of `matrix`, C row by row, and `add`, what differs from the identity: `add = { j3 = { j2 = 1
    } }` is a FANUC's serial q3 = J3 + 1 J2.
    """

    matrix: list[list[Number]] | None = None
    add: dict[JointName, dict[JointName, Number]] = {}

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

    gravity: tuple[Number, Number, Number] | None = None
    payload_kg: Annotated[Number, Field(ge=0, le=1e5)] = 0.0

    @model_validator(mode="after")
    def _has_a_direction(self) -> "Mounting":
        if self.gravity is not None and not any(self.gravity):
            raise ValueError("gravity has no direction: it is [0, 0, 0]")
        return self


class ControllerTable(_Strict):
    """Whether controllers of this robot compute poses with a factory calibration of each arm.

    `always`: every one does; `optional`: those for which it was bought. `reason` explains it in a
    few words.
    """

    factory_calibration: Literal["always", "optional"]
    reason: Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^\r\n]*$")]


class Description(_Strict):
    """The contents of a robot.toml."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
    title: str
    notes: list[str] = []
    assumed: str | None = None  # without a robot.toml: what was assumed
    kinematics: Kinematics
    limits: dict[str, tuple[Number, Number]] = {}  # by column name: j1_deg = [-180, 180]
    targets: Targets
    workspaces: dict[str, Workspace] = {}  # the first one is the default; `full` always exists
    equivalent: Equivalent | None = None
    tolerances: ToleranceTable = ToleranceTable()
    mounting: Mounting = Mounting()
    # External axes of programs that are joints of this chain.
    external: dict[ExternalName, JointName] = {}
    coupling: Coupling | None = None  # the controller's joint values are those of the serial chain
    controller: ControllerTable | None = None  # controllers compute poses with the nominal robot

    @model_validator(mode="after")
    def _full_is_built_in(self) -> "Description":
        if "full" in self.workspaces:
            raise ValueError(
                "the workspace 'full' is built in (the whole joint range); choose another name"
            )
        return self
