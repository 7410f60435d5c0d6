"""Base class of kinds whose instrument has its own frame, one for every place at which it stood."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibtool.errormodel.family import COMPONENTS
from calibtool.measurement.kinds.kind import Kind, of_place, places_of
from calibtool.robot.se3 import Array, exp6, readonly

if TYPE_CHECKING:
    from calibtool.measurement.setup import Setup


class InstrumentKind(Kind):
    """Coordinates, and free elements on the tool, are in K_0, three by three.

    The frame of the first place is the set-up's. A step of the base moves all frames; those of
    further places have a twist of their own in addition.
    """

    @abstractmethod
    def on_tool(self, points: int) -> tuple[str, ...]:
        """Names (d,) of the elements on the tool, as many as coordinates of a row."""

    @abstractmethod
    def moved_on_tool(self, setup: Setup, step: Array) -> Setup:
        """The set-up after a step (d,) of the elements on the tool: displacements and
        left-multiplied rotations in the tool frame.
        """

    def coordinates(self, setup: Setup) -> int:
        return len(self.on_tool(len(setup.targets)))

    def names(self, setup: Setup) -> tuple[str, ...]:
        on_tool = () if setup.targets_known else self.on_tool(len(setup.targets))
        places = [f"base{g + 2}.{c}" for g in range(_further(setup)) for c in COMPONENTS]
        return (*on_tool, *places)

    def columns(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        count, d = len(T_base_tool), self.coordinates(setup)
        blocks = [np.zeros((count, d, 0))]
        if not setup.targets_known:
            turned = np.zeros((count, d // 3, 3, d // 3, 3))
            for block in range(d // 3):
                turned[:, block, :, block, :] = T_base_tool[:, :3, :3]
            blocks.append(turned.reshape(count, d, d))
        if _further(setup):
            matrix = self.matrix(setup, T_base_tool)
            own = places_of(place, count)
            blocks += [matrix * (own == g + 1)[:, None, None] for g in range(_further(setup))]
        return np.concatenate(blocks, axis=-1)

    def moved(self, setup: Setup, step: Array) -> Setup:
        if not setup.targets_known:
            d = self.coordinates(setup)
            setup, step = self.moved_on_tool(setup, step[:d]), step[d:]
        if setup.further_frames is not None:
            frames = setup.further_frames @ exp6(step.reshape(-1, 6))
            setup = replace(setup, further_frames=readonly(frames))
        return setup

    def in_axes(self, setup: Setup, rows: Array, place: np.ndarray | None) -> Array:
        count, d, k = rows.shape
        turns = of_place(setup.frames[:, :3, :3], place, count)[:, None]
        turned: Array = turns @ rows.reshape(count, d // 3, 3, k)
        return turned.reshape(count, d, k)


def _further(setup: Setup) -> int:
    """Number of places beyond the first whose frame is free."""
    return 0 if setup.further_frames is None else len(setup.further_frames)
