"""Joint values of a second arm, whose sensor sees the tool: columns `second_j1_deg …`."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calibtool.errors import InputError
from calibtool.joint_and_pose_columns import joint_columns_of, joint_positions, unit_of
from calibtool.measurement.measurements import Measurements
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly
from calibtool.tables import Table

PREFIX = "second_"


class SecondArm(NamedTuple):
    """A second arm, and T_base2_flange2 (N, 4, 4) for its joint positions (N, n), rad or m."""

    robot: Robot
    forward: Callable[[Array], Array]


def seen_from(measurements: Measurements, table: Table, arm: SecondArm) -> Measurements:
    """The same points as those of a sensor on the second arm, whose pose changes with every row.

    Raises InputError where its joint values are missing, or where no points were measured.
    """
    if measurements.kind != "points" or measurements.place is not None:
        raise InputError(
            f"{table.name}: a second arm sees target points, without stations: "
            f"this holds {measurements.setup.kind.words.format(m=1)}"
        )
    header = [column.removeprefix(PREFIX) if is_second(column) else "" for column in table.header]
    own = replace(table, header=header)
    columns = joint_columns_of(own, arm.robot)
    if columns is None:
        raise InputError(
            f"{table.name}: no joint values of the second arm: expected "
            f"{PREFIX}{arm.robot.columns(None)[0]} …"
        )
    q = joint_positions(own, arm.robot, columns, [unit_of(column) for column in columns])
    count = len(measurements)
    setup = replace(
        measurements.setup,
        frame_known=False,
        targets_known=False,
        places=tuple(str(row + 1) for row in range(count)),
        T_base2_flange2=readonly(arm.forward(q)),
        T_flange2_sensor=readonly(np.eye(4)),
        T_base_base2=readonly(np.eye(4)),
    )
    return replace(measurements, setup=setup, place=np.arange(count))


def is_second(column: str) -> bool:
    """Whether a column is one of the second arm's."""
    return column.startswith(PREFIX)
