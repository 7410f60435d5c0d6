"""A gauge with two sockets into which a tip is put."""

import numpy as np

from calibtool.measurement.instruments.cell import (
    TIP,
    Cell,
    Observed,
    labels,
    shares,
    tip,
    touching,
)
from calibtool.measurement.kinds import Readings
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import exp6, inverse, readonly, transform_points

GAUGE = 0.05  # m between the two sockets of the gauge


def contact(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """A tip put into the two sockets of a gauge that is placed at several places.

    The measured points are the exact sockets in the gauge's frame; the tip differs from them by the
    noise.
    """
    q, points, place, frames = [], [], [], []
    starts = cell.apart(places, rng)
    for g, rows in enumerate(shares(count, places)):
        start = starts[g]
        T_base_gauge = exp6(np.concatenate([np.zeros(3), rng.normal(size=3)]))
        T_base_gauge[:3, 3] = tip(cell, start)
        socket = rng.permutation(np.arange(rows) % 2)
        in_gauge = np.zeros((rows, 3))
        in_gauge[:, 0] = (GAUGE if cell.gauge is None else cell.gauge) * socket
        for k in range(2):
            chosen = np.flatnonzero(socket == k)
            at = transform_points(T_base_gauge, in_gauge[chosen[:1]])[0]
            own = cell.driven(len(chosen), rng, start, touching(cell, start, at, rng))
            q.append(own)
            points.append(in_gauge[chosen])
            place.append(np.full(len(chosen), g))
        frames.append(inverse(T_base_gauge))
    setup = Setup(
        readonly(frames[0]),
        readonly(TIP[None]),
        frame_known=False,
        targets_known=False,
        further_frames=readonly(np.array(frames[1:])) if places > 1 else None,
    )
    points_in_gauge = np.concatenate(points)[:, None]
    readings = Readings(points_in_gauge, place=np.concatenate(place) if places > 1 else None)
    return Observed(np.concatenate(q), setup, readings, labels("placement", places))
