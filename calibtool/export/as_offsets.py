"""A calibration as joint offsets alone, for the mastering, fitted to the calibrated robot."""

import numpy as np

from calibtool.calibration import Calibration
from calibtool.export.unrepresented_parts import not_held
from calibtool.export.urdf_geometry import joint_basis, urdf_geometry
from calibtool.robot.coupling import JointValues


def calibration_as_offsets(calibration: Calibration, values: JointValues) -> tuple[str, list[str]]:
    """A CSV with one offset per joint, and a line for each part that it does not hold.

    The offsets δq are those of T_nominal(q + δq) nearest to the calibrated robot, fitted as in
    `urdf_geometry` with all other parameters fixed. values: the kind of joint values that they
    change.
    """
    robot, basis = calibration.robot, joint_basis(calibration.robot)
    geometry = urdf_geometry(calibration, basis)
    missing = list(not_held(calibration, geometry, basis))
    n, twists = robot.n, robot.chain.twists
    serial = np.einsum("ij,ij->i", geometry["placements"][:n], twists[:n])
    offsets = robot.serial_as(values, serial[None])[0]
    lines = [
        f"# Joint offsets of {robot.name}, calibrated: a joint shown at q stands at q + offset.",
        "# Add the correction to the mastering position, or to what is commanded.",
        *(f"# not held: {line}" for line in missing),
        "joint,offset,correction,unit,values",
    ]
    for j, offset in enumerate(offsets.tolist(), start=1):
        unit, factor = ("mm", 1e3) if robot.prismatic[j - 1] else ("deg", 180.0 / np.pi)
        shown = offset * factor + 0.0
        lines.append(f"{j},{shown!r},{-shown + 0.0!r},{unit},{values}")
    return "\n".join(lines) + "\n", missing
