"""Protocol of a family of errors, as simulation, identification, files and reports use it."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from calibtool.errormodel.operating_conditions import REFERENCE_C, Conditions
from calibtool.errormodel.tolerances import Tolerances
from calibtool.robot.gravity_torque import gravity_torque, weight_moments
from calibtool.robot.mechanism import Frames
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, adjoint, readonly

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class Rows:
    """Commanded rows: joints q (N, n) in rad or m, conditions, and the nominal robot's state."""

    robot: Robot
    q: Array
    conditions: Conditions

    @cached_property
    def torque(self) -> Array:
        """Gravity torques of the links (N, n), N m."""
        return gravity_torque(self.robot, self.q)

    @cached_property
    def nominal(self) -> Frames:
        """Frames of the nominal robot."""
        return self.robot.mechanism.frames(self.q)

    @cached_property
    def moment(self) -> Array:
        """Moments of the links' weight about the joints (N, n, 3) in K_0, N m."""
        return weight_moments(self.robot, self.nominal)

    @property
    def payload(self) -> Array:
        """Mass at the tool, kg: (N,) or ()."""
        given = self.conditions.payload_kg
        return (
            np.array(self.robot.source.description.mounting.payload_kg) if given is None else given
        )

    @property
    def warmth(self) -> Array:
        """Temperature above the reference, K: (N,) or ()."""
        given = self.conditions.temperature_c
        return np.zeros(()) if given is None else given - REFERENCE_C


@dataclass(frozen=True, eq=False)
class Context:
    """Where columns are computed: commanded rows and the frames of the state there.

    frames  of the robot with its errors
    moved   (N, n) joint positions after all joint motion errors and offsets, rad or m
    twists  (n, 6) ξ_j + δξ_j
    """

    rows: Rows
    frames: Frames
    moved: Array
    twists: Array

    @cached_property
    def offset_columns(self) -> Array:
        """Ad(F_j) ξ_j, change of the pose by a motion of joint j: (N, 6, n)."""
        return offset_columns(self.frames, self.twists)


def offset_columns(frames: Frames, twists: Array) -> Array:
    """δq_j, j = 1…n: Ad(F_j) ξ_j, which is also the spatial Jacobian. (N, 6, n)"""
    if frames.jacobian is not None:
        return frames.jacobian
    return np.moveaxis((adjoint(frames.after) @ twists[:, :, None])[..., 0], 1, 2)


def turn_columns(frames: Array, turns: Array) -> Array:
    """Columns of small turns about the origins of frames (N, n, 4, 4), turns (N, n, 3, k) in them:
    (N, 6, n k)."""
    turned = frames[..., :3, :3] @ turns
    shifts = np.cross(frames[..., :3, 3, None], turned, axis=-2)
    columns = np.concatenate([shifts, turned], axis=-2)
    return np.moveaxis(columns, 1, 2).reshape(len(frames), 6, turns.shape[1] * turns.shape[-1])


@dataclass(frozen=True, eq=False)
class Sizes:
    """Magnitudes of simulated errors, SI: lengths, angles, and that of another kind."""

    length: float
    angle: float
    size: float


