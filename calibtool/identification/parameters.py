"""The parameters of a model as one vector: families of errors, then the unknown
part of the set-up.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from calibtool.errormodel.families import BY_ID, FAMILIES
from calibtool.errormodel.family import COMPONENTS, Context, Family, JointFunctions
from calibtool.errormodel.operating_conditions import Conditions
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errormodel.tolerances import Tolerances
from calibtool.measurement.registration import update_setup
from calibtool.measurement.setup import Setup
from calibtool.robot.mechanism import Frames
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

# Unknown instrument frames and targets are as good as free beside their registration, but do not
# run away where nothing tells them: 1 m, 1 rad.
_FREE = 1.0
_TURNS = (".rx", ".ry", ".rz")


@dataclass(frozen=True, eq=False)
class Part:
    """The parameters of one family: `elements` (k,) of its value of a `shape`, flat."""

    family: Family
    shape: tuple[int, ...]
    elements: np.ndarray

    @property
    def free(self) -> np.ndarray:
        """Which elements of the value are parameters (*shape) bool."""
        free = np.zeros(self.shape, dtype=bool)
        free.flat[self.elements] = True
        return free

    def only(self, kept: np.ndarray) -> Self | None:
        """The same with some of its elements, kept (k,) bool; None with none of them."""
        free = np.zeros(self.shape, dtype=bool)
        free.flat[self.elements[kept]] = True
        if not kept.any():
            return None
        free = self.family.trimmed(free)
        return replace(self, shape=free.shape, elements=np.flatnonzero(free))


@dataclass(frozen=True, eq=False)
class Parameters:
    """θ: the parameters of the families in their order, then base and targets.

    frame_free  whether the instrument frame is unknown: a twist of K_0
    targets     names of the free elements of the targets, empty where they are known
    """

    robot: Robot
    parts: tuple[Part, ...]
    frame_free: bool
    targets: tuple[str, ...]

    @classmethod
    def of(cls, robot: Robot, setup: Setup, **orders: int) -> Self:
        """Parameters for a robot in a set-up: families of these orders, and those that are always
        identified.
        """
        parts = []
        for family in FAMILIES:
            if order := int(orders.get(family.id, family.always)):
                shape = family.shape(family.joints(robot), order)
                elements = np.flatnonzero(family.free(robot, shape))
                parts += [Part(family, shape, elements)] if len(elements) else []
        targets = setup.free_names
        return cls(robot, tuple(parts), not setup.frame_known, targets)

    @cached_property
    def blocks(self) -> dict[str, slice]:
        """Slices of every family, base and targets in the vector; empty for those without
        parameters.
        """
        sizes = {part.family.id: len(part.elements) for part in self.parts}
        blocks, start = {}, 0
        for name in (*BY_ID, "base", "targets"):
            size = {"base": 6 * self.frame_free, "targets": len(self.targets)}.get(
                name, sizes.get(name, 0)
            )
            blocks[name] = slice(start, start + size)
            start += size
        return blocks

    @cached_property
    def orders(self) -> dict[str, int]:
        """Order of every family that has parameters, by id."""
        return {part.family.id: part.family.order(part.shape) for part in self.parts}

    @cached_property
    def groups(self) -> list[np.ndarray]:
        """Indices of the parameters whose tolerances share a scale that evidence may change."""
        result = []
        for part in self.parts:
            numbers = part.family.groups(part.shape).ravel()[part.elements]
            start = self.blocks[part.family.id].start
            result += [start + np.flatnonzero(numbers == number) for number in np.unique(numbers)]
        return result

    @cached_property
    def fine_structure(self) -> np.ndarray:
        """Which parameters (p,) are fine structure (`Family.fine`), bool."""
        fine = np.zeros(self.count, dtype=bool)
        for part in self.parts:
            of_part = part.family.fine(part.shape).ravel()
            fine[self.blocks[part.family.id]] = of_part[part.elements]
        return fine

    @property
    def count(self) -> int:
        """Number of parameters."""
        return int(self.blocks["targets"].stop)

    @cached_property
    def names(self) -> list[str]:
        """One name per parameter: ζ3.x, ξ2.rz, q1, sin2q4, gravity2,
        backlash1, base.x, target1.z.
        """
        return self._names([part.family.symbol for part in self.parts])

    @cached_property
    def ids(self) -> list[str]:
        """The same in ASCII: zeta3.x, xi2.rz, …"""
        return self._names([part.family.ascii for part in self.parts])

    def _names(self, symbols: list[str]) -> list[str]:
        names = []
        for part, symbol in zip(self.parts, symbols, strict=True):
            every = part.family.names_of(self.robot, part.shape, symbol)
            names += [every[i] for i in part.elements]
        names += [f"base.{c}" for c in COMPONENTS] if self.frame_free else []
        return names + list(self.targets)

    @cached_property
    def positive(self) -> np.ndarray:
        """Which parameters cannot be below zero: (p,) bool."""
        positive = np.zeros(self.count, dtype=bool)
        for part in self.parts:
            positive[self.blocks[part.family.id]] = part.family.positive
        return positive

    def without(self, *families: str) -> Self:
        """The same parameters without these families."""
        return replace(
            self, parts=tuple(part for part in self.parts if part.family.id not in families)
        )

    def only(self, kept: np.ndarray) -> Self:
        """Some of the parameters, kept (p,) bool; base and targets always."""
        parts = [part.only(kept[self.blocks[part.family.id]]) for part in self.parts]
        return replace(self, parts=tuple(part for part in parts if part is not None))

    @cached_property
    def sections(self) -> list[tuple[Family, np.ndarray]]:
        """Families and indices (k,) of parameters that are chosen together; not of those that are
        always identified.
        """
        result = []
        for part in self.parts:
            numbers = part.family.sections(part.shape).ravel()[part.elements]
            start = self.blocks[part.family.id].start
            for number in [] if part.family.always else np.unique(numbers):
                result.append((part.family, start + np.flatnonzero(numbers == number)))
        return result

    def missing_in(self, other: Self) -> np.ndarray:
        """Indices (k,) of the parameters that `other` does not have."""
        kept = set(other.names)
        return np.array([i for i, name in enumerate(self.names) if name not in kept], dtype=int)

    def prior_std(self, tolerances: Tolerances | None = None) -> Array:
        """Prior standard deviation of every parameter (p,), SI; by default the
        robot's tolerances.
        """
        stated = tolerances or Tolerances.of_robot(self.robot)
        parts = [
            p.family.tolerance(self.robot, stated, p.shape).ravel()[p.elements] for p in self.parts
        ]
        return np.concatenate([*parts, np.full(6 * self.frame_free + len(self.targets), _FREE)])

    def largest_std(self, tolerances: Array) -> Array:
        """Upper limits (p,) for tolerances estimated from the evidence."""
        largest = np.full(self.count, np.inf)
        for part in self.parts:
            if not part.family.grows:
                largest[self.blocks[part.family.id]] = tolerances[self.blocks[part.family.id]]
        return largest

    def display(self) -> tuple[Array, list[str]]:
        """Factor (p,) and unit in which each parameter is displayed."""
        factors, units = [], []
        for part in self.parts:
            factor, unit = part.family.display(self.robot, part.shape)
            factors.append(factor.ravel()[part.elements])
            units += [unit[i] for i in part.elements]
        units += ["mm"] * 3 + ["mrad"] * 3 if self.frame_free else []
        units += [_unit(name) for name in self.targets]
        return np.concatenate(
            [*factors, np.full(6 * self.frame_free + len(self.targets), 1e3)]
        ), units

    @property
    def family_words(self) -> list[str | None]:
        """Description of the family of each parameter; None for base and targets."""
        every: list[str | None] = [part.family.words for part in self.parts for _ in part.elements]
        return every + [None] * (self.count - len(every))

    def function_parts(self) -> list[tuple[Part, slice]]:
        """Families whose columns are those of the joint offsets times functions of a row, and
        where they stand.
        """
        return [
            (p, self.blocks[p.family.id])
            for p in self.parts
            if isinstance(p.family, JointFunctions)
        ]

    def pose_columns(self, context: Context, functions: bool = True) -> Array:
        """∂δy/∂θ without the targets (N, 6, p − targets); without `functions`, those of
        `function_parts` are left out.
        """
        parts = [p for p in self.parts if functions or not isinstance(p.family, JointFunctions)]
        blocks = [part.family.columns(part.shape, context)[:, :, part.elements] for part in parts]
        if self.frame_free:
            blocks.append(np.broadcast_to(np.eye(6), (len(context.moved), 6, 6)))
        return np.concatenate(blocks, axis=-1)


@dataclass(frozen=True, eq=False)
class State:
    """State of an iteration: errors of the robot and set-up.

    setup_moved  (k,) sum of the steps of base and targets, by which the set-up has left the
                 registration; none at the registration itself
    """

    errors: RobotErrors
    setup: Setup
    setup_moved: Array | None = None

    @classmethod
    def nominal(cls, robot: Robot, setup: Setup) -> Self:
        """No errors in a set-up."""
        return cls(RobotErrors.of(robot), setup)

    def frames(self, q: Array, conditions: Conditions | None = None) -> Frames:
        """Frames of the robot with these errors for commanded q (N, n)."""
        return self.errors.frames(q, conditions)

    def vector(self, parameters: Parameters) -> Array:
        """θ as the prior sees it (p,); base and targets from where they were registered."""
        values = [
            p.family.resized(self.errors[p.family.id], p.shape).ravel()[p.elements]
            for p in parameters.parts
        ]
        return np.concatenate([*values, self._setup_moved(parameters)])

    def _setup_moved(self, parameters: Parameters) -> Array:
        if self.setup_moved is None:
            return np.zeros(6 * parameters.frame_free + len(parameters.targets))
        return self.setup_moved

    def moved(self, parameters: Parameters, step: Array) -> Self:
        """The state after a step of the parameters (p,)."""
        steps = {}
        for part in parameters.parts:
            steps[part.family.id] = np.zeros(part.shape)
            steps[part.family.id].flat[part.elements] = step[parameters.blocks[part.family.id]]
        blocks = parameters.blocks
        setup = update_setup(
            self.setup,
            step[blocks["base"]] if parameters.frame_free else None,
            step[blocks["targets"]] if parameters.targets else None,
        )
        moved = self._setup_moved(parameters) + step[blocks["base"].start :]
        return replace(self, errors=self.errors.moved(**steps), setup=setup, setup_moved=moved)

    def kept(self, parameters: Parameters) -> Self:
        """The state with only these parameters."""
        values = {}
        for part in parameters.parts:
            value = part.family.resized(self.errors[part.family.id], part.shape)
            values[part.family.id] = np.where(part.free, value, 0.0)
        return replace(self, errors=RobotErrors.of(self.errors.robot, **values))


def _unit(name: str) -> str:
    """Unit in which an element of the set-up is displayed: 1e-3 of m, rad or 1."""
    if name.startswith("lens."):
        return "‰"
    return "mrad" if name.endswith(_TURNS) else "mm"
