"""Errors of a robot, {family: value}, and the kinematics with them; nothing is linearised."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from calibtool.errormodel.families import BY_ID, FAMILIES
from calibtool.errormodel.family import Context, Family, Rows
from calibtool.errormodel.operating_conditions import Conditions
from calibtool.robot.mechanism import Frames, Mechanism
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6


@dataclass(frozen=True, eq=False)
class RobotErrors:
    """One value per family (`Family.shape`), zero where the robot has no such error.

    Joint positions q (N, n) are commanded ones, in rad or m; poses are in K_0.
    """

    robot: Robot
    values: Mapping[str, Array]

    @classmethod
    def of(cls, robot: Robot, **values: Array) -> Self:
        """Errors of some families by id, none of the others.

        ValueError for a value of another shape.
        """
        if unknown := set(values) - set(BY_ID):
            raise ValueError(f"unknown families of errors: {', '.join(sorted(unknown))}")
        return cls(
            robot,
            {
                family.id: family.value(family.joints(robot), values.get(family.id))
                for family in FAMILIES
            },
        )

    def __getitem__(self, family: str) -> Array:
        return self.values[family]

    def having(self, **values: Array) -> Self:
        """The same errors with other values of these families."""
        return type(self).of(self.robot, **{**self.values, **values})

    def without(self, *families: str) -> Self:
        """The same errors but none of these families."""
        return type(self).of(
            self.robot,
            **{name: value for name, value in self.values.items() if name not in families},
        )

    def moved(self, **steps: Array) -> Self:
        """The errors after steps (`Family.moved`) of some families, perhaps of other orders."""
        values = {}
        for name, step in steps.items():
            family = BY_ID[name]
            values[name] = family.moved(family.resized(self.values[name], step.shape), step)
        return self.having(**values)

    @cached_property
    def present(self) -> list[Family]:
        """Families whose value is not zero."""
        return [family for family in FAMILIES if self.values[family.id].any()]

    @cached_property
    def beyond_geometry(self) -> list[Family]:
        """Those of the present families that `mechanism` does not hold."""
        return [family for family in self.present if family.kind != "geometric"]

    @cached_property
    def mechanism(self) -> Mechanism:
        """Kinematics without joint motions, payload and temperature."""
        twists, offset = self.twists, np.zeros(self.robot.n)
        for family in FAMILIES:
            offset = offset + family.offset(self.values[family.id])
        return self.robot.chain.mechanism_of(self._placements(None), twists, offset)

    def standing(self, conditions: Conditions) -> Mechanism:
        """The kinematics at one temperature, without joint motions and payload."""
        rows = Rows(self.robot, np.zeros((1, self.robot.n)), conditions)
        placements = self._placements(rows, turns=False)
        if placements.ndim == 3:
            return self.mechanism
        return replace(self.mechanism, placements=placements).at_row(0)

    @property
    def twists(self) -> Array:
        """ξ_j with their errors (n, 6), per rad or m."""
        twists = self.robot.chain.twists
        for family in FAMILIES:
            twists = family.twisted(self.values[family.id], twists)
        return twists

    def motion(self, q: Array, conditions: Conditions | None = None) -> Array:
        """Joint motion errors δq(q) (N, n) without the constant offsets, rad or m."""
        return self._motion(Rows(self.robot, q, conditions or Conditions()))

    def at(self, q: Array, conditions: Conditions | None = None) -> tuple[Mechanism, Array]:
        """Kinematics at these rows, and the joint positions (N, n) that its joints take."""
        return self._at(Rows(self.robot, q, conditions or Conditions()))

    def forward(self, q: Array, conditions: Conditions | None = None) -> Array:
        """T_base_tool (N, 4, 4)."""
        mechanism, driven = self.at(q, conditions)
        return mechanism.forward(driven)

    def frames(self, q: Array, conditions: Conditions | None = None) -> Frames:
        """Every frame of the chain."""
        mechanism, driven = self.at(q, conditions)
        return mechanism.frames(driven)

    def context(self, q: Array, conditions: Conditions | None = None) -> Context:
        """Frames and positions from which columns are built."""
        rows = Rows(self.robot, q, conditions or Conditions())
        mechanism, driven = self._at(rows)
        return Context(rows, mechanism.frames(driven), driven + mechanism.offsets, self.twists)

    def _at(self, rows: Rows) -> tuple[Mechanism, Array]:
        if not self.beyond_geometry:
            return self.mechanism, rows.q
        driven = rows.q + self._motion(rows)
        if not any(family.by_row for family in self.present):
            return self.mechanism, driven
        placements = self._placements(rows)
        return self.mechanism if placements.ndim == 3 else replace(
            self.mechanism, placements=placements
        ), driven

    def _motion(self, rows: Rows) -> Array:
        motion = np.zeros(rows.q.shape)
        for family in self.beyond_geometry:
            motion += family.motion(self.values[family.id], rows)
        return motion

    def _placements(self, rows: Rows | None, turns: bool = True) -> Array:
        """M_j with their errors (n+1, 4, 4), or (N, n+1, 4, 4) where they change from row to
        row."""
        placements = self.robot.chain.placements
        for family in reversed(FAMILIES):
            if family is FAMILIES[0] and turns and rows is not None:
                placements = self._turned(placements, rows)
            placements = family.placed(self.values[family.id], placements, rows)
        return placements

    def _turned(self, placements: Array, rows: Rows) -> Array:
        """Placements with the turns of all families."""
        turns = sum(f.turn(self.values[f.id], rows) for f in self.present if f.turns)
        if np.ndim(turns) == 0:
            return placements
        twists = np.zeros((*np.shape(turns)[:2], 6))
        twists[..., 3:] = turns
        result = np.broadcast_to(placements, (len(twists), *placements.shape[-3:])).copy()
        result[:, :-1] = result[:, :-1] @ exp6(twists)
        return result
