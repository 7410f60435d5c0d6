"""Noise by target and by axis: which one is clearly noisier than the others."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibtool.calibration.calibration import Calibration, fitting_setup
from calibtool.errors import InputError
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import observation_matrix, residuals, weights
from calibtool.robot.se3 import Array

_RARE = 1e-3  # probability below which a difference is not chance
_CLEAR = 1.3  # times the others' noise: a smaller ratio does not matter, and may come from the fit
_FEWEST = 15  # number of rows; fewer do not show how uncertain a ratio is
_FLOOR = 1e-3  # of the mean variance: smallest variance of a group
# of the largest eigenvalue of the shares: below it, the variance of a group cannot be separated
_SEPARATE = 0.05
# Rms of the residuals in multiples of the stated noise: up to the first, axes are compared by whole
# residuals; from the second on, whole residuals show no difference of noise.
_AS_STATED, _DESCRIBED = 1.5, 3.0

Kind = Literal["target", "position axis", "orientation axis"]


@dataclass(frozen=True)
class NoiseGroup:
    """Coordinates of one target, or along one axis of the instrument.

    name        such as `2` of a target, `z` of an axis
    rms         of the residuals, m or rad
    ratio       its noise over that of the others of its kind
    p           probability of such a ratio or a larger one by chance, for all groups together
    separated  whether the noise could be separated from errors beyond the model
    """

    kind: Kind
    name: str
    rms: float
    ratio: float
    p: float
    separated: bool

    @property
    def noisier(self) -> bool:
        """Whether it is clearly noisier than the others."""
        return self.p <= _RARE and self.ratio >= _CLEAR

    @property
    def called(self) -> str:
        """The group for people."""
        if self.kind == "target":
            return f"target {self.name}"
        of = "orientation about" if self.kind == "orientation axis" else "position along"
        return f"{of} axis {self.name} of the instrument"

    @property
    def unit(self) -> str:
        """Unit in which people see `rms`."""
        return "mrad" if self.kind == "orientation axis" else "mm"

    def __str__(self) -> str:
        doubt = "" if self.separated else ", or the model leaves more there"
        return (
            f"{self.called} is {self.ratio:.2g} times as noisy as the others "
            f"(p = {self.p:.1g}){doubt}"
        )

    def as_json(self) -> dict[str, object]:
        """The group as a plain object."""
        return {
            "kind": self.kind,
            "name": self.name,
            f"rms_{self.unit}": self.rms * 1e3,
            "noise_ratio": self.ratio,
            "p_value": self.p,
        }


def noise_groups(calibration: Calibration, measurements: Measurements) -> list[NoiseGroup]:
    """Residuals of measurements by target and by axis of the instrument, compared with each other.

    With three or more targets in a row, the part that a motion of the tool explains and the mean of
    each target in the tool frame are subtracted. The rest is noise alone, r' = Q r, and the
    variances v_g of the groups solve Σ r'_i² (i in g) = Σ_h v_h Σ Q_ij² (i in g, j in h). The whole
    residual is used where this does not separate the groups, for fewer targets, or, for axes, where
    it is less than 1.5 times the stated noise. It is never used where it is more than three times
    that, or where the base model does not describe every family (p = 1). A variance minus the mean
    of the others has the deviation of a jackknife over rows. Residuals are divided by their stated
    noise. The list is empty for other kinds of observation, another set-up, or fewer than 15 rows
    that saw all targets and close.
    """
    from scipy.special import stdtr

    if measurements.kind not in ("points", "pose"):
        return []
    try:
        setup = fitting_setup(calibration, measurements)
    except InputError:
        return []
    tool = calibration.forward(measurements.q, measurements.conditions)
    closes = np.isfinite(tool[:, 0, 0])
    whole = np.flatnonzero((weights(measurements) > 0).all(axis=-1) & closes)
    if len(whole) < _FEWEST:
        return []
    rows, tool, kind = measurements.rows(whole), tool[whole], setup.kind
    scale = weights(rows)

    def in_axes(columns: Array) -> Array:
        return kind.in_axes(setup, columns, rows.place)

    residual = residuals(rows, setup, tool)
    plain = in_axes(residual[..., None])[..., 0]
    d, targets = residual.shape[1], len(setup.targets)
    whole_residual = plain * scale, np.broadcast_to(np.eye(d), (len(residual), d, d))
    ways = [whole_residual]
    if targets > 2:
        R = tool[:, None, :3, :3]
        apart = residual.reshape(len(residual), targets, 3, 1)
        apart = apart - R @ (np.swapaxes(R, -1, -2) @ apart).mean(axis=0)
        P = in_axes(observation_matrix(setup, tool, rows.place)) * scale[..., None]
        noise = in_axes(apart.reshape(*residual.shape, 1))[..., 0] * scale
        ways = [(noise, whole_residual[1] - P @ np.linalg.pinv(P, rcond=1e-6)), whole_residual]
    lengths, coordinates = kind.lengths(setup), np.arange(d)
    numbers = [str(i + 1) for i in range(targets)]
    kinds: list[tuple[Kind, np.ndarray, list[str]]] = [
        ("target", np.where(lengths, coordinates // 3, -1), numbers),
        ("position axis", np.where(lengths, coordinates % 3, -1), list("xyz")),
        ("orientation axis", np.where(lengths, -1, coordinates % 3), list("xyz")),
    ]
    kinds = [each for each in kinds if len(each[2]) > 1 and (each[1] >= 0).any()]
    tests = sum(len(names) for _, _, names in kinds)
    size = float(np.sqrt((whole_residual[0] ** 2).mean()))
    size = np.inf if calibration.base.posterior is None else size  # what it leaves is no noise
    found = []
    for each, group, names in kinds:
        *rigid, whole_shown = [_Shown.of(noise, Q, group, len(names)) for noise, Q in ways]
        separated = any(way.separate for way in rigid) and (each == "target" or size > _AS_STATED)
        ratios, sizes = (rigid[0] if separated else whole_shown).compared()
        for g, name in enumerate(names):
            rms = float(np.sqrt((plain[:, group == g] ** 2).mean()))
            p = min(1.0, tests * float(stdtr(len(rows) - 1, -sizes[g])))
            p = p if separated or size < _DESCRIBED else 1.0
            found.append(NoiseGroup(each, name, rms, float(ratios[g]), p, separated))
    return found


@dataclass(frozen=True, eq=False)
class _Shown:
    """What rows show of the variances of groups.

    powers  (N, count) Σ r'_i² of each group
    shares  (N, count, count) Σ Q_ij²
    """

    powers: Array
    shares: Array

    @classmethod
    def of(cls, noise: Array, Q: Array, group: np.ndarray, count: int) -> "_Shown":
        """noise (N, d), Q (N, d, d), group (d,) number, or −1 for coordinates of another kind."""
        kept = np.flatnonzero(group >= 0)
        member = (group[kept] == np.arange(count)[:, None]).astype(float)
        Q = Q[:, kept][:, :, kept]
        r = (Q @ noise[:, kept, None])[..., 0]
        return cls(r**2 @ member.T, member @ Q**2 @ member.T)

    @property
    def separate(self) -> bool:
        """Whether every variance is seen by itself."""
        sizes = np.linalg.eigvalsh(self.shares.sum(axis=0))
        return bool(sizes[0] > _SEPARATE * sizes[-1])

    def compared(self) -> tuple[Array, Array]:
        """Noise of each group over that of the others (count,), and the difference of their
        variances over its standard deviation.
        """
        powers, shares = self.powers.sum(axis=0), self.shares.sum(axis=0)
        variances, others = _beside_others(powers, shares)
        without = np.subtract(*_beside_others(powers - self.powers, shares - self.shares))
        n = len(self.powers)
        deviation = np.sqrt((n - 1) / n * ((without - without.mean(axis=0)) ** 2).sum(axis=0))
        floor = _FLOOR * max(float(variances.mean()), 1e-300)
        ratios = np.sqrt(np.maximum(variances, floor) / np.maximum(others, floor))
        sizes = (variances - others) / np.maximum(deviation, 1e-300)
        return ratios.astype(float), sizes.astype(float)


def _beside_others(powers: Array, shares: Array) -> tuple[Array, Array]:
    """Variances (…, count) and the means of the others'."""
    variances: Array = (np.linalg.pinv(shares) @ powers[..., None])[..., 0]
    others = (variances.sum(axis=-1, keepdims=True) - variances) / (variances.shape[-1] - 1)
    return variances, np.asarray(others)
