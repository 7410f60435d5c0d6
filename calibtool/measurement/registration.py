"""Registration: instrument frame and targets on the tool, from measurements and a model of the
robot.

For a given rotation C of the instrument the equations are linear: C p_k,i + s − R_k t_i = t_k.
Eliminating the other unknowns gives a quadratic form of the nine elements of C, which is minimised
over all rotations (`rotation_search`). Its lowest minima start a damped Gauss–Newton refinement of
the exact residuals. No angle is assumed to be small, and no start is needed.
"""

from dataclasses import replace

import numpy as np

from calibtool.errors import NoSolutionError
from calibtool.measurement.circles import circle_start
from calibtool.measurement.gauss_newton import gauss_newton
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import linearised, weighted_residuals
from calibtool.measurement.rotation_search import RotationForm, nearest_rotation, rotation_grid
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import Array, exp6, inverse, readonly, transform_points
from calibtool.units import count_of

_MINIMA = 4  # number of minima of the rotation search that are refined
_ITERATIONS = 200
# m: assumed distance of targets from the tool frame where the rows hardly determine them
_ON_TOOL = 1.0
_WEAK = 0.1  # m: a target that the rows determine less surely than that is hardly determined
_SETTLED = 1e-6  # of the squares: a prior settles weak targets to a hundredth of their deviation
_NO_GAIN = 1e-4  # of the squares: steps that gain less follow directions that only noise determines


def register(
    measurements: Measurements, T_base_tool: Array | None = None, start: Setup | None = None
) -> Setup:
    """Fit the unknown parts of the set-up to the measurements; known parts stay.

    T_base_tool: (N, 4, 4) poses in K_0 by a model of the robot, by default those of the nominal
    robot. start: a set-up from which to start in addition; the solution with the lowest cost is
    returned.

    Raises NoSolutionError when there are fewer equations than unknowns, or no start converges.
    """
    setup = measurements.setup
    if setup.known:
        return setup
    poses = (
        measurements.robot.mechanism.forward(measurements.q) if T_base_tool is None else T_base_tool
    )
    never = np.flatnonzero(~measurements.seen.any(axis=0))
    if len(never) and not setup.targets_known and setup.kind.id == "points":
        raise NoSolutionError(
            f"registration: target {', '.join(str(i + 1) for i in never)} is seen in none of the "
            f"{len(measurements)} configurations, so nothing tells where it is; measure it or "
            "leave it out"
        )
    unknowns = 6 * (not setup.frame_known) + len(setup.free_names)
    equations = measurements.equations
    if equations <= unknowns:
        raise NoSolutionError(
            f"registration: {count_of(len(measurements), 'configuration')} give"
            f"{'s' * (len(measurements) == 1)} {equations} equations for {unknowns} unknowns of "
            "instrument frame and targets; measure more configurations"
        )
    refined = [
        refine(measurements, candidate, poses) for candidate in _starts(measurements, poses, start)
    ]
    best, cost = min(refined, key=lambda item: item[1])
    if not np.isfinite(cost):
        raise NoSolutionError(
            "registration: no start converged; check joint values, units and the order "
            "of the targets"
        )
    return _near_the_tool(measurements, best, poses)


def _near_the_tool(measurements: Measurements, setup: Setup, poses: Array) -> Setup:
    """The set-up with its targets drawn towards the tool frame where the rows hardly determine
    them.

    A tool that keeps its orientation shows targets and base only together. A target's deviation is
    computed from the residuals, which are errors of the arm more than noise.
    """
    if setup.targets_known or setup.kind.id not in ("points", "pose"):
        return setup
    of_base = None if setup.frame_known else np.broadcast_to(np.eye(6), (len(poses), 6, 6))
    columns, residual = linearised(measurements, setup, poses, of_base, targets=True)
    size = float(np.sqrt((residual**2).sum() / measurements.equations))
    prior = max(size, 1.0) / _ON_TOOL * _on_tool(setup)
    A = columns.reshape(residual.size, -1)
    held = np.diag(np.concatenate([np.zeros(A.shape[1] - len(prior)), prior]) ** 2)
    deviation = max(size, 1.0) * np.sqrt(np.diag(np.linalg.pinv(A.T @ A + held, hermitian=True)))
    if (deviation[-len(prior) :][prior > 0] < _WEAK).all():
        return setup
    drawn, cost = refine(measurements, setup, poses, prior)
    return drawn if np.isfinite(cost) else setup


