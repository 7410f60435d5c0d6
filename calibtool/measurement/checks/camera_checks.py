"""Mistakes with boards and cameras: squares of another size, mirrored images."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from calibtool.measurement.checks.finding import Finding, Numbers
from calibtool.measurement.checks.nominal_fit import nominal_fit
from calibtool.measurement.kinds import BoardPose, CornersFromBeside
from calibtool.measurement.kinds.corners import Corners
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.sampling import spread_rows
from calibtool.robot.se3 import Array, inverse, readonly
from calibtool.units import millimetres

_BETTER = 3.0  # how much better the readings must be explained before a mistake is named
_OTHER = 0.01  # smallest change of a scale that is named
_SCALES = np.geomspace(0.03, 30.0, 11)  # tried first: inches instead of mm, mm instead of cm
_OF_SPREAD = 0.15  # of the board's motion in the camera: a larger residual is no error of an arm
_MOST_ROWS = 25
_MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])


def camera_findings(measurements: Measurements) -> list[Finding]:
    """The size of the board's squares, or a mirrored image, that would explain the readings."""
    few = measurements.rows(spread_rows(len(measurements), _MOST_ROWS))
    if (poses := _camera_poses(few)) is None:
        return []
    on_tool = not isinstance(few.setup.kind, CornersFromBeside)

    def rms(seen: Array, scale: float = 1.0) -> float:
        points = (inverse(seen) if on_tool else seen)[:, None, :3, 3]
        return nominal_fit(_as_points(few, scale * points), free=False).rms

    before = rms(poses)
    scale = _best_scale(poses, rms)
    found = []
    if abs(scale - 1) > _OTHER and rms(poses, scale) * _BETTER < before:
        after = rms(poses, scale)
        message = (
            f"the board is {scale:.4g} times as large as stated: the size of its squares or the "
            f"unit of its poses is wrong; the nominal robot fits them to {millimetres(after)} rms "
            f"instead of {before * 1e3:.3g}"
        )
        numbers: Numbers = {"scale": scale, "rms_mm": before * 1e3, "repaired_rms_mm": after * 1e3}
        found.append(Finding("board_scale", "warning", message, numbers))
    elif isinstance(few.setup.kind, Corners) and rms(_MIRROR @ poses @ _MIRROR) * _BETTER < before:
        after = rms(_MIRROR @ poses @ _MIRROR)
        message = (
            "the images are mirrored: with left and right exchanged the nominal robot explains "
            f"them to {millimetres(after)} rms instead of {before * 1e3:.3g}"
        )
        numbers = {"rms_mm": before * 1e3, "repaired_rms_mm": after * 1e3}
        found.append(Finding("mirrored_images", "warning", message, numbers))
    elif before > _OF_SPREAD * (spread := float(np.std(poses[:, :3, 3], axis=0).max())):
        message = (
            f"the nominal robot fits the board to {millimetres(before)} rms, which moves by "
            f"{millimetres(spread)} only: check where camera and board are (on the tool, or beside "
            "the arm), the zeros of the joints, and that rows and images belong together"
        )
        numbers = {"rms_mm": before * 1e3, "spread_mm": spread * 1e3}
        found.append(Finding("nominal_robot", "warning", message, numbers))
    return found


def _camera_poses(measurements: Measurements) -> Array | None:
    """Poses of the board in the camera (N, 4, 4), None for other kinds of observation."""
    kind, readings = measurements.setup.kind, measurements.readings
    if isinstance(kind, Corners):
        return kind.poses(readings, measurements.setup)
    if not isinstance(kind, BoardPose) or readings.rotations is None:
        return None
    poses = np.tile(np.eye(4), (len(measurements), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = readings.rotations, readings.points[:, 0]
    return poses


def _as_points(measurements: Measurements, points: Array) -> Measurements:
    """The same rows with points (N, 1, 3) of one target, seen from unknown places."""
    names = dict.fromkeys(measurements.setup.kind.arrays)
    places = len(measurements.places)
    frames = np.tile(np.eye(4), (places - 1, 1, 1)) if places > 1 else None
    setup = replace(
        measurements.setup,
        **names,  # type: ignore[arg-type]
        further_frames=None if frames is None else readonly(frames),
    )
    return replace(
        measurements,
        points=readonly(points),
        rotations=None,
        values=None,
        deviations=None,
        truth=None,
        setup=setup,
    )


def _best_scale(poses: Array, rms: Callable[[Array, float], float]) -> float:
    """The scale with which the nominal robot explains the poses best."""
    sizes = [rms(poses, scale) for scale in _SCALES]
    k = int(np.clip(np.argmin(sizes), 1, len(_SCALES) - 2))
    low, high = np.log(_SCALES[k - 1]), np.log(_SCALES[k + 1])
    result = minimize_scalar(
        lambda log: rms(poses, float(np.exp(log))),
        bounds=(low, high),
        method="bounded",
        options={"xatol": 1e-3, "maxiter": 15},
    )
    return float(np.exp(result.x))
