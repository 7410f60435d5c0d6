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
_CLEAR = 1.3  # times the others' noise: less is no matter, and may be the fit's own share
_FEWEST = 15  # rows; fewer do not tell how far a ratio is off
_FLOOR = 1e-3  # of the mean variance

Kind = Literal["target", "position axis", "orientation axis"]


@dataclass(frozen=True)
class NoiseGroup:
    """Coordinates of one target, or along one axis of the instrument.

    name        such as `2` of a target, `z` of an axis
    rms         of the residuals, m or rad
    ratio       its noise over that of the others of its kind
    p           probability of such a ratio or a larger one by chance, for all groups together
    told_apart  whether the noise was told apart from what the model leaves
    """

    kind: Kind
    name: str
    rms: float
    ratio: float
    p: float
    told_apart: bool

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
        doubt = "" if self.told_apart else ", or the model leaves more there"
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

    Of three targets and more in a row, what a motion of the tool explains is taken out before the
    targets are compared, and the mean of each target in the tool frame: what is left is noise
    alone, r' = Q r, and the variances v_g of the groups solve Σ r'_i² (i in g) = Σ_h v_h Σ Q_ij² (i
    in g, j in h). Otherwise the whole residual counts. A variance less the mean of the others has
    the deviation of a jackknife over rows. Residuals count over the noise that was stated for them.
    Nothing for other kinds of observation, another set-up, or fewer than 15 rows that saw all.
    """
    from scipy.special import stdtr

    if measurements.kind not in ("points", "pose"):
        return []
    try:
        setup = fitting_setup(calibration, measurements)
    except InputError:
        return []
    whole = np.flatnonzero((weights(measurements) > 0).all(axis=-1))
    if len(whole) < _FEWEST:
        return []
    rows = measurements.rows(whole)
    tool, scale, kind = calibration.forward(rows.q, rows.conditions), weights(rows), setup.kind

    def in_axes(columns: Array) -> Array:
        return kind.in_axes(setup, columns, rows.place)

    left = residuals(rows, setup, tool)
    plain = in_axes(left[..., None])[..., 0]
    d, targets = left.shape[1], len(setup.targets)
    every = np.broadcast_to(np.eye(d), (len(left), d, d))
    lengths, coordinates = kind.lengths(setup), np.arange(d)
    compared: list[tuple[Kind, np.ndarray, list[str], Array, Array]] = []
    if targets > 1:
        numbers = [str(i + 1) for i in range(targets)]
        noise, Q = plain * scale, every
        if targets > 2:
            R = tool[:, None, :3, :3]
            apart = left.reshape(len(left), targets, 3, 1)
            apart = apart - R @ (np.swapaxes(R, -1, -2) @ apart).mean(axis=0)
            noise = in_axes(apart.reshape(*left.shape, 1))[..., 0] * scale
            P = in_axes(observation_matrix(setup, tool, rows.place)) * scale[..., None]
            Q = every - P @ np.linalg.pinv(P, rcond=1e-6)
        compared.append(("target", coordinates // 3, numbers, noise, Q))
    along = np.where(lengths, coordinates % 3, -1)
    compared.append(("position axis", along, list("xyz"), plain * scale, every))
    if not lengths.all():
        about = np.where(lengths, -1, coordinates % 3)
        compared.append(("orientation axis", about, list("xyz"), plain * scale, every))
    tests = sum(len(names) for _, _, names, _, _ in compared)
    found = []
    for kind_of, group, names, noise, Q in compared:
        ratios, sizes = _compared(noise, Q, group, len(names))
        for g, name in enumerate(names):
            rms = float(np.sqrt((plain[:, group == g] ** 2).mean()))
            p = min(1.0, tests * float(stdtr(len(rows) - 1, -sizes[g])))
            told_apart = kind_of == "target" and targets > 2
            found.append(NoiseGroup(kind_of, name, rms, float(ratios[g]), p, told_apart))
    return found


def _compared(noise: Array, Q: Array, group: np.ndarray, count: int) -> tuple[Array, Array]:
    """Noise of each group over that of the others (count,), and the difference of their variances
    over its standard deviation; noise (N, d), Q (N, d, d), group (d,) number or −1.
    """
    kept = np.flatnonzero(group >= 0)
    member = (group[kept] == np.arange(count)[:, None]).astype(float)
    Q = Q[:, kept][:, :, kept]
    r = (Q @ noise[:, kept, None])[..., 0]
    powers, shares = r**2 @ member.T, member @ Q**2 @ member.T

    def beside_others(powers: Array, shares: Array) -> tuple[Array, Array]:
        variances: Array = (np.linalg.pinv(shares) @ powers[..., None])[..., 0]
        others: Array = (variances.sum(axis=-1, keepdims=True) - variances) / (count - 1)
        return variances, others

    variances, others = beside_others(powers.sum(axis=0), shares.sum(axis=0))
    without = np.subtract(*beside_others(powers.sum(axis=0) - powers, shares.sum(axis=0) - shares))
    n = len(r)
    deviation = np.sqrt((n - 1) / n * ((without - without.mean(axis=0)) ** 2).sum(axis=0))
    floor = _FLOOR * max(float(variances.mean()), 1e-300)
    ratios = np.sqrt(np.maximum(variances, floor) / np.maximum(others, floor)).astype(float)
    sizes = (variances - others) / np.maximum(deviation, 1e-300)
    return ratios, sizes.astype(float)
