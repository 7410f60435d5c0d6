"""Common part of the corrections in the frames of the fit, and the remaining errors."""

from dataclasses import dataclass, replace

import numpy as np

from calibtool.calibration.calibration import Calibration
from calibtool.calibration.frame import FrameName
from calibtool.robot.se3 import Array, log3, pose_distances
from calibtool.units import millimetres, rounded


@dataclass(frozen=True, eq=False)
class FrameReport:
    """The common part of corrections, and the remaining errors at the N configurations used.

    name         chosen frames, `fitted` or `taught`
    base, tool   (6,) displacement (m) and rotation vector (rad) of the base and of the tool frame
    position     (N,) distances of the tool point from the nominal robot's in the taught frames, m
    orientation  (N,) rotation angles likewise, rad
    """

    name: FrameName
    base: Array
    tool: Array
    position: Array
    orientation: Array

    def as_json(self) -> dict[str, object]:
        """The object `frame` of a calibration's summary."""
        result: dict[str, object] = {"name": self.name}
        for part in ("base", "tool"):
            values = getattr(self, part)
            result[f"common_{part}_mm"] = rounded(values[:3] * 1e3)
            result[f"common_{part}_rotation_vector_deg"] = rounded(np.rad2deg(values[3:]))
        for key, values in (("apart_mm", self.position), ("apart_mrad", self.orientation)):
            result[key] = {"rms": _rms(values) * 1e3, "max": float(values.max()) * 1e3}
        return result

    def lines(self) -> list[str]:
        """The same as lines of text."""
        if self.name == "taught":
            chosen = "taught: base and tool are placed such that taught poses move least"
        else:
            chosen = "fitted: every commanded pose moves by the common part, too"
        return [
            f"frame {chosen}; common part of all errors: {self.common}",
            f"apart from it the robot is {millimetres(_rms(self.position))} and "
            f"{_rms(self.orientation) * 1e3:.3g} mrad rms from the drawing, at most "
            f"{millimetres(self.position.max())} and {self.orientation.max() * 1e3:.3g} mrad",
        ]

    @property
    def common(self) -> str:
        """The common part as text."""
        sizes = []
        for name, part in (("base", self.base), ("tool", self.tool)):
            shift, turn = np.linalg.norm(part.reshape(2, 3), axis=-1)
            sizes.append(f"{name} {millimetres(shift)}, {np.rad2deg(turn):.3g} deg")
        return "; ".join(sizes)


def frame_report(calibration: Calibration) -> FrameReport | None:
    """Common part and remaining errors of the base model; None where no frame is free."""
    if not calibration.frame_is_free:
        return None
    taught = replace(calibration, networks=()).in_frame("taught")
    assert taught.frame is not None
    pose, nominal = taught.forward(taught.q), taught.robot.mechanism.forward(taught.q)
    position, orientation = pose_distances(pose, nominal)
    return FrameReport(
        name="fitted" if calibration.frame is None else calibration.frame.name,
        base=_moved(taught.frame.T_taught_fitted),
        tool=_moved(taught.frame.T_tool_taught),
        position=position,
        orientation=orientation,
    )


def _moved(pose: Array) -> Array:
    return np.concatenate([pose[:3, 3], log3(pose[:3, :3])])


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))
