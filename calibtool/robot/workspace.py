"""A workspace: the part of its joint range in which an arm is measured and works."""

from dataclasses import dataclass, field

import numpy as np

from calibtool.robot.se3 import Array, readonly

_EVERYWHERE = readonly(np.full(3, np.inf))


@dataclass(frozen=True, eq=False)
class Workspace:
    """A box and an orientation cone round the tool pose at `home`, or the whole joint range.

    name   as in robot.toml; `full` is the whole joint range
    home   (n,) joint positions in its middle, rad or m
    box    (3,) full edge lengths along the base axes K_0, m; infinite: the whole joint range
    cone   half angle that the tool axis may tilt, rad
    roll   largest turn about the tool's z axis either way, rad
    """

    name: str
    home: Array
    box: Array = field(default_factory=lambda: _EVERYWHERE)
    cone: float = np.pi
    roll: float = np.pi

    @property
    def bounded(self) -> bool:
        """Whether it is a box and a cone, not the whole joint range."""
        return bool(np.isfinite(self.box).all())
