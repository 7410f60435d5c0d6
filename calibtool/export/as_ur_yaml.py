"""A calibration as the YAML file in which the UR driver stores the kinematics of an arm."""

import numpy as np

from calibtool.calibration import Calibration
from calibtool.errors import InputError
from calibtool.export.unrepresented_parts import not_held
from calibtool.export.urdf_geometry import check_without_loops, full_basis, urdf_geometry
from calibtool.robot.robot import Robot
from calibtool.robot.ur_frames import FRAMES
from calibtool.robot.urdf_text import roll_pitch_yaw
from calibtool.robot.z_axes import placements_between_z

_SAME = 1e-6  # m and rad


def calibration_as_ur_yaml(calibration: Calibration) -> tuple[str, list[str]]:
    """The text that `ur_frames` reads, and a line for each part that it does not hold.

    The placements of the six joints are fitted as in `urdf_geometry`, with the tool frame fixed:
    the YAML has no frame after the last joint. Raises InputError for another kind of arm, and for a
    tool frame whose z axis is not the last axis.
    """
    robot = calibration.robot
    _check(robot)
    basis = full_basis(robot)[:, : 6 * robot.n]
    geometry = urdf_geometry(calibration, basis)
    missing = list(not_held(calibration, geometry, basis))
    *frames, tool = placements_between_z(geometry.mechanism.placements, robot.chain.twists)
    frames[-1] = frames[-1] @ tool  # a turn about the last axis and a shift along it
    lines = [
        f"# Kinematics of {robot.name}, calibrated: from the controller's Base to the flange.",
        *(f"# not held: {line}" for line in missing),
        "kinematics:",
    ]
    for name, frame in zip(FRAMES, frames, strict=True):
        values = [*frame[:3, 3], *roll_pitch_yaw(frame[:3, :3])]
        keys = ("x", "y", "z", "roll", "pitch", "yaw")
        lines.append(f"  {name}:")
        lines += [
            f"    {key}: {float(value) + 0.0!r}" for key, value in zip(keys, values, strict=True)
        ]
    return "\n".join([*lines, "  hash: calibtool", ""]), missing


def _check(robot: Robot) -> None:
    check_without_loops(robot, "the YAML of the UR driver")
    if robot.n != len(FRAMES) or any(robot.prismatic):
        raise InputError(
            f"{robot.name}: the YAML of the UR driver is for an arm with six revolute joints"
        )
    tool = placements_between_z(robot.chain.placements, robot.chain.twists)[-1]
    if np.abs([*tool[:2, 3], *tool[:2, 2], tool[2, 2] - 1.0]).max() > _SAME:
        frame = robot.source.description.kinematics.tool_frame
        raise InputError(
            f"{robot.name}: the YAML of the UR driver ends at the flange, and the tool frame "
            f"'{frame}' is beside the last axis; calibrate to the flange (tool_frame in robot.toml)"
        )
