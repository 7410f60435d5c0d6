"""Minima over all rotations of a quadratic form of the nine elements, from many starts."""

from dataclasses import dataclass

import numpy as np

from calibtool.robot.se3 import Array, skew

_ITERATIONS = 60
_LONGEST = 0.5  # rad: longest step
_SETTLED = 1e-11  # rad: a smaller step ends the iteration
_SAME = 1e-6  # minima whose elements differ by less are the same

# ∂vec(exp([w]×) C)/∂w_i = vec(G_i C) at w = 0, vec row by row
_GENERATORS = skew(np.eye(3))


@dataclass(frozen=True, eq=False)
class RotationForm:
    """f(C) = |E vec(C) − e|² / 2, vec row by row, as M = EᵀE (9, 9) and g = Eᵀe (9,)."""

    M: Array
    g: Array

    @classmethod
    def of(cls, E: Array, e: Array) -> "RotationForm":
        """From the equations E (k, 9), e (k,)."""
        return cls(E.T @ E, E.T @ e)

    def value(self, C: Array) -> Array:
        """f without its constant: (…, 3, 3) → (…,)."""
        x = C.reshape(*C.shape[:-2], 9)
        result: Array = ((0.5 * x @ self.M - self.g) * x).sum(axis=-1)
        return result

    def relaxed(self) -> Array:
        """Rotations (2, 3, 3) nearest to the unconstrained solutions, one per rank tolerance."""
        # The second is for designs in which a direction is seen only through errors.
        solutions = [
            np.linalg.pinv(self.M, rcond=tolerance, hermitian=True) @ self.g
            for tolerance in (1e-12, 1e-4)
        ]
        return nearest_rotation(np.stack(solutions).reshape(-1, 3, 3))

    def minimum(self, starts: Array) -> list[Array]:
        """Distinct local minima from starts (s, 3, 3), the lowest value first.

        Newton's method on SO(3) with the exact Hessian, whose eigenvalues are made positive; steps
        are halved until the value decreases.
        """
        from scipy.spatial.transform import Rotation

        C, value, reach = starts.copy(), self.value(starts), np.ones(len(starts))
        # the last steps lower the sum by less than rounding
        rounding = 1e-13 * (np.abs(self.M).max() + np.abs(self.g).max())
        for _ in range(_ITERATIONS):
            step = self._newton_step(C) * reach[:, None]
            length = np.linalg.norm(step, axis=-1)
            step *= np.minimum(1.0, _LONGEST / np.maximum(length, 1e-300))[:, None]
            proposed = Rotation.from_rotvec(step).as_matrix() @ C
            after = self.value(proposed)
            better = after <= value + rounding
            C[better], value[better] = proposed[better], after[better]
            reach = np.where(better, np.minimum(4 * reach, 1.0), reach / 4)
            if (length < _SETTLED).all():
                break
        found: list[Array] = []
        for k in np.argsort(value, kind="stable"):
            if all(np.abs(C[k] - other).max() > _SAME for other in found):
                found.append(C[k])
        return found

    def _newton_step(self, C: Array) -> Array:
        slope = (C.reshape(-1, 9) @ self.M - self.g).reshape(-1, 3, 3)
        D = (_GENERATORS @ C[:, None]).reshape(-1, 3, 9)
        gradient = (D @ slope.reshape(-1, 9, 1))[..., 0]
        bend = C @ np.swapaxes(slope, -1, -2)  # of vec([w]×² C / 2): sym(C Sᵀ) − tr(C Sᵀ) I
        hessian = D @ self.M @ np.swapaxes(D, -1, -2) + (bend + np.swapaxes(bend, -1, -2)) / 2
        hessian -= np.trace(bend, axis1=-2, axis2=-1)[:, None, None] * np.eye(3)
        values, vectors = np.linalg.eigh(hessian)
        largest = np.maximum(np.abs(values).max(axis=-1, keepdims=True), 1e-300)
        scaled = np.einsum("kij,ki->kj", vectors, gradient) / np.maximum(
            np.abs(values), 1e-9 * largest
        )
        uphill: Array = np.einsum("kij,kj->ki", vectors, scaled)
        return -uphill


def rotation_grid() -> Array:
    """The 24 rotations (24, 3, 3) of a cube; every rotation is within 63 deg of one of them."""
    from scipy.spatial.transform import Rotation

    grid: Array = Rotation.create_group("O").as_matrix()
    return grid


def nearest_rotation(matrix: Array) -> Array:
    """The proper rotation nearest to a matrix (Frobenius norm): (…, 3, 3) → (…, 3, 3)."""
    u, _, vt = np.linalg.svd(matrix)
    sign = np.ones(matrix.shape[:-1])
    sign[..., 2] = np.linalg.det(u @ vt)
    nearest: Array = (u * sign[..., None, :]) @ vt
    return nearest
