"""Coupled joint values: a controller may show other positions than those of the serial chain.

Whoever reads or writes joint values of such a robot has to state which ones they are; nothing is
assumed.
"""

from typing import Literal

import numpy as np

from calibtool.errors import InputError, UsageError, check_choice
from calibtool.robot.description import Description
from calibtool.robot.se3 import Array, readonly

JointValues = Literal["serial", "controller"]
JOINT_VALUES = ("serial", "controller")

# Smallest singular value over the largest: below it a joint value cannot be told
_SMALLEST_CONDITION = 1e-6


def coupling_matrix(description: Description, n: int, place: str) -> Array:
    """C (n, n) of q_serial = C · q_controller, both in rad or m; the identity unless the
    description has a [coupling].

    Raises InputError for a matrix of another shape, one that cannot be inverted, or
    an unknown joint.
    """
    coupling = description.coupling
    if coupling is None:
        return readonly(np.eye(n))
    if coupling.matrix is not None:
        lengths = {len(row) for row in coupling.matrix}
        if len(coupling.matrix) != n or lengths != {n}:
            shape = f"{len(coupling.matrix)} rows of {' and '.join(map(str, sorted(lengths)))}"
            raise InputError(
                f"{place}: coupling.matrix has {shape} numbers; the robot has {n} joints, so "
                f"give {n} x {n}"
            )
        return _invertible(np.array(coupling.matrix), f"{place}: coupling.matrix")
    matrix = np.eye(n)
    for name, terms in coupling.add.items():
        for other, factor in terms.items():
            j, k = (_joint(each, n, f"{place}: coupling.add") for each in (name, other))
            if j == k:
                raise InputError(
                    f"{place}: coupling.add.{name} names itself; name the joints that "
                    "are added to it"
                )
            matrix[j, k] = factor
    return _invertible(matrix, f"{place}: coupling.add")


def coupling_text(coupling: Array) -> str:
    """The joints whose values differ, in words: `q3 = J3 + J2`, J the controller's; (n, n)."""
    joints = []
    for j, row in enumerate(coupling):
        order = [j, *(k for k in range(len(row)) if k != j)]
        terms = [(row[k], k) for k in order if row[k] != 0.0]
        if terms == [(1.0, j)]:
            continue
        text = "".join(
            f" {'-' if factor < 0 else '+'} {_factor(abs(factor))}J{k + 1}" for factor, k in terms
        )
        joints.append(f"q{j + 1} = {text.removeprefix(' + ').strip()}")
    return ", ".join(joints)


def settled_values(coupling: Array, place: str, *stated: JointValues | None) -> JointValues:
    """The kind of joint values, by a header and an option (None: not stated).

    coupling (n, n) as in `coupling_matrix`. Nothing needs to be stated where both kinds are equal.
    Raises UsageError with `place` where they differ and nothing is stated, or where header and
    option contradict each other, and for a word that is no kind.
    """
    words = [word for word in stated if word is not None]
    for word in words:
        check_joint_values(word)
    if np.array_equal(coupling, np.eye(len(coupling))):
        return words[0] if words else "serial"
    if not words:
        raise UsageError(
            f"{place}: the joint values of the controller are not those of the serial chain "
            f"({coupling_text(coupling)}); say which these are: --joint-values serial or "
            "--joint-values controller"
        )
    if len(set(words)) > 1:
        raise UsageError(
            f"{place}: the header says that the joint values are {words[0]}, but --joint-values "
            f"says {words[1]}"
        )
    return words[0]


def check_joint_values(values: str) -> None:
    """UsageError unless `values` is a kind of joint values."""
    check_choice(values, JOINT_VALUES, "joint values")


def _factor(value: float) -> str:
    return "" if value == 1.0 else f"{value:g} "


def _joint(name: str, n: int, place: str) -> int:
    index = int(name[1:]) - 1
    if index >= n:
        raise InputError(f"{place}: unknown joint '{name}'; the robot has j1 to j{n}")
    return index


def _invertible(matrix: Array, place: str) -> Array:
    singular_values = np.linalg.svd(matrix, compute_uv=False)
    if not singular_values[-1] > _SMALLEST_CONDITION * singular_values[0]:
        raise InputError(
            f"{place} is singular: joint values cannot be converted back; check its rows"
        )
    return readonly(matrix)
