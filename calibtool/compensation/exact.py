"""The exact correction: joints at which the calibrated robot takes the commanded pose, near q."""

from dataclasses import dataclass, replace

import numpy as np

from calibtool.calibration import Calibration
from calibtool.compensation.bounds import Bounds
from calibtool.compensation.judge import Judged, judged
from calibtool.compensation.one_step import REACHED, Linearised, default_bounds
from calibtool.compensation.step import DAMPED_BELOW, bounded_step, damped_step, times
from calibtool.compensation.weighted_error import Task, weighted_error, weighted_jacobian
from calibtool.robot.inverse import solve_poses
from calibtool.robot.se3 import Array

_ITERATIONS = 100
_ARRIVED = 1e-12  # rad, or characteristic lengths
_STANDS = 1e-10  # rad or m: a smaller step ends the search
_CAUTION, _NO_CAUTION = 1e-4, 1e-8  # damping after the first step that failed; none below
_RAISED, _LOWERED = 5.0, 0.2  # its factors while steps fail, and when they succeed


def exact(
    calibration: Calibration,
    q: Array,
    commanded: Array | None = None,
    bounds: Bounds | None = None,
) -> Judged:
    """Joints q + Δ (N, n) at which the calibrated robot takes the commanded poses (N, 4, 4).

    Δ makes |E(q + Δ)|² + λ² |Δ|² least in the box of `Bounds.box`, E the weighted error of the task
    components and λ that of `bounded_step` at q. Away from singularities λ = 0: E vanishes, by the
    least such motion. Near them the same is done once more from there, as in `bounded_step`, and
    the step of the one-step rule takes over with the part s = 2 (d₀ − d) / d₀, at most 1: at a
    singularity two answers can be as near, to either side, and a path must not jump between them.
    For n < 6 the same with the error of all six components is blended in by the weight of
    `one_step`. `judged` has the last word, as there.

    commanded and bounds as for `one_step`; but the task counts as done at 1e-9 in place of
    `bounds.usual`, unless it has more components than there are joints.
    """
    bounds = default_bounds(calibration) if bounds is None else bounds
    model = Linearised.at(calibration, q, commanded, bounds)
    search = _Search(calibration, q, model.commanded, *model.box)
    change, distance, error = search.least(model.task, *model.of_task, model.network)
    if model.task.is_part:
        of_all, _, _ = search.least(Task(None), model.jacobian, model.error)
        change, _ = model.blended(change, of_all)
    known = error if model.task.components is None else None
    usual = bounds.usual
    if model.of_task[0].shape[1] <= calibration.robot.n:
        usual = (REACHED, usual[1])
    done = replace(bounds, usual=usual)
    return judged(calibration, model.commanded, model.proposal(change, distance), done, known)


