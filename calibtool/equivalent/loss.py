"""The two losses of Song, Tian and Ma, both as E(w) = 1/K Σ_k |t_k − R_k N(q_k, w)|²."""

from dataclasses import dataclass

import numpy as np

from calibtool.equivalent.regressor import Regressor, Trainable
from calibtool.robot.se3 import Array


@dataclass(frozen=True, eq=False)
class Loss:
    """Training data of the equivalent robot: q (K, n), R (K, r, p) and t (K, r).

    task loss (Eq. 20): R, t from the QR factors of Σ^(−1/2) P J_ρ, so E is the weighted error of
    the target points, up to a constant. joint loss (Eq. 21): R = I and t = (P J_ρ)⁺ δp.
    """

    q: Array
    R: Array
    t: Array

    def rows(self, index: np.ndarray) -> "Loss":
        """The loss on some configurations only: their indices (k,)."""
        return Loss(self.q[index], self.R[index], self.t[index])

    def value(self, network: Regressor) -> float:
        """E(w)."""
        return float((self.residual(network) ** 2).sum() / len(self.q))

    @property
    def without_network(self) -> float:
        """E for N = 0."""
        return float((self.t**2).sum() / len(self.q))

    def residual(self, network: Regressor) -> Array:
        """t − R N: (K, r)."""
        return self.t - (self.R @ network(self.q)[..., None])[..., 0]

    def residual_and_jacobian(self, network: Trainable) -> tuple[Array, Array]:
        """Residual (K·r,) and ∂(R N)/∂w (K·r, W), weights in the order of `Regressor.weights`."""
        seen, J = network.through(self.R, self.q)
        return (self.t - seen).ravel(), J.reshape(seen.size, -1)


def task_loss(q: Array, G: Array, y: Array) -> Loss:
    """Task-space loss: weighted matrix G = Σ^(−1/2) P J_ρ (K, d, p) and weighted residual y
    (K, d) (Eq. 20).

    |y − G N|² = |R (δρ̂ − N)|² + const with G = Q R: the products with P J_ρ are computed once, not
    at every iteration.
    """
    Q, R = np.linalg.qr(G)
    return Loss(q, R, (np.swapaxes(Q, -1, -2) @ y[..., None])[..., 0])


def joint_loss(q: Array, G: Array, y: Array) -> Loss:
    """Joint-space loss: δρ̂ = G⁺ y, all components weighted alike (Eq. 21); of minimum norm where
    G does not determine it.

    Shapes as in `task_loss`.
    """
    t = (np.linalg.pinv(G, rcond=1e-9) @ y[..., None])[..., 0]
    return Loss(q, np.broadcast_to(np.eye(G.shape[-1]), (len(q), G.shape[-1], G.shape[-1])), t)
