"""Forward kinematics and Jacobians in batches, by Pinocchio."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from calibtool.robot.se3 import Array, skew

# Nearer to a singularity than this (see `singularity_distance`) 1 mrad of pose error costs up to 50 mrad of joint motion.
MIN_SINGULARITY_DISTANCE = 0.02
GRAM_REGULARISATION = 1e-14  # keeps J Jᵀ invertible at a singularity


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A Pinocchio model driven by the n joint positions of the robot: model coordinates = drive @ q + offset.

    model   Pinocchio model, a serial chain of one-coordinate joints
    tool    (4, 4) pose of the tool in the last joint's frame
    drive   (model.nq, n) and offset (model.nq,): identity and zero for a nominal robot; a perturbed joint is a
            helical one that needs a factor, or several joints that share one position
    """

    model: pin.Model
    tool: Array
    drive: Array
    offset: Array

    def forward(self, q: Array) -> Array:
        """T_base_tool for q (N, n) in rad or m: (N, 4, 4)."""
        q_model = q @ self.drive.T + self.offset
        data = self.model.createData()
        last = data.oMi[self.model.njoints - 1]  # a live view
        poses = np.empty((len(q), 4, 4))
        forward_kinematics, model = pin.forwardKinematics, self.model
        for k, q_k in enumerate(q_model):
            forward_kinematics(model, data, q_k)
            poses[k] = last.homogeneous
        return poses @ self.tool

    def forward_and_jacobian(self, q: Array) -> tuple[Array, Array]:
        """T_base_tool (N, 4, 4) and the spatial Jacobian (N, 6, n) in K_0, columns ∂(δy)/∂q_j = Ad(F_j) ξ_j."""
        q_model = q @ self.drive.T + self.offset
        data = self.model.createData()
        last, spatial = (
            data.oMi[self.model.njoints - 1],
            data.J.reshape(6, -1),
        )  # live views; one joint's J comes as (6,)
        poses, jacobians = np.empty((len(q), 4, 4)), np.empty((len(q), 6, self.model.nv))
        compute, model = pin.computeJointJacobians, self.model
        for k, q_k in enumerate(q_model):
            compute(model, data, q_k)
            jacobians[k] = spatial
            poses[k] = last.homogeneous
        if self.drive.shape[0] != self.drive.shape[1] or not np.array_equal(self.drive, np.eye(len(self.drive))):
            jacobians = jacobians @ self.drive
        return poses @ self.tool, jacobians


def at_point(twists: Array, points: Array) -> Array:
    """Twists of K_0 seen at a point: v becomes the velocity of that point, v + ω × p. (N, 6, c), (N, 3) → (N, 6, c)."""
    result = twists.copy()
    result[..., :3, :] -= skew(points) @ twists[..., 3:, :]
    return result


def singularity_distance(jacobian: Array, length: float) -> Array:
    """How far J is from losing rank: d = (Σ 1/σ_i²)^(−1/2), at most σ_min and at least σ_min/√6.

    jacobian (N, 6, c) at the tool point, its translational rows are divided by `length` (m). Unlike σ_min it is smooth
    in q and needs no SVD, so that exported code can evaluate it. (N,)
    """
    return _distance(regularised_gram(jacobian, length))


def _distance(gram: Array) -> Array:
    """(Σ 1/σ²)^(−1/2) from J Jᵀ. Rounding of large entries can undo the regularisation, and an inverse would fail."""
    squares: Array = np.maximum(np.linalg.eigvalsh(gram), GRAM_REGULARISATION)
    total: Array = (1.0 / squares).sum(axis=-1)
    return 1.0 / np.sqrt(total)


def regularised_gram(jacobian: Array, length: float) -> Array:
    """J (…, 6, c): J Jᵀ (c ≥ 6) or JᵀJ (c < 6) with rows scaled as in `singularity_distance`, plus GRAM_REGULARISATION."""
    scaled = scale_rows(jacobian, length)
    transposed = np.swapaxes(scaled, -1, -2)
    gram = scaled @ transposed if jacobian.shape[-1] >= 6 else transposed @ scaled
    return gram + GRAM_REGULARISATION * np.eye(gram.shape[-1])


def scale_rows(jacobian: Array, length: float) -> Array:
    """Translational rows of (…, 6, c) divided by `length`, so that all six rows are in rad."""
    scaled = jacobian.copy()
    scaled[..., :3, :] /= length
    return scaled


def damped_solution(jacobian: Array, error: Array, length: float) -> tuple[Array, Array]:
    """Joint motions x with J x ≈ e, of minimum norm, damped near singularities; and the singularity distance d.

    jacobian (N, 6, c ≥ 6) and error (N, 6) at the tool point, translations in m → x (N, c), d (N,). With rows scaled by
    `length`: x = Jᵀ (J Jᵀ + λ² I)⁻¹ e, λ = max(0, d₀ − d) and d₀ = MIN_SINGULARITY_DISTANCE: undamped where d ≥ d₀, and
    never longer than |e| / (2 λ).
    """
    scaled = scale_rows(jacobian, length)
    gram = regularised_gram(jacobian, length)
    distance = _distance(gram)
    damping = np.maximum(0.0, MIN_SINGULARITY_DISTANCE - distance) ** 2
    right = scale_rows(error[..., None], length)
    solved = np.linalg.solve(gram + damping[:, None, None] * np.eye(6), right)
    return (np.swapaxes(scaled, -1, -2) @ solved)[..., 0], distance