def _on_tool(setup: Setup) -> Array:
    """1 for the free elements (k,) of the set-up that are coordinates of targets, 0 for others."""
    points, others = 3 * len(setup.targets), len(setup.free_names)
    return np.concatenate([np.ones(points), np.zeros(others - points)])


def update_setup(setup: Setup, base: Array | None, target_shift: Array | None) -> Setup:
    """Set-up after a Gauss–Newton step.

    twist (6,) of K_0, which moves the predictions; changes (d,) of the targets as in
    `target_columns`.
    """
    if base is not None:
        setup = setup.kind.in_base(setup, exp6(-base))
    return setup if target_shift is None else setup.kind.moved(setup, target_shift)


def refine(
    measurements: Measurements, setup: Setup, poses: Array, prior: Array | None = None
) -> tuple[Setup, float]:
    """Damped Gauss–Newton with minimum-norm steps from one set-up: the set-up and its cost.

    poses: T_base_tool (N, 4, 4). The cost is infinite when the iteration does not converge. prior
    (k,): 1/σ by which the free elements, of which the first are the targets, are drawn to 0.
    """
    of_base = None if setup.frame_known else np.broadcast_to(np.eye(6), (len(poses), 6, 6))
    base, shift = (slice(0), slice(None)) if setup.frame_known else (slice(6), slice(6, None))

    def drawn(at: Setup) -> Array:
        """Residuals of the prior (k,)."""
        if prior is None:
            return np.zeros(0)
        on_tool = at.targets.ravel()
        held: Array = prior * np.concatenate([on_tool, np.zeros(len(prior) - len(on_tool))])
        return -held

    def cost(at: Setup) -> float:
        squares = (weighted_residuals(measurements, at, poses) ** 2).sum()
        return float(squares + (drawn(at) ** 2).sum())

    def linearise(at: Setup) -> tuple[Array, Array]:
        columns, residual = linearised(
            measurements, at, poses, of_base, targets=bool(at.free_names)
        )
        columns, residual = columns.reshape(residual.size, -1), residual.ravel()
        if prior is None:
            return columns, residual
        held = np.concatenate([np.zeros(columns.shape[1] - len(prior)), prior])
        rows = np.diag(held)[-len(prior) :]
        return np.concatenate([columns, rows]), np.concatenate([residual, drawn(at)])

    fitted = np.ones(6 * (not setup.frame_known) + len(setup.free_names), dtype=bool)
    fitted[shift] = setup.kind.registered(setup)
    slow: list[bool] = []

    def solve(system: tuple[Array, Array], damping: float) -> tuple[Array, bool]:
        columns, right = system
        columns = columns * fitted
        if damping:
            scale = np.sqrt(damping * (columns**2).sum(axis=0))
            columns, right = (
                np.concatenate([columns, np.diag(scale)]),
                np.concatenate([right, np.zeros(len(scale))]),
            )
        step: Array = np.linalg.lstsq(columns, right, rcond=1e-9)[0].astype(float)
        gain = 2 * right @ (columns @ step) - ((columns @ step) ** 2).sum()
        slow.append(bool(gain < _NO_GAIN * (right @ right)))
        drawn_enough = prior is not None and gain < _SETTLED * (right @ right)
        return step, bool(drawn_enough or np.abs(step).max() < 1e-11)

    found, _, settled = gauss_newton(
        setup,
        linearise,
        solve,
        lambda at, step: update_setup(
            at,
            None if setup.frame_known else step[base],
            step[shift] if setup.free_names else None,
        ),
        _ITERATIONS,
        cost,
    )
    return found, cost(found) if settled or slow[-1] else np.inf


def _starts(measurements: Measurements, poses: Array, start: Setup | None) -> list[Setup]:
    """Starting values of the unknown parts of the set-up."""
    setup, arm = measurements.setup, measurements.noise_position / measurements.noise_orientation
    readings, kind = measurements.readings, setup.kind
    if starts := kind.starts(readings, setup, poses):
        return starts
    points, targets = kind.as_points(readings, setup, arm)
    place = readings.place if readings.place is not None else np.zeros(len(poses), dtype=int)
    count = len(measurements.places) or 1
    if setup.frame_known and count == 1:
        found = [(setup.frames, _mean_targets(poses, setup.T_instrument_base, points))]
    elif setup.targets_known:
        found = [(_placed(poses, targets, points, place, count), targets)]
    else:
        largest = int(np.argmax(np.bincount(place, minlength=count)))
        rows = place == largest
        guesses = [start.frames[min(largest, len(start.frames) - 1)]] if start is not None else []
        if count == 1 and kind.of_points and (circles := circle_start(measurements)) is not None:
            guesses.append(circles)
        frames = frames_of_least_squares(poses[rows], points[rows], guesses)
        if not kind.of_points or (points.shape == measurements.points.shape and count == 1):
            frames = frames[:1]  # the search had the sum of squares of the refinement, or nearly
        found = []
        for frame in frames:
            on_tool = _mean_targets(poses[rows], frame, points[rows])
            placed = _placed(poses, on_tool, points, place, count)
            placed[largest] = frame
            found.append((placed, on_tool))
    return [
        kind.from_points(
            replace(
                setup,
                T_instrument_base=readonly(frames[0]),
                further_frames=readonly(frames[1:]) if count > 1 else None,
            ),
            on_tool,
        )
        for frames, on_tool in found
    ]


