"""The actual robot of a simulation, and how its errors are drawn."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from calibtool.errormodel.families import ERROR_KINDS, FAMILIES
from calibtool.errormodel.family import Sizes
from calibtool.errormodel.operating_conditions import REFERENCE_C, Conditions, directions
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import check_choice, check_number
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly


@dataclass(frozen=True)
class ErrorScales:
    """Magnitudes of the simulated errors, in SI; a kind that is not in `kinds` is absent.

    length, angle  standard deviation of every element of δζ, δξ, δq: m and rad (a prismatic
                   offset is a length)
    sizes          by kind, where it differs from that of the family: gear, the standard deviation
                   of each coefficient; gravity and payload, the angle of a joint at its largest
                   torque (at 10 kg); backlash, the half width; thermal, the expansion per K
    warmth         temperature above the reference in K, with thermal errors
    """

    kinds: tuple[str, ...] = ("geometric",)
    length: float = 0.5e-3
    angle: float = 0.5e-3
    sizes: Mapping[str, float] = field(default_factory=dict)
    warmth: float = 10.0

    def __post_init__(self) -> None:
        for kind in (*self.kinds, *self.sizes):
            check_choice(kind, ERROR_KINDS, "kind of error")
        for name, size in {"length": self.length, "angle": self.angle, **self.sizes}.items():
            check_number(size, name, 0)

    @classmethod
    def of(
        cls, kinds: tuple[str, ...], sizes: Mapping[str, float], factor: float = 1.0
    ) -> "ErrorScales":
        """Sizes by the names of the options of `simulate`, such as `gear_mrad`, times a factor."""
        milli = 1e-3 * factor
        return cls(
            kinds=kinds,
            length=sizes["length_error_mm"] * milli,
            angle=sizes["angle_error_mrad"] * milli,
            sizes={
                kind: sizes[f"{kind}_mrad"] * milli
                for kind in ("gear", "gravity", "backlash", "payload")
            },
            warmth=sizes["thermal_k"] * factor,
        )


@dataclass(frozen=True, eq=False)
class ActualRobot:
    """A robot whose geometry and joint motions differ from nominal; exact, nothing is linearised.

    temperature_c  °C of its links where a row does not state its own
    """

    errors: RobotErrors
    temperature_c: float = REFERENCE_C

    @property
    def robot(self) -> Robot:
        """The nominal robot."""
        return self.errors.robot

    @cached_property
    def mechanism(self) -> Mechanism:
        """Kinematics at `temperature_c`, without joint motion errors and payload."""
        return self.errors.standing(self._conditions(Conditions()))

    @property
    def model(self) -> pin.Model:
        """The geometry as a new Pinocchio model with joint limits.

        `mechanism.configuration` computes its coordinates. Errors that depend on joint positions or
        on time (gear, gravity, backlash) are not included: see `forward`.
        """
        return self.mechanism.as_model(self.robot.lower, self.robot.upper)

    def directions(self, q: Array) -> Array:
        """Directions (N, n) of each joint's last motion when driven through q (N, n) in order, from
        home.
        """
        return directions(q, start=self.robot.workspace().home)

    def forward(self, q: Array, conditions: Conditions | None = None) -> Array:
        """Actual T_base_tool (N, 4, 4) in K_0 for commanded joints q (N, n), rad or m, in the order
        of the rows.

        The order gives the directions of motion, the first row comes from home; payload and
        temperature are those of the conditions.
        """
        return self.errors.forward(q, self.driven_to(q, conditions))

    def driven_to(self, q: Array, conditions: Conditions | None = None) -> Conditions:
        """Conditions of rows q (N, n) that are driven to in order."""
        return replace(
            self._conditions(conditions or Conditions()), direction=readonly(self.directions(q))
        )

    def _conditions(self, conditions: Conditions) -> Conditions:
        if conditions.temperature_c is not None:
            return conditions
        return replace(conditions, temperature_c=readonly(self.temperature_c))


def random_actual(robot: Robot, scales: ErrorScales, rng: np.random.Generator) -> ActualRobot:
    """Draw an actual robot.

    Every kind of error has its own random stream, so that a new kind does not change the others.
    """
    streams = dict(zip(ERROR_KINDS, rng.spawn(len(ERROR_KINDS)), strict=True))
    drawn = {}
    for family in FAMILIES:
        if family.kind in scales.kinds:
            sizes = Sizes(scales.length, scales.angle, scales.sizes.get(family.kind, family.size))
            drawn[family.id] = family.drawn(robot, sizes, streams[family.kind])
    warm = "thermal" in scales.kinds
    return ActualRobot(
        RobotErrors.of(robot, **drawn), REFERENCE_C + scales.warmth if warm else REFERENCE_C
    )
