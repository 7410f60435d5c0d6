"""Protocols of a learned model of the joint motion errors, and of one that is trained by steps."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Self

import numpy as np

from calibtool.robot.se3 import Array


class Regressor(ABC):
    """δρ = N(q).

    A frozen dataclass of arrays; `fields` describes them for files.

    id      name by which it is chosen and stored
    fields  by name: unit ('q': that of the joints, 'rho': that of the joint motion errors),
            description, dimensions
    """

    id: ClassVar[str]
    fields: ClassVar[dict[str, tuple[str, str, tuple[str, ...]]]]

    @classmethod
    @abstractmethod
    def averaged(cls, members: Sequence[Self]) -> Self:
        """Mean of models with equal scalings, as one model of the same kind."""

    @property
    @abstractmethod
    def hidden(self) -> int:
        """Number of nodes or points."""

    @abstractmethod
    def __call__(self, q: Array) -> Array:
        """Joint motion errors δρ (N, p) in rad or m for joint positions q (N, n)."""


class Trainable(Regressor):
    """A learned model with weights w that gradients or Gauss-Newton steps train, δρ = N(q, w)."""

    @classmethod
    @abstractmethod
    def initial(cls, q: Array, output_scale: Array, hidden: int, rng: np.random.Generator) -> Self:
        """Start of a training, scaled to configurations q (K, n) and to the outputs (p,)."""

    @classmethod
    @abstractmethod
    def size_for(cls, n: int) -> int:
        """Default number of nodes for n joints."""

    @property
    @abstractmethod
    def weights(self) -> Array:
        """w, all adjustable weights in one vector (W,)."""

    @abstractmethod
    def with_weights(self, weights: Array) -> Self:
        """The same with another weight vector (W,), in the order of `weights`."""

    @abstractmethod
    def through(self, R: Array, q: Array) -> tuple[Array, Array]:
        """R N (K, r) and ∂(R N)/∂w (K, r, W) for matrices R (K, r, p) and joints q (K, n)."""
