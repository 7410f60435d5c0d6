"""Draw-wire encoders that pull at one point of the tool."""

import numpy as np

from calibtool.measurement.instruments.cell import TIP, Cell, Observed
from calibtool.measurement.kinds import Readings
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import Array, transform_points


def wires(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """Draw-wire encoders, as many as places, that pull at one point of the tool from an arm's
    length, three at a time from directions at right angles.
    """
    q = cell.sampled(count, rng)
    centre = cell.robot.mechanism.forward(q)[:, :3, 3].mean(axis=0)
    anchors = centre + cell.robot.length * _directions(places, rng)
    points = transform_points(cell.actual.forward(q), TIP[None])
    lengths = np.linalg.norm(points - anchors, axis=-1)
    lengths = lengths + rng.normal(size=lengths.shape) * cell.noise
    setup = Setup.unknown(TIP[None], anchors=anchors)
    return Observed(q, setup, Readings(np.full((count, 1, 3), np.nan), None, lengths))


def _directions(count: int, rng: np.random.Generator) -> Array:
    """Unit vectors (count, 3): wires that pull from one side tell little of the other two."""
    thirds = [np.linalg.qr(rng.normal(size=(3, 3)))[0].T for _ in range(0, count, 3)]
    return np.concatenate(thirds)[:count]