@dataclass(frozen=True, eq=False)
class _Search:
    """Searches for changes of the joints q (N, n) between lower and upper (N, n) of them."""

    calibration: Calibration
    q: Array
    commanded: Array
    lower: Array
    upper: Array

    def least(
        self, task: Task, A: Array, e: Array, proposed: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Δ (N, n) of `exact` for a task, the singularity distance d (N,), and E (N, k) at q + Δ.

        A (N, k, n) and e (N, k) are the Jacobian and E at q; proposed (N, n) as for `bounded_step`.
        """
        change, distance, _ = bounded_step(A, e, self.lower, self.upper, proposed)
        remaining = e.copy()
        part = np.clip(2.0 * (DAMPED_BELOW - distance) / DAMPED_BELOW, 0.0, 1.0)
        nearest = distance.copy()
        held = (change <= self.lower) | (change >= self.upper)
        rows = np.flatnonzero((part == 0.0) & held.any(axis=-1))
        nearest[rows] = _free_distance(A[rows], held[rows])
        squares = np.maximum(0.0, DAMPED_BELOW - nearest) ** 2
        narrow = self._narrowed(rows, change[rows], task)
        rows = np.flatnonzero(part < 1.0)
        search = narrow.of(rows)
        found, remaining[rows] = search._damped_twice(task, A[rows], e[rows], squares[rows])
        change[rows] = found + part[rows, None] * (change[rows] - found)
        near = np.flatnonzero(part)
        remaining[near], _ = self._driven(near, change[near], task)
        if task.components is None and self.q.shape[1] >= 6:
            missed = (remaining**2).sum(axis=-1) > REACHED**2
            narrow._over_hills(np.flatnonzero(missed & (part == 0.0)), change, remaining)
        return change, distance, remaining

    def _narrowed(self, rows: np.ndarray, change: Array, task: Task) -> "_Search":
        """Some rows no farther from a first step (N, n) than 2 |E| / d₀, E what it leaves.

        Beside joints that are held, the last of an error can cost any motion of the others.
        """
        error, _ = self._driven(rows, change, task)
        far = 2.0 * np.linalg.norm(error, axis=-1)[:, None] / DAMPED_BELOW
        far = far * np.where(self.calibration.robot.prismatic, self.calibration.robot.length, 1.0)
        lower, upper = self.lower.copy(), self.upper.copy()
        lower[rows] = np.maximum(lower[rows], change - far)
        upper[rows] = np.minimum(upper[rows], change + far)
        return replace(self, lower=lower, upper=upper)

    def of(self, rows: np.ndarray, moved: Array | float = 0.0) -> "_Search":
        """The same for some rows, from joints that are moved already."""
        lower, upper = self.lower[rows] - moved, self.upper[rows] - moved
        return replace(
            self, q=self.q[rows] + moved, commanded=self.commanded[rows], lower=lower, upper=upper
        )

    def _damped_twice(self, task: Task, A: Array, e: Array, squares: Array) -> tuple[Array, Array]:
        """Δ and E there; where λ² = squares (N,) is not zero, solved again for the remaining
        error.
        """
        change, A, e = self._descended(task, A, e, squares)
        near = np.flatnonzero(squares)
        if len(near):
            again = self.of(near, change[near])
            more, _, e[near] = again._descended(task, A[near], e[near], squares[near])
            change[near] += more
        return change, e

    def _descended(
        self, task: Task, A: Array, e: Array, squares: Array
    ) -> tuple[Array, Array, Array]:
        """Δ (N, n) of least |E|² + λ² |Δ|², λ² = squares (N,); A and e there, from those at q.

        Gauss–Newton steps; where one fails, the damping of Levenberg and Marquardt holds the next
        one back. Only what lowers the sum is kept: the answer is the best pose visited.
        """
        A, e = A.copy(), e.copy()
        change, caution, cost = np.zeros_like(self.q), np.zeros(len(self.q)), (e**2).sum(axis=-1)
        active = np.flatnonzero(cost > _ARRIVED**2)
        for _ in range(_ITERATIONS):
            if not len(active):
                break
            before = change[active]
            model = A[active], e[active]
            after = self._step(active, model, squares[active], caution[active], before)
            error, jacobian = self._driven(active, after, task)
            new_cost = (error**2).sum(axis=-1) + squares[active] * (after**2).sum(axis=-1)
            better = new_cost <= cost[active]
            rows = active[better]
            change[rows], cost[rows] = after[better], new_cost[better]
            A[rows], e[rows] = jacobian[better], error[better]
            raised = np.maximum(_RAISED * caution[active], _CAUTION)
            held_back = np.where(better, _LOWERED * caution[active], raised)
            caution[active] = np.where(held_back < _NO_CAUTION, 0.0, held_back)
            arrived = better & ((error**2).sum(axis=-1) < _ARRIVED**2)
            stands = np.abs(after - before).max(axis=-1) < _STANDS
            active = active[~(arrived | stands)]
        return change, A, e

    def _over_hills(self, rows: np.ndarray, change: Array, e: Array) -> None:
        """Another search for rows that only came near: by way of worse poses it may arrive.

        Writes Δ (N, n) and E (N, 6) of those that do.
        """
        if not len(rows):
            return
        robot, q = self.calibration.robot, self.q[rows]

        def actuated(x: Array) -> tuple[Array, Array]:
            pose, jacobian = self.calibration.forward_and_jacobian(x)
            return pose, jacobian[:, :, : robot.n]

        solved = solve_poses(
            actuated,
            self.commanded[rows],
            q,
            length=robot.length,
            lower=q + self.lower[rows],
            upper=q + self.upper[rows],
            tolerance=REACHED,
        )
        found = rows[solved.reached]
        change[found] = (solved.q - q)[solved.reached]
        e[found], _ = self._driven(found, change[found], Task(None))

    def _step(
        self,
        rows: np.ndarray,
        model: tuple[Array, Array],
        squares: Array,
        caution: Array,
        change: Array,
    ) -> Array:
        """The next Δ' of some rows: least |e + A (Δ' − Δ)|² + λ² |Δ'|² + caution |Δ' − Δ|²."""
        A, e = model
        total = squares + caution
        kept = np.where(caution > 0.0, caution / np.where(total > 0.0, total, 1.0), 0.0)
        centre = kept[:, None] * change
        lower, upper = self.lower[rows] - centre, self.upper[rows] - centre
        return centre + damped_step(A, e - times(A, change - centre), total, lower, upper)

    def _driven(self, rows: np.ndarray, change: Array, task: Task) -> tuple[Array, Array]:
        """Error (N, k) and Jacobian (N, k, n) of a task at q + Δ of some rows."""
        robot = self.calibration.robot
        pose, jacobian = self.calibration.forward_and_jacobian(self.q[rows] + change)
        commanded = self.commanded[rows]
        error = weighted_error(pose, commanded, robot.length)
        weighted = weighted_jacobian(jacobian[:, :, : robot.n], pose, robot.length)
        return task.of_error(error, commanded), task.of_jacobian(weighted, commanded)


def _free_distance(A: Array, held: np.ndarray) -> Array:
    """Singularity distance (N,) of the joints that are not held: A (N, k, n), held (N, n)."""
    sigma = np.linalg.svd(np.where(held[:, None, :], 0.0, A), compute_uv=False)
    rank = np.minimum((~held).sum(axis=-1), A.shape[1])
    counted = np.arange(sigma.shape[1]) < rank[:, None]
    inverse = np.where(counted, 1.0 / np.maximum(sigma, 1e-15) ** 2, 0.0)
    distance: Array = 1.0 / np.sqrt(np.maximum(inverse.sum(axis=-1), 1e-15))
    return distance
