"""A tip put onto planes and spheres."""

import numpy as np

from calibtool.measurement.instruments.cell import TIP, Cell, Observed, labels, shares, tilted, tip
from calibtool.measurement.kinds import Readings
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import Array, exp6, transform_points

RADIUS = 0.08  # m, of a sphere and the tip
_EDGE = 0.4  # m, of a plane


def plane_probe(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """A tip put onto planes of 0.4 m: heights of zero plus the noise of the contact.

    With a gauge block, about half of the contacts are on its top.
    """
    q, place, planes, heights = [], [], [], []
    starts = cell.apart(places, rng)
    for g, rows in enumerate(shares(count, places)):
        start = starts[g]
        centre, T = tip(cell, start), exp6(np.concatenate([np.zeros(3), rng.normal(size=3)]))

        def drawn(k: int, start: Array = start, centre: Array = centre, T: Array = T) -> Array:
            on_plane = np.concatenate(
                [rng.uniform(-_EDGE / 2, _EDGE / 2, (k, 2)), np.zeros((k, 1))], axis=-1
            )
            if cell.gauge is not None:
                on_plane[:, 2] = cell.gauge * (rng.random(k) < 0.5)
            at = centre + on_plane @ T[:3, :3].T
            return tilted(cell, start, at, rng)

        def gap(
            points: Array, centre: Array = centre, T: Array = T
        ) -> tuple[Array, Array, np.ndarray]:
            at = (points - centre) @ T[:3, :3]
            height = at[:, 2]
            if cell.gauge is not None:  # half of them on the block
                height = height - cell.gauge * (np.arange(len(at)) % 2)
            used = np.abs(at[:, :2]).max(axis=-1) < _EDGE / 2
            return height, np.broadcast_to(T[:3, 2], at.shape), used

        every = cell.robot.n >= 6
        q.append(cell.driven(rows, rng, start, drawn) if every else cell.on_surface(rows, rng, gap))
        place.append(np.full(rows, g))
        planes.append([*T[:3, 2], float(T[:3, 2] @ centre)])
        touched = transform_points(cell.actual.forward(q[-1]), TIP[None])[:, 0]
        above = (touched - centre) @ T[:3, 2]
        heights.append(
            np.zeros(rows) if not cell.gauge else cell.gauge * np.round(above / cell.gauge)
        )
    read = np.concatenate(heights)[:, None] + rng.normal(size=(count, 1)) * cell.noise
    setup = Setup.unknown(TIP[None], planes=np.array(planes))
    readings = Readings(
        np.full((count, 1, 3), np.nan), None, read, np.concatenate(place) if places > 1 else None
    )
    return Observed(np.concatenate(q), setup, readings, labels("plane", places))


def sphere_probe(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """A tip put onto spheres of 80 mm: their radii are unknown, like that of the tip."""
    q, place, spheres = [], [], []
    starts = cell.apart(places, rng)
    for g, rows in enumerate(shares(count, places)):
        start = starts[g]
        centre = tip(cell, start)

        def drawn(k: int, start: Array = start, centre: Array = centre) -> Array:
            away = rng.normal(size=(k, 3))
            away *= RADIUS / np.linalg.norm(away, axis=-1, keepdims=True)
            return tilted(cell, start, centre + away, rng)

        def gap(points: Array, centre: Array = centre) -> tuple[Array, Array, np.ndarray]:
            away = points - centre
            distance = np.linalg.norm(away, axis=-1)
            normal = away / np.maximum(distance, 1e-12)[:, None]
            return distance - RADIUS, normal, np.ones(len(away), dtype=bool)

        every = cell.robot.n >= 6
        q.append(cell.driven(rows, rng, start, drawn) if every else cell.on_surface(rows, rng, gap))
        place.append(np.full(rows, g))
        spheres.append([*centre, RADIUS])
    gaps = rng.normal(size=(count, 1)) * cell.noise
    setup = Setup.unknown(TIP[None], spheres=np.array(spheres))
    own = np.concatenate(place) if places > 1 else None
    readings = Readings(np.full((count, 1, 3), np.nan), None, gaps, own)
    return Observed(np.concatenate(q), setup, readings, labels("sphere", places))
