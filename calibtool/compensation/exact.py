"""The exact correction: joints near q at which the calibrated robot reaches the commanded pose."""

from dataclasses import dataclass, replace

import numpy as np

from calibtool.calibration import Calibration
from calibtool.compensation.bounds import Bounds
from calibtool.compensation.judge import Judged, judged
from calibtool.compensation.one_step import REACHED, Linearised, default_bounds
from calibtool.compensation.step import DAMPED_BELOW, bounded_step, damped_step, times
from calibtool.compensation.weighted_error import Task
from calibtool.robot.inverse import solve_poses
from calibtool.robot.se3 import Array, pose_difference
from calibtool.robot.singularity import weighted_jacobian

_ITERATIONS = 100
_CONVERGED = 1e-12  # rad, or characteristic lengths: the error at which the search ends
_SMALLEST_STEP = 1e-10  # rad or m: a smaller step ends the search
_DAMPING, _NO_DAMPING = 1e-4, 1e-8  # after the first step that failed; smaller values become 0
_RAISED, _LOWERED = 5.0, 0.2  # factors of the damping when steps fail, and when they succeed


def exact(
    calibration: Calibration,
    q: Array,
    commanded: Array | None = None,
    bounds: Bounds | None = None,
) -> Judged:
    """Joints q + Δ (N, n) at which the calibrated robot reaches the commanded poses (N, 4, 4).

    Δ minimises |E(q + Δ)|² + λ² |Δ|² in the box of `Bounds.box`. E is the weighted error of the
    task components, and λ the damping of `bounded_step` at q.

    Away from singularities λ = 0, so that E vanishes; of all such Δ the smallest is taken. Near a
    singularity the minimisation is repeated from its result, as in `bounded_step`. The result is
    then mixed with the step of the one-step rule, with the share s = 2 (d₀ − d) / d₀, at most 1, of
    the latter: at a singularity two solutions on either side can be equally near, and a path must
    not jump between them. For n < 6 the solution for all six components is mixed in with the weight
    of `one_step`. Finally `judged` decides, as there.

    commanded and bounds: as for `one_step`, except that the task counts as solved at an error of
    1e-9 instead of `bounds.usual`, unless it has more components than there are joints.
    """
    bounds = default_bounds(calibration) if bounds is None else bounds
    model = Linearised.at(calibration, q, commanded, bounds)
    search = _Search(calibration, q, model.commanded, *model.box)
    change, distance, error = search.minimum(model.task, *model.of_task, model.network)
    if model.task.is_part:
        of_all, _, _ = search.minimum(Task(None), model.jacobian, model.error)
        change, _ = model.blended(change, of_all)
    known = error if model.task.components is None else None
    usual = bounds.usual
    if model.of_task[0].shape[1] <= calibration.robot.n:
        usual = (REACHED, usual[1])
    done = replace(bounds, usual=usual)
    return judged(calibration, model.commanded, model.proposal(change, distance), done, known)


