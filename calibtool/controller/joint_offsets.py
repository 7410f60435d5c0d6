"""Joint offsets of a mastering: the nominal arm whose joints stand beside what they show."""

from dataclasses import replace

import numpy as np

from calibtool.errors import InputError
from calibtool.robot.denavit_hartenberg import dh_text
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import exp6, readonly

_HEADER = "joint,offset,correction,unit,values"


def is_offsets(text: str) -> bool:
    """Whether a text starts like the offsets that `export` writes, after lines of comment."""
    lines = (line.strip() for line in text.removeprefix("\ufeff").splitlines())
    return next((line for line in lines if line and not line.startswith("#")), "") == _HEADER


def offsets_model(text: str, name: str, robot: Robot) -> Robot:
    """The nominal robot with joint offsets: T_nominal(q + δq).

    Raises InputError for another number of joints, a unit that is not the joint's, or a bad cell.
    """
    table = dh_text(text, name)
    labels, units, values = (table.texts(column) for column in ("joint", "unit", "values"))
    expected = ["mm" if slides else "deg" for slides in robot.prismatic]
    if labels != [str(j + 1) for j in range(robot.n)] or units != expected:
        raise InputError(
            f"{name}: joints {', '.join(labels)} in {', '.join(units)}; {robot.name} has 1 to "
            f"{robot.n} in {', '.join(expected)}"
        )
    if set(values) - {"serial", "controller"} or len(set(values)) != 1:
        raise InputError(f"{name}: values '{values[0]}'; expected serial or controller")
    factors = np.where(robot.prismatic, 1e-3, np.pi / 180.0)
    offsets = np.array(table.numbers("offset")) * factors
    serial = robot.to_serial(offsets) if values[0] == "controller" else offsets
    placements = robot.chain.placements.copy()
    placements[:-1] = placements[:-1] @ exp6(robot.chain.twists * serial[:, None])
    return replace(robot, chain=replace(robot.chain, placements=readonly(placements)))
