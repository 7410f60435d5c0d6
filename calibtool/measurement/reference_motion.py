"""Motion of the instrument relative to the base, from repeated readings of fixed points."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from calibtool.robot.se3 import Array, exp6, point_columns, readonly

_MOST_KNOTS = 100  # with more readings than this, neighbouring ones are averaged
# of twice a log-likelihood ratio, by how many parts more: 1 in 1,000 of χ²
_CLEAR = (0.0, 10.8, 13.8)
_STATED = 4.0  # the stated noise counts like one that was estimated from this number of readings
_ROUNDS = 10
_GROSS = 8.0  # times the noise: largest distance from the median of five successive readings


@dataclass(frozen=True, eq=False)
class ReferencePoints:
    """M readings of k points fixed to the base.

    times   (M,) s, or numbers of rows
    points  (M, k, 3) in the instrument's frame, m; NaN for a point that was not read
    """

    times: Array
    points: Array

    def ordered(self) -> Self:
        """Sorted by time, without empty readings; 0, 0, 0 counts as not read."""
        unread = np.isnan(self.points).any(axis=-1) | (self.points == 0.0).all(axis=-1)
        points = np.where(unread[..., None], np.nan, self.points)
        kept = np.flatnonzero(np.isfinite(self.times) & ~unread.all(axis=1))
        kept = kept[np.argsort(self.times[kept], kind="stable")]
        return type(self)(self.times[kept], points[kept])

    def without_gross(self, noise: float) -> tuple[Self, int]:
        """The same without points far from where they were before and after, and the number of
        these points.

        noise: standard deviation of a coordinate, m. Points read fewer than five times are kept.
        """
        points, dropped = self.points.copy(), 0
        for i in range(points.shape[1]):
            rows = np.flatnonzero(np.isfinite(points[:, i, 0]))
            if len(rows) < 5:
                continue
            path = points[rows, i]
            windows = np.lib.stride_tricks.sliding_window_view(path, 5, axis=0)
            middle = np.median(windows, axis=-1)
            middle = np.concatenate([middle[[0, 0]], middle, middle[[-1, -1]]])
            away = np.linalg.norm(path - middle, axis=-1)
            gross = away > _GROSS * max(noise, float(np.median(away)))
            points[rows[gross], i] = np.nan
            dropped += int(gross.sum())
        return type(self)(self.times, points).ordered(), dropped


@dataclass(frozen=True, eq=False)
class InstrumentMotion:
    """Motion of points fixed to the base in the instrument's frame since they were first read.

    A point p moves to R (p − c) + c + v, (v, w) the twist at that time and R = exp(w). Between
    knots the twist is interpolated, outside them it is constant.

    times       (K,) of the knots, as in `ReferencePoints`
    twists      (K, 6) v in m and w in rad, axes of the instrument; zero without significant motion
    covariance  (K, 6, 6) of them
    centre      (3,) c, the middle of the points at first, m
    noise       standard deviation of a coordinate of a reading, m
    ratio       twice the log-likelihood ratio of motion against none
    """

    times: Array
    twists: Array
    covariance: Array
    centre: Array
    noise: float
    ratio: float

    @property
    def found(self) -> bool:
        """Whether the readings show a significant motion."""
        return bool(self.twists.any())

    def at(self, times: Array) -> Array:
        """Twists (N, 6) at times (N,)."""
        return np.stack([np.interp(times, self.times, part) for part in self.twists.T], axis=1)

    def moved_back(
        self, times: Array, points: Array, rotations: Array | None = None
    ) -> tuple[Array, Array | None]:
        """Points (N, m, 3) and orientations (N, 3, 3) measured at times (N,), as they would have
        been measured at the first knot.
        """
        twists = self.at(times)
        R = _rotations(twists[:, 3:])
        shifted = points - self.centre - twists[:, None, :3]
        back = shifted @ R + self.centre  # Rᵀ x of row vectors
        return back, None if rotations is None else np.swapaxes(R, 1, 2) @ rotations

    def deviation(self, points: Array) -> float:
        """Largest standard deviation of the correction at points (P, 3), rms over them, m."""
        J = point_columns(points - self.centre)
        variances = np.einsum("pai,kij,paj->kp", J, self.covariance, J)
        return float(np.sqrt(variances.mean(axis=1).max(initial=0.0)))


def instrument_motion(references: ReferencePoints, noise: float) -> InstrumentMotion:
    """Motion from readings of fixed points, ordered by time.

    The readings are y_i = R (p_i − c) + c + v + noise. v and w are Brownian motions. Their sizes
    maximise the likelihood from which p_i and, with the stated noise (m) as its prior, the noise
    are integrated out. Translation and rotation are used only where the likelihood requires them,
    by chance in 1 of 1,000 cases.
    """
    times, points = _knots(references)
    reading = _Readings.of(times, points, noise)
    still = np.zeros((len(times), 6))
    tried = {choice: reading.maximum(choice, still) for choice in reading.choices}
    free: tuple[int, ...] = ()
    for choice, (likelihood, _) in tried.items():
        if 2 * (likelihood - tried[free][0]) > _CLEAR[len(choice) - len(free)]:
            free = choice
    twists, covariance, spread = reading.solved(free, tried[free][1])
    if free:  # again about what was found: large turns are not linear
        sizes = reading.maximum(free, twists)[1]
        twists, covariance, spread = reading.solved(free, sizes)
    return InstrumentMotion(
        readonly(times),
        readonly(twists),
        readonly(covariance),
        readonly(reading.centre),
        spread,
        2 * (tried[free][0] - tried[()][0]),
    )


def _knots(references: ReferencePoints) -> tuple[Array, Array]:
    """Times (K,) and points (K, k, 3): readings at the same time are averaged, and neighbours where
    there are too many.
    """
    instants, group = np.unique(references.times, return_inverse=True)
    group = group * min(len(instants), _MOST_KNOTS) // len(instants)
    times, points = [], []
    for number in range(int(group.max()) + 1):
        rows = group == number
        seen = np.isfinite(references.points[rows])
        total = np.where(seen, references.points[rows], 0.0).sum(axis=0)
        count = seen.sum(axis=0)
        points.append(np.where(count > 0, total / np.maximum(count, 1), np.nan))
        times.append(references.times[rows].mean())
    return np.array(times), np.array(points)


@dataclass(frozen=True, eq=False)
class _Readings:
    """The linear model of the readings: unknowns are the twists of the second to last knot, of the
    parts that are free (0 translation, 1 rotation), and the fixed points.

    points  (K, k, 3) in the instrument's frame, m; NaN for a point that was not read
    centre  (3,) middle of the points as they were first read
    arms    (k, 3) from it to each of them
    steps   (K − 1,) from knot to knot, over the whole time
    noise   stated standard deviation of a coordinate, m
    """

    points: Array
    centre: Array
    arms: Array
    steps: Array
    noise: float

    @classmethod
    def of(cls, times: Array, points: Array, noise: float) -> Self:
        first = np.isfinite(points[..., 0]).argmax(axis=0)
        start = points[first, np.arange(points.shape[1])]
        centre = start.mean(axis=0)
        steps = np.maximum(np.diff(times) / max(float(np.ptp(times)), 1e-300), 1e-9)
        return cls(points, centre, start - centre, steps, noise)

    @property
    def choices(self) -> tuple[tuple[int, ...], ...]:
        """Which parts may be free: none with one reading, no rotation with one point."""
        if not len(self.steps):
            return ((),)
        return ((), (0,)) if len(self.arms) == 1 else ((), (0,), (1,), (0, 1))

    def maximum(self, free: tuple[int, ...], about: Array) -> tuple[float, Array]:
        """Largest log-likelihood but for a constant, linear about twists (K, 6), and the logarithms
        of the sizes of the free parts over the noise, m or rad per m.
        """
        A, b, power, rows = self._normal(free, about)
        freedom = _STATED + rows - 3 * len(self.arms)  # the points have a flat prior

        def likelihood(sizes: Array) -> float:
            if (np.abs(sizes) > 25).any():
                return -np.inf
            precision, half_log_det = self._prior(sizes)
            L = np.linalg.cholesky(A + np.pad(precision, (0, len(A) - len(precision))))
            half = np.linalg.solve(L, b)
            rest = _STATED * self.noise**2 + max(power - float(half @ half), 0.0)
            return float(half_log_det - 0.5 * freedom * np.log(rest) - np.log(np.diag(L)).sum())

        if not free:
            return likelihood(np.zeros(0)), np.zeros(0)
        from scipy.optimize import minimize

        lever = max(float(np.linalg.norm(self.arms)), 1e-3)
        start = 2.0 - np.log([1.0, lever])[list(free)]
        options = {"xatol": 0.02, "fatol": 0.01, "maxiter": 80}
        best = minimize(lambda x: -likelihood(x), start, method="Nelder-Mead", options=options)
        return -float(best.fun), np.asarray(best.x)

    def solved(self, free: tuple[int, ...], sizes: Array) -> tuple[Array, Array, float]:
        """Twists (K, 6), their covariance (K, 6, 6), and the noise, m."""
        count, chosen = len(self.points), _elements(free)
        twists, covariance = np.zeros((count, 6)), np.zeros((count, 6, 6))
        precision, _ = self._prior(sizes)
        width = len(precision)
        for _ in range(_ROUNDS):
            A, b, power, rows = self._normal(free, twists)
            A[:width, :width] += precision
            x, before = np.linalg.solve(A, b), twists.copy()
            twists[1:, chosen] = x[:width].reshape(count - 1, len(chosen))
            if np.abs(twists - before).max() < 1e-12:
                break
        freedom = _STATED + rows - 3 * len(self.arms)
        rest = _STATED * self.noise**2 + max(power - float(b @ x), 0.0)
        inverse = rest / freedom * np.linalg.inv(A)
        for e in range(1, count):
            at = _of_knot(e, len(chosen))
            covariance[np.ix_([e], chosen, chosen)] = inverse[at, at]
        return twists, covariance, float(np.sqrt(rest / freedom))

    def _normal(self, free: tuple[int, ...], about: Array) -> tuple[Array, Array, float, int]:
        """Normal equations A x = b about twists (K, 6), power of the readings, m², and their
        number.
        """
        count, k = self.points.shape[:2]
        chosen = _elements(free)
        width = (count - 1) * len(chosen)
        A, b = np.zeros((width + 3 * k, width + 3 * k)), np.zeros(width + 3 * k)
        columns = point_columns(self.arms)[..., chosen]
        back = (self.points - self.centre - about[:, None, :3]) @ _rotations(about[:, 3:])
        rest = back - self.arms
        seen = np.isfinite(rest[..., 0])
        power = 0.0
        for e, i in np.argwhere(seen):
            of, at = slice(width + 3 * i, width + 3 * i + 3), _of_knot(e, len(chosen))
            B = columns[i]
            reading = rest[e, i] + B @ about[e, chosen]
            power += float(reading @ reading)
            A[of, of] += np.eye(3)
            b[of] += reading
            if e:
                A[at, at] += B.T @ B
                A[at, of] += B.T
                A[of, at] += B
                b[at] += B.T @ reading
        return A, b, power, 3 * int(seen.sum())

    def _prior(self, sizes: Array) -> tuple[Array, float]:
        """Precision of the Brownian motions over the noise, and half the log of its determinant."""
        weights, count = np.exp(-2 * np.repeat(sizes, 3)), len(self.steps)
        differences = np.eye(count) - np.eye(count, k=-1)  # the first knot stands at zero
        steps = (differences.T / self.steps) @ differences
        half = count * np.log(weights).sum() - len(weights) * np.log(self.steps).sum()
        return np.kron(steps, np.diag(weights)), 0.5 * float(half)


def _elements(free: tuple[int, ...]) -> list[int]:
    """Elements of the twist that parts consist of."""
    return [3 * part + i for part in free for i in range(3)]


def _of_knot(e: int, size: int) -> slice:
    """Where the unknowns of knot e ≥ 1 are."""
    return slice((e - 1) * size, e * size)


def _rotations(vectors: Array) -> Array:
    """exp(w) of rotation vectors (N, 3): (N, 3, 3)."""
    return exp6(np.concatenate([np.zeros_like(vectors), vectors], axis=-1))[:, :3, :3]
