"""A tip put onto planes and spheres."""

import numpy as np

from calibtool.measurement.instruments.cell import TIP, Cell, Observed, labels, shares, tilted, tip
from calibtool.measurement.kinds import Readings
from calibtool.measurement.measurements import Setup
from calibtool.robot.se3 import Array, exp6, readonly


def plane_probe(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """A tip put onto planes of 0.4 m: heights of zero, but for the noise of the contact."""
    q, place, planes = [], [], []
    starts = cell.apart(places, rng)
    for g, rows in enumerate(shares(count, places)):
        start = starts[g]
        centre, T = tip(cell, start), exp6(np.concatenate([np.zeros(3), rng.normal(size=3)]))

        def drawn(k: int, start: Array = start, centre: Array = centre, T: Array = T) -> Array:
            on_plane = np.concatenate([rng.uniform(-0.2, 0.2, (k, 2)), np.zeros((k, 1))], axis=-1)
            at = centre + on_plane @ T[:3, :3].T
            return tilted(cell, start, at, rng)

        q.append(cell.driven(rows, rng, start, drawn))
        place.append(np.full(rows, g))
        planes.append([*T[:3, 2], float(T[:3, 2] @ centre)])
    heights = rng.normal(size=(count, 1)) * cell.noise
    setup = Setup(
        readonly(np.eye(4)),
        readonly(TIP[None]),
        frame_known=False,
        targets_known=False,
        planes=readonly(np.array(planes)),
    )
    readings = Readings(
        np.full((count, 1, 3), np.nan), None, heights, np.concatenate(place) if places > 1 else None
    )
    return Observed(np.concatenate(q), setup, readings, labels("plane", places))
