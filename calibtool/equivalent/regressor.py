"""What a learned model of the joint motion errors is: a function of the joints with weights, which
owns its Jacobian.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Self

import numpy as np

from calibtool.robot.se3 import Array


class Regressor(ABC):
    """δρ = N(q, w).

    A frozen dataclass whose fields are arrays; `fields` says what they are, for files.

    id      by which it is chosen, and known in files
    fields  by name: unit ('q': that of the joints, 'rho': that of the joint motion errors),
            words, dimensions
    """

    id: ClassVar[str]
    fields: ClassVar[dict[str, tuple[str, str, tuple[str, ...]]]]

    @classmethod
    @abstractmethod
    def initial(cls, q: Array, output_scale: Array, hidden: int, rng: np.random.Generator) -> Self:
        """Where a training starts, scaled to its configurations q (K, n) and to the sizes of
        its outputs (p,).
        """

    @classmethod
    @abstractmethod
    def size_for(cls, n: int) -> int:
        """How large it is for n joints unless told otherwise."""

    @classmethod
    @abstractmethod
    def averaged(cls, members: Sequence[Self]) -> Self:
        """The mean of members with the same scalings, which is one of the same kind."""

    @abstractmethod
    def __call__(self, q: Array) -> Array:
        """Joint motion errors δρ (N, p) in rad or m for joint positions q (N, n)."""

    @property
    @abstractmethod
    def weights(self) -> Array:
        """w, all adjustable weights in one vector (W,)."""

    @abstractmethod
    def with_weights(self, weights: Array) -> Self:
        """The same with another weight vector (W,), in the order of `weights`."""

    @abstractmethod
    def through(self, R: Array, q: Array) -> tuple[Array, Array]:
        """R N (K, r) and ∂(R N)/∂w (K, r, W) for matrices R (K, r, p) and
        joint positions q (K, n).
        """
