"""Contents of a view: the arm at every configuration, nominal and found targets."""

from dataclasses import dataclass

import numpy as np

from calibtool.calibration import Calibration
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import measured_in_base
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly, transform_points
from calibtool.robot.skeleton import skeleton


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything in K_0 and m, one entry per configuration; points are not magnified.

    q        (N, n) joint positions, rad or m
    arm      (N, 2n+2, 3) base, every joint before and after its motion, tool: origins on
             the nominal robot; with closed loops (N, s, 3), see `skeleton`
    nominal  (N, m, 3) target points on the nominal robot
    found    (N, m, 3) the same, measured or predicted; NaN where a target was not seen
    meaning  what `found` is: `measured` or `calibrated`
    """

    robot: Robot
    q: Array
    arm: Array
    nominal: Array
    found: Array
    meaning: str

    def __len__(self) -> int:
        return len(self.arm)

    @property
    def extent(self) -> float:
        """Longest edge, along an axis of K_0, of the box round all positions of the arm, m."""
        return float(np.ptp(self.arm.reshape(-1, 3), axis=0).max())

    @property
    def error_rms(self) -> Array:
        """Error of every configuration: length, RMS over the seen targets. (N,) m"""
        squared = ((self.found - self.nominal) ** 2).sum(axis=-1)
        seen = ~np.isnan(squared)
        mean: Array = np.where(seen, squared, 0.0).sum(axis=-1) / np.maximum(seen.sum(axis=-1), 1)
        return np.sqrt(mean)

    def magnified(self, factor: float) -> Array:
        """`found` with the errors enlarged: (N, m, 3)."""
        return self.nominal + factor * (self.found - self.nominal)

    @property
    def fitting_factor(self) -> float:
        """A round factor that makes the median error about a twelfth of the scene's size."""
        median = float(np.median(self.error_rms))
        if median <= 0 or self.extent <= 0:
            return 1.0
        wanted = self.extent / 12 / median
        power = 10.0 ** np.floor(np.log10(wanted))
        return float(
            max(power * max(step for step in (1, 2, 5) if step * power <= wanted * (1 + 1e-9)), 1.0)
        )


def scene_of(contents: Measurements | Calibration) -> Scene:
    """Measured or predicted targets beside those of the nominal robot."""
    robot, q = contents.robot, contents.q
    nominal_pose = robot.mechanism.forward(q)
    if isinstance(contents, Measurements):
        targets, meaning = contents.setup.targets, "measured"
        found = measured_in_base(contents, contents.setup).points
    else:
        targets, meaning = contents.setup.targets, "calibrated"
        found = transform_points(contents.forward(q), targets)
    return Scene(
        robot=robot,
        q=q,
        arm=readonly(skeleton(robot.mechanism.frames(q), robot.chain.placed_on)),
        nominal=readonly(transform_points(nominal_pose, targets)),
        found=readonly(found),
        meaning=meaning,
    )
