"""Parts of a calibration that a format does not hold, each with its size at the tool."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from calibtool.calibration import Calibration
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.export.rendering import left_out
from calibtool.export.urdf_geometry import fitted_geometry
from calibtool.robot.se3 import Array, pose_distances

_NOTHING = 5e-8  # m or rad: less is 0.0000 mm in a line


def not_held(
    calibration: Calibration, held: RobotErrors, basis: Array | None = None
) -> Iterator[str]:
    """One line per part of a calibration that `held` does not contain, and one for all of them.

    Sizes are in mm and mrad at the tool. basis (6n+6, k): the directions in which the format holds
    placement errors, see `fitted_geometry`.
    """
    robot, q = calibration.robot, calibration.q
    whole, tool = calibration.forward(q), held.forward(q)
    if together := all_together(whole, tool):
        for name, part in _parts(calibration, () if basis is None else ("placements", "offsets")):
            alone = fitted_geometry(robot, part.forward, q, basis).forward(q)
            position, orientation = map(np.max, pose_distances(part.forward(q), alone))
            if max(position, orientation) > _NOTHING:
                yield f"{name}: up to {position * 1e3:.4f} mm, {orientation * 1e3:.4f} mrad alone"
        yield from together
    if left_out(calibration):
        yield left_out(calibration)


def all_together(whole: Array, held: Array) -> list[str]:
    """A line with the distance of poses (N, 4, 4) from those of a format; None if equal."""
    sizes = np.stack(pose_distances(whole, held), axis=-1)
    if sizes.max() <= _NOTHING:
        return []
    mean, most = sizes.mean(axis=0) * 1e3, sizes.max(axis=0) * 1e3
    return [
        f"all together: {mean[0]:.4f} mm, {mean[1]:.4f} mrad in the mean, "
        f"up to {most[0]:.4f} mm, {most[1]:.4f} mrad"
    ]


def _parts(calibration: Calibration, more: tuple[str, ...]) -> Iterator[tuple[str, Calibration]]:
    """The calibration with each single part that a format cannot hold completely."""
    base, none = calibration.base, RobotErrors.of(calibration.robot)
    for family in base.errors.present:
        if family.id not in ("placements", "offsets", "backlash") or family.id in more:
            alone = none.having(**{family.id: base.errors[family.id]})
            yield family.words, replace(calibration, base=replace(base, errors=alone), networks=())
    if calibration.networks:
        yield "network", replace(calibration, base=replace(base, errors=none))
