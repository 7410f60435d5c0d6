"""Coupled joint values: a controller may show joint positions that are not those of the serial chain."""

from typing import Literal

import numpy as np

from calibtool.errors import InputError
from calibtool.robot.description import Description
from calibtool.robot.se3 import Array, readonly

JointValues = Literal["serial", "controller"]
JOINT_VALUES = ("serial", "controller")

_SMALLEST_CONDITION = 1e-6  # smallest singular value over the largest: below it a joint value cannot be told


def coupling_matrix(description: Description, n: int, place: str) -> Array:
    """C (n, n) of q_serial = C · q_controller, both in rad or m; the identity unless the description has a [coupling].

    Raises InputError for a matrix of another shape, one that cannot be inverted, or an unknown joint.
    """
    coupling = description.coupling
    if coupling is None:
        return readonly(np.eye(n))
    if coupling.matrix is not None:
        lengths = {len(row) for row in coupling.matrix}
        if len(coupling.matrix) != n or lengths != {n}:
            shape = f"{len(coupling.matrix)} rows of {' and '.join(map(str, sorted(lengths)))}"
            raise InputError(
                f"{place}: coupling.matrix has {shape} numbers; the robot has {n} joints, so give {n} x {n}"
            )
        return _invertible(np.array(coupling.matrix), f"{place}: coupling.matrix")
    matrix = np.eye(n)
    for name, terms in coupling.add.items():
        for other, factor in terms.items():
            j, k = (_joint(each, n, f"{place}: coupling.add") for each in (name, other))
            if j == k:
                raise InputError(f"{place}: coupling.add.{name} names itself; name the joints that are added to it")
            matrix[j, k] = factor
    return _invertible(matrix, f"{place}: coupling.add")


def _joint(name: str, n: int, place: str) -> int:
    index = int(name[1:]) - 1
    if index >= n:
        raise InputError(f"{place}: unknown joint '{name}'; the robot has j1 to j{n}")
    return index


def _invertible(matrix: Array, place: str) -> Array:
    sizes = np.linalg.svd(matrix, compute_uv=False)
    if not sizes[-1] > _SMALLEST_CONDITION * sizes[0]:
        raise InputError(f"{place} is singular: joint values cannot be converted back; check its rows")
    return readonly(matrix)
