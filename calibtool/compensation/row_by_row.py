"""Corrections row by row for a moving program, as JSON objects or as binary rows."""

import json
import math
import struct
from collections.abc import Callable
from typing import Literal

import numpy as np

from calibtool.calibration import Calibration
from calibtool.compensation.backlash_path import BacklashPath
from calibtool.compensation.jumps import CorrectionPath
from calibtool.compensation.one_step import default_bounds
from calibtool.compensation.solve import Method
from calibtool.compensation.status import JUMP as JUMPED
from calibtool.compensation.status import MEANING, OK
from calibtool.compensation.targets import OutsidePolicy, guarded
from calibtool.errors import InputError
from calibtool.robot.coupling import JointValues
from calibtool.robot.se3 import Array
from calibtool.units import joint_and_factor, without_values

RowKind = Literal["ndjson", "binary"]
NOT_FINITE = "not-finite"
# Statuses of a binary row: its last number is the index in this list.
STATUSES = (OK, NOT_FINITE, *MEANING)
_LARGEST = 1e6  # rad or m: larger positions get the status `not-finite`


class Live:
    """Corrects joint positions row by row, in the order of motion; keeps the state between rows.

    Each client needs its own. values: whose joint values are read and returned.
    """

    def __init__(
        self,
        calibration: Calibration,
        values: JointValues,
        method: Method = "one-step",
        outside: OutsidePolicy = "mark",
        backlash: bool = True,
        largest_change: float | None = None,
    ) -> None:
        self.robot, self.values = calibration.robot, values
        self._calibration, self._method, self._outside = calibration, method, outside
        self._bounds = default_bounds(calibration, largest_change)
        self._path = CorrectionPath(self.robot)
        self._backlash = BacklashPath.of(calibration) if backlash else None
        self._layouts: dict[tuple[str, ...], tuple[list[str], Array]] = {}

    def corrected(self, q: Array) -> tuple[Array, str]:
        """Joint positions to command for q (n,), rad or m, and the status of the row.

        Positions that are not finite, or beyond 1e6 rad or m, are returned unchanged.
        """
        if not (np.abs(q) < _LARGEST).all():
            return q, NOT_FINITE
        serial = self.robot.serial_from(self.values, q[None])
        result = guarded(self._calibration, serial, None, self._method, self._outside, self._bounds)
        status = str(result.status[0])
        if self._path.jumps(result.commanded, result.q) and status == OK:
            status = JUMPED
        moved = result.q
        if self._backlash is not None:
            moved = moved + self._backlash.taken_up(moved)
        answer: Array = self.robot.serial_as(self.values, moved)[0]
        return answer, status

    def object_answer(self, line: bytes) -> bytes:
        """The answer to one JSON object with a key per joint (`j1_deg`, `j2_mm`, …).

        The joints are replaced by the corrected ones, `status` is added, other keys are returned. A
        line that is no such object is answered by {"error": …} and does not change the state.
        """
        try:
            given = json.loads(line)
            if not isinstance(given, dict):
                raise InputError("expected one JSON object per line")
            keys, factors = self._layout(tuple(given))
            q = np.array([_number(given[key], key) for key in keys]) * factors
            moved, status = self.corrected(q)
            for key, value in zip(keys, (moved / factors).tolist(), strict=True):
                given[key] = value if math.isfinite(value) else None
            return _line({**given, "status": status})
        except InputError as error:
            return _line({"error": str(error)})
        except (ValueError, RecursionError) as error:
            return _line({"error": f'not JSON: {error}; expected rows such as {{"j1_deg": 10, …}}'})

    def row_answer(self, row: bytes) -> bytes:
        """The answer to n doubles: n corrected doubles, and one with the index of the status."""
        n = self.robot.n
        q = np.frombuffer(row, "<f8", n).astype(float)
        moved, status = self.corrected(q)
        return struct.pack(f"<{n + 1}d", *moved.tolist(), STATUSES.index(status))

    def answering(self, kind: RowKind) -> tuple[int, Callable[[bytes], bytes]]:
        """Length of a row in bytes, 0 where a line is a row, and the method that answers it."""
        if kind == "binary":
            return 8 * self.robot.n, self.row_answer
        return 0, self.object_answer

    def _layout(self, names: tuple[str, ...]) -> tuple[list[str], Array]:
        """Keys of the joints among the names, in order, and their factors to rad or m."""
        if names not in self._layouts:
            found: dict[int, tuple[str, float]] = {}
            for name in names:
                plain, which_values = without_values(name)
                if plain.split("_")[0] not in {f"j{j + 1}" for j in range(self.robot.n)}:
                    continue
                joint, factor = joint_and_factor(plain, self.robot.prismatic, "row")
                if joint in found or which_values not in (None, self.values):
                    raise InputError(f"'{name}': joint {joint + 1} twice, or not {self.values}")
                found[joint] = (name, factor)
            missing = [self.robot.columns(None)[j] for j in range(self.robot.n) if j not in found]
            if missing:
                raise InputError(f"no {', '.join(missing)} in the object")
            order = [found[j] for j in range(self.robot.n)]
            if len(self._layouts) > 100:  # a client that never sends the same keys twice
                self._layouts.clear()
            self._layouts[names] = ([key for key, _ in order], np.array([f for _, f in order]))
        return self._layouts[names]


def _number(value: object, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"'{key}' is {json.dumps(value)[:40]}; expected a number")
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _line(answer: dict[str, object]) -> bytes:
    text = json.dumps(answer, ensure_ascii=False, allow_nan=False)
    return f"{text}\n".encode("utf-8", "backslashreplace")