class Family(ABC):
    """A family of errors.

    Its value is one array; properties of its elements are arrays of the same shape.

    id      key in states, files and JSON
    symbol  beginning of the names of its parameters; `ascii` is the same without Greek letters
    kind    kind of simulated errors that it belongs to
    words   description
    meaning formula, for readers of a file
    unit    of the stored value, SI
    size    default magnitude of simulated errors, SI
    expected  standard deviation of an element where the robot's tolerances do not state it, SI
    orders  orders from which evidence chooses; 0: none of its parameters
    always  whether it is identified by default
    needs   description of what the rows must contain for it to be identified
    by_row  whether it changes placements from row to row
    turns   whether it turns joint frames from row to row (`turn`)
    positive  whether its elements cannot be below zero
    grows   whether evidence may also enlarge its tolerances: what has a physical scale only gets
    smaller
    """

    id: ClassVar[str]
    symbol: ClassVar[str]
    ascii: ClassVar[str]
    kind: ClassVar[str]
    words: ClassVar[str]
    meaning: ClassVar[str]
    unit: ClassVar[str]
    size: ClassVar[float] = 0.0
    expected: ClassVar[float] = 0.0
    orders: ClassVar[tuple[int, ...]] = (0, 1)
    always: ClassVar[bool] = False
    needs: ClassVar[str] = "joint positions"
    by_row: ClassVar[bool] = False
    turns: ClassVar[bool] = False
    grows: ClassVar[bool] = True
    positive: ClassVar[bool] = False

    # --- its parameters ---

    def joints(self, robot: Robot) -> int:
        """For how many joints a robot has a value: the actuated ones."""
        return robot.n

    def shape(self, n: int, order: int = 1) -> tuple[int, ...]:
        """Shape of the value for n joints, by default (n,)."""
        return (n,)

    def value(self, n: int, given: Array | None = None) -> Array:
        """Read-only value for n joints, zero by default. ValueError for another shape."""
        if given is None:
            return readonly(np.zeros(self.shape(n, 0)))
        order = self.order(np.shape(given)) if np.ndim(given) == len(self.shape(n)) else 1
        return readonly(given, self.shape(n, order))

    def order(self, shape: tuple[int, ...]) -> int:
        """Order of a value of this shape."""
        return 1

    def free(self, robot: Robot, shape: tuple[int, ...]) -> np.ndarray:
        """(*shape) bool: which elements are parameters."""
        return np.ones(shape, dtype=bool)

    def names(self, shape: tuple[int, ...], symbol: str) -> list[str]:
        """One name per element, flat; by default the symbol with the number of the joint."""
        return [f"{symbol}{j + 1}" for j in range(shape[0])]

    def names_of(self, robot: Robot, shape: tuple[int, ...], symbol: str) -> list[str]:
        """The same for a robot, whose passive joints and cut frames have no numbers."""
        return self.names(shape, symbol)

    def tolerance(self, robot: Robot, tolerances: Tolerances, shape: tuple[int, ...]) -> Array:
        """Prior standard deviations (*shape), SI."""
        return np.full(shape, tolerances.of.get(self.id, self.expected))

    def groups(self, shape: tuple[int, ...]) -> np.ndarray:
        """(*shape) int: elements with the same number share one scale of tolerances."""
        return np.zeros(shape, dtype=int)

    def fine(self, shape: tuple[int, ...]) -> np.ndarray:
        """Which elements are fine structure, whose size only the residuals tell: (*shape) bool."""
        return np.zeros(shape, dtype=bool)

    def sections(self, shape: tuple[int, ...]) -> np.ndarray:
        """Elements with the same number become parameters together or not at all: (*shape) int."""
        return np.zeros(shape, dtype=int)

    def trimmed(self, free: np.ndarray) -> np.ndarray:
        """Which elements are parameters, in the smallest shape that contains them."""
        return free

    def known(self, rows: Rows) -> bool:
        """Whether the rows contain what the family depends on."""
        return True

    # --- for people ---

    def display(self, robot: Robot, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
        """Factors (*shape) and units in which the elements are displayed."""
        per_joint = ["mm" if prismatic else "mrad" for prismatic in robot.prismatic]
        return np.full(shape, 1e3), per_joint

    def describe(self, robot: Robot, value: Array, free: np.ndarray) -> str:
        """Text about the family for the description of a model; free (*shape) bool."""
        return self.words

    # --- the robot ---

    def placed(self, value: Array, placements: Array, rows: Rows | None) -> Array:
        """Joint placements M_j (n+1, 4, 4), or (N, n+1, 4, 4) if they change by row."""
        return placements

    def turn(self, value: Array, rows: Rows) -> Array | float:
        """Small turns of the joint frames F0_j about their origins, rotation vectors in them (N,
        n, 3), rad.

        Those of all families are added, and stand between the growth of the links and δζ_j.
        """
        return 0.0

    def twisted(self, value: Array, twists: Array) -> Array:
        """Joint twists (n, 6)."""
        return twists

    def offset(self, value: Array) -> Array | float:
        """Additional constant joint positions (n,), rad or m."""
        return 0.0

    def motion(self, value: Array, rows: Rows) -> Array | float:
        """Additional joint positions of every row (N, n), rad or m."""
        return 0.0

    @abstractmethod
    def columns(self, shape: tuple[int, ...], context: Context) -> Array:
        """∂δy/∂value (N, 6, size), δy the spatial twist of `relative_error`."""

    def moved(self, value: Array, step: Array) -> Array:
        """The value after a step of the parameters (*shape)."""
        return value + step

    def resized(self, value: Array, shape: tuple[int, ...]) -> Array:
        """The same errors as a value of another order."""
        return value

    # --- simulation ---

    @abstractmethod
    def drawn(self, robot: Robot, sizes: Sizes, rng: np.random.Generator) -> Array:
        """Random value for a simulated robot."""


def sections_of_joints(shape: tuple[int, ...]) -> np.ndarray:
    """One section for each joint, the first axis of a shape."""
    return np.broadcast_to(np.arange(shape[0]).reshape(-1, *[1] * (len(shape) - 1)), shape)


class JointFunctions(Family):
    """δq_j = Σ_k value_jk f_jk(row).

    The columns are those of the joint offset times the functions.
    """

    @abstractmethod
    def functions(self, shape: tuple[int, ...], rows: Rows) -> Array:
        """f (N, n, k)."""

    def motion(self, value: Array, rows: Rows) -> Array | float:
        if not value.any():
            return 0.0
        if value.ndim == 1:
            return value * self.functions(value.shape, rows)[..., 0]
        return np.asarray((self.functions(value.shape, rows) * value).sum(axis=-1))

    def columns(self, shape: tuple[int, ...], context: Context) -> Array:
        products = context.offset_columns[..., None] * self.functions(shape, context.rows)[:, None]
        return products.reshape(*products.shape[:2], math.prod(shape))


def joint_list(free: np.ndarray) -> str:
    """Joints that have a parameter, for people: `joint 2`, `joints 2, 3`."""
    joints = np.flatnonzero(free.reshape(len(free), -1).any(axis=-1)) + 1
    return f"joint{'s' if len(joints) > 1 else ''} {', '.join(map(str, joints))}"


def names_of_twists(count: int, symbol: str) -> list[str]:
    """ζ1.x … of `count` twists."""
    return [f"{symbol}{j + 1}.{c}" for j in range(count) for c in COMPONENTS]
