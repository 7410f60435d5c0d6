"""Offsets of the zero positions of one joint or of all joints that explain the points."""

from dataclasses import dataclass, replace

import numpy as np

from calibtool.measurement.checks.finding import Finding, Numbers
from calibtool.measurement.checks.nominal_fit import nominal_fit
from calibtool.measurement.gauss_newton import gauss_newton
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import linearised, weighted_residuals
from calibtool.measurement.registration import update_setup
from calibtool.measurement.sampling import spread_rows
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import Array, readonly
from calibtool.units import millimetres

_GRID = np.deg2rad([30.0, 60.0, 90.0, 120.0, 150.0, 180.0, -150.0, -120.0, -90.0, -60.0, -30.0])
_SMALLEST = np.deg2rad(0.3)  # rad, or 5.2 mm for a slide: smaller offsets are no mistake
_ROUND, _ALIKE = np.deg2rad(15.0), 1.5
_FEW_ROWS = 30  # number of rows on which offsets all round the circle are tried
_ITERATIONS = 30


@dataclass(frozen=True, eq=False)
class Zeros:
    """Offsets (n,) to add to the joint values, rad or m, with which the points fit to an rms, m."""

    measurements: Measurements
    offsets: Array
    rms: float

    def finding(self, before: float) -> Finding:
        """The finding: which joints, and their offsets."""
        robot = self.measurements.robot
        units = [("mm", 1e3) if p else ("deg", 180.0 / np.pi) for p in robot.prismatic]
        size = self.offsets * [factor for _, factor in units]
        joints = np.flatnonzero(np.abs(self.offsets) > 1e-9).tolist()
        corrections = [f"{abs(size[j]):.4g} {units[j][0]} off (add {size[j]:+.4g})" for j in joints]
        text = ", ".join(
            f"the zero position of joint {j + 1} is {what}"
            for j, what in zip(joints, corrections, strict=True)
        )
        message = (
            f"the nominal robot fits the points to {millimetres(before)} rms, but to "
            f"{millimetres(self.rms)} if {text}"
        )
        numbers: Numbers = {
            "joints": [int(j) + 1 for j in joints],
            "add_deg_or_mm": [float(size[j]) for j in joints],
            "rms_mm": before * 1e3,
            "repaired_rms_mm": self.rms * 1e3,
        }
        return Finding("joint_zero", "warning", message, numbers)


def zero_of_one_joint(measurements: Measurements, *, grid: bool) -> Zeros | None:
    """The joint whose offset explains the points best; with `grid`, offsets over the whole turn are
    tried.

    None where no offset is large enough to be a mistake, or where only the outer joints could show
    it.
    """
    robot, best = measurements.robot, None
    few = measurements.rows(spread_rows(len(measurements), _FEW_ROWS))
    for j in range(robot.n):
        start = 0.0
        if grid and not robot.prismatic[j]:
            start = min(
                (nominal_fit(_moved(few, j, offset), free=True).rms, offset)
                for offset in (0.0, *_GRID)
            )[1]
        found = _fitted(measurements, [j], start)
        found = _rounded(found, j) if grid else found
        if abs(found.offsets[j]) > _SMALLEST and (best is None or found.rms < best.rms):
            best = found
    return best


def zeros_of_all_joints(measurements: Measurements) -> Zeros | None:
    """Offsets of all joints that explain the points best, None where there are too few points."""
    if measurements.equations < 3 * (measurements.robot.n + 6 + len(measurements.setup.free_names)):
        return None
    return _fitted(measurements, list(range(measurements.robot.n)), 0.0)


def _rounded(found: Zeros, j: int) -> Zeros:
    """A multiple of 15 deg if it explains the points as well, despite the arm's errors."""
    if found.measurements.robot.prismatic[j]:
        return found
    whole = np.zeros_like(found.offsets)
    whole[j] = np.round(found.offsets[j] / _ROUND) * _ROUND
    if abs(whole[j] - found.offsets[j]) > _SMALLEST or not whole[j]:
        return found
    rms = nominal_fit(_moved(found.measurements, j, whole[j]), free=True).rms
    return Zeros(found.measurements, whole, rms) if rms < _ALIKE * found.rms else found


def _moved(measurements: Measurements, j: int, offset: float) -> Measurements:
    q = measurements.q.copy()
    q[:, j] += offset
    return replace(measurements, q=readonly(q))


def _fitted(measurements: Measurements, joints: list[int], start: float) -> Zeros:
    """Gauss–Newton iteration over the offsets of some joints, instrument frame and targets."""
    points = measurements.points_alone()
    setup = replace(points.setup, frame_known=False, targets_known=False)
    offsets = np.zeros(measurements.robot.n)
    offsets[joints] = start
    first = nominal_fit(replace(points, q=readonly(points.q + offsets), setup=setup), free=True)
    k, mechanism = len(joints), measurements.robot.mechanism

    def linearise(state: tuple[Array, Setup]) -> tuple[Array, Array]:
        T, jacobian = mechanism.forward_and_jacobian(points.q + state[0])
        frame = np.broadcast_to(np.eye(6), (len(T), 6, 6))
        columns = np.concatenate([jacobian[:, :, joints], frame], axis=-1)
        return linearised(points, state[1], T, columns, targets=True)

    def solve(system: tuple[Array, Array], _: float) -> tuple[Array, bool]:
        columns, residual = system
        flat = columns.reshape(-1, columns.shape[-1])
        step = np.linalg.lstsq(flat, residual.ravel(), rcond=1e-6)[0]
        return step.astype(float), bool(np.abs(step).max() < 1e-8)

    def move(state: tuple[Array, Setup], step: Array) -> tuple[Array, Setup]:
        moved = state[0].copy()
        moved[joints] += step[:k]
        return moved, update_setup(state[1], step[k : k + 6], step[k + 6 :])

    def cost(state: tuple[Array, Setup]) -> float:
        return float((_residual(points, state) ** 2).sum())

    state, _, _ = gauss_newton((offsets, first.setup), linearise, solve, move, _ITERATIONS, cost)
    rms = float(np.sqrt(cost(state) / points.seen.sum())) * points.noise_position
    return Zeros(measurements, state[0], rms if np.isfinite(first.rms) else np.inf)


def _residual(points: Measurements, state: tuple[Array, Setup]) -> Array:
    return weighted_residuals(points, state[1], points.robot.mechanism.forward(points.q + state[0]))