def _placed(poses: Array, targets: Array, points: Array, place: np.ndarray, count: int) -> Array:
    """T_instrument_base of the `count` places that see the targets best: (count, 4, 4)."""
    predicted = transform_points(poses, targets)
    seen = ~np.isnan(points[..., 0])
    return np.array(
        [
            rigid_fit(predicted[rows][seen[rows]], points[rows][seen[rows]])
            if rows.any()
            else np.eye(4)
            for rows in (place == g for g in range(count))
        ]
    )


def frames_of_least_squares(
    poses: Array, points: Array, guesses: list[Array], *, only_guesses: bool = False
) -> list[Array]:
    """T_instrument_base that minimise C p_k,i + s − R_k t_i − t_k with free targets t_i, best
    first.

    poses (N, 4, 4), points (N, m, 3), NaN where unseen. guesses: frames whose rotations are starts
    beside a grid over all rotations, or instead of it with only_guesses.
    """
    count, m = points.shape[:2]
    seen = ~np.isnan(points[..., 0])
    centre = points[seen].mean(axis=0)
    A = np.zeros((count, m, 3, 9))
    B = np.zeros((count, m, 3, 3 + 3 * m))
    for row in range(3):
        A[:, :, row, 3 * row : 3 * row + 3] = points - centre
        B[:, :, row, row] = 1.0
    for i in range(m):
        B[:, i, :, 3 + 3 * i : 6 + 3 * i] = -poses[:, :3, :3]
    b = np.broadcast_to(poses[:, None, :3, 3:], (count, m, 3, 1))
    both = np.concatenate([A, b], axis=-1)[seen].reshape(-1, 10)
    linear = B[seen].reshape(-1, 3 + 3 * m)
    solved = np.linalg.lstsq(linear, both, rcond=1e-9)[0].astype(float)
    reduced = both - linear @ solved
    form = RotationForm.of(reduced[:, :9], reduced[:, 9])
    turned = [inverse(guess)[None, :3, :3] for guess in guesses]
    rotations = form.minimum(
        np.concatenate(turned if only_guesses else [*turned, form.relaxed(), rotation_grid()])
    )
    frames = []
    for C in rotations[:_MINIMA]:
        T_base_instrument = np.eye(4)
        T_base_instrument[:3, :3] = C
        T_base_instrument[:3, 3] = solved[:3, 9] - solved[:3, :9] @ C.ravel() - C @ centre
        frames.append(inverse(T_base_instrument))
    return frames


def _mean_targets(poses: Array, T_instrument_base: Array, points: Array) -> Array:
    """Targets in the tool frame, averaged over the configurations: (m, 3)."""
    T_tool_instrument = inverse(T_instrument_base @ poses)
    seen = (
        points @ np.swapaxes(T_tool_instrument[:, :3, :3], -1, -2)
        + T_tool_instrument[:, None, :3, 3]
    )
    mean: Array = np.nanmean(seen, axis=0)
    return mean


def rigid_fit(source: Array, target: Array) -> Array:
    """Rigid motion T (…, 4, 4) with T · source ≈ target in least squares (Kabsch).

    source, target: (…, m, 3), m.
    """
    a, b = source.mean(axis=-2, keepdims=True), target.mean(axis=-2, keepdims=True)
    T = np.zeros((*source.shape[:-2], 4, 4))
    T[..., :3, :3] = nearest_rotation(np.swapaxes(target - b, -1, -2) @ (source - a))
    T[..., :3, 3] = (b - a @ np.swapaxes(T[..., :3, :3], -1, -2))[..., 0, :]
    T[..., 3, 3] = 1.0
    return T