@dataclass(frozen=True, eq=False)
class _Search:
    """Iterative search for changes of the joints q (N, n), between lower and upper (N, n)."""

    calibration: Calibration
    q: Array
    commanded: Array
    lower: Array
    upper: Array

    def minimum(
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
        nearest[rows] = _distance_of_free_joints(A[rows], held[rows])
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
            narrow._searched_again(np.flatnonzero(missed & (part == 0.0)), change, remaining)
        return change, distance, remaining

    def _narrowed(self, rows: np.ndarray, change: Array, task: Task) -> "_Search":
        """The search with changes of some rows limited to 2 |E| / d₀ around a first step (N, n).

        E is the remaining error of that step. Where a joint is held at its bound, removing the rest
        of an error could otherwise need arbitrarily large motions of the other joints.
        """
        error, _ = self._driven(rows, change, task)
        far = 2.0 * np.linalg.norm(error, axis=-1)[:, None] / DAMPED_BELOW
        far = far * np.where(self.calibration.robot.prismatic, self.calibration.robot.length, 1.0)
        lower, upper = self.lower.copy(), self.upper.copy()
        lower[rows] = np.maximum(lower[rows], change - far)
        upper[rows] = np.minimum(upper[rows], change + far)
        return replace(self, lower=lower, upper=upper)

    def of(self, rows: np.ndarray, moved: Array | float = 0.0) -> "_Search":
        """The search for some rows only, starting from joints that are moved by `moved`."""
        lower, upper = self.lower[rows] - moved, self.upper[rows] - moved
        return replace(
            self, q=self.q[rows] + moved, commanded=self.commanded[rows], lower=lower, upper=upper
        )

    def _damped_twice(self, task: Task, A: Array, e: Array, squares: Array) -> tuple[Array, Array]:
        """Δ and E there; where λ² = squares (N,) is not 0, solved again for the remaining error."""
        change, A, e = self._minimised(task, A, e, squares)
        near = np.flatnonzero(squares)
        if len(near):
            again = self.of(near, change[near])
            more, _, e[near] = again._minimised(task, A[near], e[near], squares[near])
            change[near] += more
        return change, e

    def _minimised(
        self, task: Task, A: Array, e: Array, squares: Array
    ) -> tuple[Array, Array, Array]:
        """Δ (N, n) that minimises |E|² + λ² |Δ|² with λ² = squares (N,), and A and e at q + Δ.

        A and e are given at q. Gauss–Newton steps; after a step that does not lower the sum, the
        next ones are damped as by Levenberg and Marquardt. Only steps that lower it are kept.
        """
        A, e = A.copy(), e.copy()
        change, damping, cost = np.zeros_like(self.q), np.zeros(len(self.q)), (e**2).sum(axis=-1)
        active = np.flatnonzero(cost > _CONVERGED**2)
        for _ in range(_ITERATIONS):
            if not len(active):
                break
            before = change[active]
            model = A[active], e[active]
            after = self._step(active, model, squares[active], damping[active], before)
            error, jacobian = self._driven(active, after, task)
            new_cost = (error**2).sum(axis=-1) + squares[active] * (after**2).sum(axis=-1)
            better = new_cost <= cost[active]
            rows = active[better]
            change[rows], cost[rows] = after[better], new_cost[better]
            A[rows], e[rows] = jacobian[better], error[better]
            raised = np.maximum(_RAISED * damping[active], _DAMPING)
            changed = np.where(better, _LOWERED * damping[active], raised)
            damping[active] = np.where(changed < _NO_DAMPING, 0.0, changed)
            converged = better & ((error**2).sum(axis=-1) < _CONVERGED**2)
            stopped = np.abs(after - before).max(axis=-1) < _SMALLEST_STEP
            active = active[~(converged | stopped)]
        return change, A, e

    def _searched_again(self, rows: np.ndarray, change: Array, e: Array) -> None:
        """A second search for rows that did not converge: it may pass through larger errors.

        Writes Δ (N, n) and E (N, 6) of the rows that converge now.
        """
        if not len(rows):
            return
        robot, q = self.calibration.robot, self.q[rows]

        def actuated(x: Array) -> tuple[Array, Array]:
            pose, jacobian = self.calibration.forward_and_jacobian(x)
            return pose, jacobian[:, :, : robot.n]

        solution = solve_poses(
            actuated,
            self.commanded[rows],
            q,
            length=robot.length,
            lower=q + self.lower[rows],
            upper=q + self.upper[rows],
            tolerance=REACHED,
        )
        found = rows[solution.reached]
        change[found] = (solution.q - q)[solution.reached]
        e[found], _ = self._driven(found, change[found], Task(None))

    def _step(
        self,
        rows: np.ndarray,
        model: tuple[Array, Array],
        squares: Array,
        damping: Array,
        change: Array,
    ) -> Array:
        """The next Δ' of some rows: it minimises |e + A (Δ' − Δ)|² + λ² |Δ'|² + μ |Δ' − Δ|², with
        μ = damping (N,).
        """
        A, e = model
        total = squares + damping
        kept = np.where(damping > 0.0, damping / np.where(total > 0.0, total, 1.0), 0.0)
        centre = kept[:, None] * change
        lower, upper = self.lower[rows] - centre, self.upper[rows] - centre
        return centre + damped_step(A, e - times(A, change - centre), total, lower, upper)

    def _driven(self, rows: np.ndarray, change: Array, task: Task) -> tuple[Array, Array]:
        """Error (N, k) and Jacobian (N, k, n) of a task at q + Δ of some rows."""
        robot = self.calibration.robot
        pose, jacobian = self.calibration.forward_and_jacobian(self.q[rows] + change)
        commanded = self.commanded[rows]
        error = pose_difference(pose, commanded, robot.length)
        weighted = weighted_jacobian(jacobian[:, :, : robot.n], pose, robot.length)
        return task.of_error(error, commanded), task.of_jacobian(weighted, commanded)


def _distance_of_free_joints(A: Array, held: np.ndarray) -> Array:
    """Singularity distance (N,) of the joints that are not held: A (N, k, n), held (N, n)."""
    sigma = np.linalg.svd(np.where(held[:, None, :], 0.0, A), compute_uv=False)
    rank = np.minimum((~held).sum(axis=-1), A.shape[1])
    counted = np.arange(sigma.shape[1]) < rank[:, None]
    inverse = np.where(counted, 1.0 / np.maximum(sigma, 1e-15) ** 2, 0.0)
    distance: Array = 1.0 / np.sqrt(np.maximum(inverse.sum(axis=-1), 1e-15))
    return distance
