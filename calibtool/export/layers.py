"""A learned model, network or Gaussian process, in the form that exported code evaluates."""

from dataclasses import dataclass

import numpy as np

from calibtool.equivalent.gaussian_process import GaussianProcess
from calibtool.equivalent.network import Network
from calibtool.equivalent.regressor import Regressor
from calibtool.robot.se3 import Array


@dataclass(frozen=True, eq=False)
class Layers:
    """A learned model in the form that exported code evaluates, with the arrays of `Network`.

    N(q) = output_scale ∘ (output_weights h + output_bias) of h = tanh(x), x = hidden_weights s +
    hidden_bias, or with a `kernel` h = exp(x − |s|² / 2).
    """

    input_centre: Array
    input_scale: Array
    hidden_weights: Array
    hidden_bias: Array
    output_weights: Array
    output_bias: Array
    output_scale: Array
    kernel: bool

    @property
    def hidden(self) -> int:
        """Number of nodes."""
        return len(self.hidden_bias)

    @property
    def words(self) -> str:
        """Size and kind in words."""
        kind = "points (Gaussian process)" if self.kernel else "hidden nodes (tanh)"
        n, p = len(self.input_scale), len(self.output_scale)
        return f"{n} inputs, {self.hidden} {kind}, {p} outputs"


def layers(model: Regressor | None) -> Layers | None:
    """A learned model in the form that exported code evaluates; None without one."""
    if model is None:
        return None
    if isinstance(model, GaussianProcess):
        return Layers(
            model.input_centre,
            model.input_scale,
            model.points,
            model.hidden_bias,
            model.output_weights,
            np.zeros(len(model.output_scale)),
            model.output_scale,
            kernel=True,
        )
    assert isinstance(model, Network)
    return Layers(**{name: getattr(model, name) for name in model.fields}, kernel=False)
