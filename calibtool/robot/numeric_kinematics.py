"""Kinematics that robot.toml holds as numbers, as a URDF."""

from math import radians
from typing import TYPE_CHECKING

from calibtool.errors import InputError
from calibtool.robot.constant_placements import Step, chain_urdf, near_frames
from calibtool.robot.denavit_hartenberg import DhText, read_dh, steps_of
from calibtool.units import joint_and_factor

if TYPE_CHECKING:
    from calibtool.robot.description import Description, Placement


def numbers_as_urdf(description: "Description", place: str) -> str:
    """The URDF of `chain` or `dh` of a description, with its [limits]; InputError with `place`."""
    kinematics = description.kinematics
    axes = None
    if kinematics.dh is not None and kinematics.dh_convention is not None:
        # Every row has the columns of the first one, as in a table.
        header = list(kinematics.dh[0]) if kinematics.dh else []
        places = [f"{place}: kinematics.dh, row {k + 1}" for k in range(len(kinematics.dh))]
        for row, where in zip(kinematics.dh, places, strict=True):
            if set(row) != set(header):
                raise InputError(f"{where}: has {', '.join(row)}; the first row {header}")
        cells = [[_cell(row[column]) for column in header] for row in kinematics.dh]
        table = read_dh(DhText(place, header, cells, places))
        steps = near_frames(steps_of(table, kinematics.dh_convention))
        slides = table.prismatic or [False] * len(table.joints)
    else:
        chain = kinematics.chain or []
        moving = [each for each in chain if each.type != "fixed"]
        slides = [each.type == "prismatic" for each in moving]
        axes = [each.axis for each in moving]
        steps = [[]]
        for each in chain:
            steps[-1].append(_step(each))
            if each.type != "fixed":
                steps.append([])
    limits = {}
    for name, (low, high) in description.limits.items():
        joint, factor = joint_and_factor(name, slides, f"{place}: limits")
        limits[joint] = (low * factor, high * factor)
    return chain_urdf(steps, slides, description.name, limits, axes)


def _cell(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.17g}"


def _step(placement: "Placement") -> Step:
    x, y, z = (value * 1e-3 for value in placement.xyz_mm)
    roll, pitch, yaw = (radians(value) for value in placement.rpy_deg)
    return Step((x, y, z), (roll, pitch, yaw))
