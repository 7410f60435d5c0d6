"""Pose errors of one method and their statistics."""

from dataclasses import asdict, dataclass

import numpy as np

from calibtool.robot.se3 import Array

STATISTICS = ("mean", "std", "rms", "p95", "max")


@dataclass(frozen=True, eq=False)
class MethodErrors:
    """Signed pose errors of a method, one row per configuration.

    position     (N, m, 3) actual minus commanded (or measured minus predicted) displacements in
                 K_0, m; m points
    orientation  (N, 3) the same as rotation vectors in K_0, rad; None where the
                 instrument does not see it
    """

    name: str
    position: Array
    orientation: Array | None

    @property
    def position_size(self) -> Array:
        """Position error of each configuration: RMS length over its points, (N,) m."""
        squared: Array = (self.position**2).sum(axis=-1).mean(axis=-1)
        return np.sqrt(squared)

    @property
    def orientation_size(self) -> Array | None:
        """Orientation error of each configuration: rotation angle, (N,) rad."""
        return None if self.orientation is None else np.linalg.norm(self.orientation, axis=-1)


@dataclass(frozen=True)
class Statistics:
    """Statistics of N errors, in their unit: mean, std (of the population), rms, p95 (the 95th
    percentile) and max.
    """

    mean: float
    std: float
    rms: float
    p95: float
    max: float

    @classmethod
    def of(cls, values: Array) -> "Statistics":
        """Statistics of (N,) values."""
        return cls(
            mean=float(values.mean()),
            std=float(values.std()),
            rms=float(np.sqrt((values**2).mean())),
            p95=float(np.percentile(values, 95)),
            max=float(values.max()),
        )


@dataclass(frozen=True, eq=False)
class MethodResult:
    """What an evaluation found of one method.

    errors       its whole errors
    correctable  the part that moving the joints can remove; `errors` where that is all
    marked       how many rows were corrected in part, or not at all (`status.DOUBTFUL`)
    outside      how many rows are unlike the configurations of the training
    """

    errors: MethodErrors
    correctable: MethodErrors
    marked: int = 0
    outside: int = 0

    @property
    def name(self) -> str:
        """Name of the method."""
        return self.errors.name

    @property
    def position(self) -> Statistics:
        """Statistics of the position errors of the configurations, m."""
        return Statistics.of(self.errors.position_size)

    @property
    def orientation(self) -> Statistics | None:
        """The same of the orientation errors, rad; None where the instrument does not see them."""
        turned = self.errors.orientation_size
        return None if turned is None else Statistics.of(turned)

    def __repr__(self) -> str:
        position = self.position
        return (
            f"<{self.name}: position error {position.mean * 1e3:.3g} mm on average, "
            f"at most {position.max * 1e3:.3g} mm>"
        )


def summary(
    method: MethodErrors, nominal: MethodErrors, whole: MethodErrors | None = None
) -> dict[str, object]:
    """One entry of `methods` in the JSON of `evaluate`: statistics, and reductions against
    the nominal robot.

    whole: the errors for the statistics, where `method` and `nominal` are only the part that the
    joints can correct.
    """
    return {
        "name": method.name,
        **pose_statistics(whole or method),
        "reduction_percent": _reductions(method, nominal),
    }


def pose_statistics(method: MethodErrors) -> dict[str, dict[str, float] | None]:
    """Objects `position_mm` and `orientation_mrad` (None if not measured)."""
    turned = method.orientation_size
    return {
        "position_mm": asdict(Statistics.of(method.position_size / 1e-3)),
        "orientation_mrad": None if turned is None else asdict(Statistics.of(turned / 1e-3)),
    }


def _reductions(method: MethodErrors, nominal: MethodErrors) -> dict[str, float | None]:
    found, before = pose_statistics(method), pose_statistics(nominal)
    result: dict[str, float | None] = {}
    for name, key in (("position", "position_mm"), ("orientation", "orientation_mrad")):
        a, b = before[key], found[key]
        result |= {
            f"{name}_{s}": None if a is None or b is None else _reduction(a[s], b[s])
            for s in ("mean", "max", "std")
        }
    return result


def _reduction(before: float, after: float) -> float:
    return 100.0 * (1.0 - after / before) if before > 0 else 0.0


def error_rows(methods: list[MethodErrors]) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a table of signed errors, one row per method and configuration."""
    points = methods[0].position.shape[1]
    parts = [""] if points == 1 else [f"t{i + 1}_" for i in range(points)]
    header = ["method", "configuration", *(f"{part}d{axis}_mm" for part in parts for axis in "xyz")]
    oriented = methods[0].orientation is not None
    if oriented:
        header += ["rx_mrad", "ry_mrad", "rz_mrad"]
    rows = []
    for method in methods:
        values = method.position.reshape(len(method.position), -1)
        if oriented and method.orientation is not None:
            values = np.concatenate([values, method.orientation], axis=-1)
        rows += [
            [method.name, str(k + 1), *(f"{v * 1e3:.9g}" for v in row)]
            for k, row in enumerate(values)
        ]
    return header, rows
