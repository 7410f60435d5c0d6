"""Pose errors of one method, summarised."""

from dataclasses import dataclass

import numpy as np

from calibtool.robot.se3 import Array

STATISTICS = ("mean", "std", "rms", "p95", "max")


@dataclass(frozen=True, eq=False)
class MethodErrors:
    """Signed pose errors of a method, one row per configuration.

    position     (N, m, 3) actual minus commanded (or measured minus predicted) displacements in K_0, m; m points
    orientation  (N, 3) the same as rotation vectors in K_0, rad; None where the instrument does not see it
    """

    name: str
    position: Array
    orientation: Array | None

    @property
    def position_size(self) -> Array:
        """Position error of each configuration: length, RMS over its points. (N,) m"""
        return np.sqrt((self.position**2).sum(axis=-1).mean(axis=-1))

    @property
    def orientation_size(self) -> Array | None:
        """Orientation error of each configuration: rotation angle. (N,) rad"""
        return None if self.orientation is None else np.linalg.norm(self.orientation, axis=-1)


def statistics(values: Array, unit: float) -> dict[str, float]:
    """mean, std, rms, p95 and max of (N,) values, divided by `unit`."""
    scaled = values / unit
    return {
        "mean": float(scaled.mean()),
        "std": float(scaled.std()),
        "rms": float(np.sqrt((scaled**2).mean())),
        "p95": float(np.percentile(scaled, 95)),
        "max": float(scaled.max()),
    }


def summary(method: MethodErrors, nominal: MethodErrors) -> dict[str, object]:
    """One entry of `methods` in the JSON of `evaluate`: statistics and reductions against the nominal robot."""
    position, before = statistics(method.position_size, 1e-3), statistics(nominal.position_size, 1e-3)
    parts = ("mean", "max", "std")
    reduction: dict[str, float | None] = {f"position_{s}": _reduction(before[s], position[s]) for s in parts}
    reduction |= {f"orientation_{s}": None for s in parts}
    orientation = None
    if method.orientation_size is not None and nominal.orientation_size is not None:
        orientation = statistics(method.orientation_size, 1e-3)
        before = statistics(nominal.orientation_size, 1e-3)
        reduction |= {f"orientation_{s}": _reduction(before[s], orientation[s]) for s in parts}
    return {
        "name": method.name,
        "position_mm": position,
        "orientation_mrad": orientation,
        "reduction_percent": reduction,
    }


def _reduction(before: float, after: float) -> float:
    return 100.0 * (1.0 - after / before) if before > 0 else 0.0


def error_rows(methods: list[MethodErrors]) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a table of signed errors: one row per method and configuration, targets side by side."""
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
        rows += [[method.name, str(k + 1), *(f"{v * 1e3:.9g}" for v in row)] for k, row in enumerate(values)]
    return header, rows
