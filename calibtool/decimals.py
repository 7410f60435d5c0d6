"""Many numbers to decimal text at once, four digits at a time from a table."""

import numpy as np

from calibtool.robot.se3 import Array

DECIMALS = 12
_LARGEST = 1000.0  # beyond it the integer of all digits would not be an exact double

_CELL = np.dtype([("whole", "<u4"), ("point", "u1"), ("parts", "<u4", 3), ("end", "u1")])
_FOURS = [b"%04d" % k for k in range(10_000)]


def _table(texts: list[bytes]) -> np.ndarray:
    return np.frombuffer(b"".join(texts), "<u4")


# Behind the 10,000 groups of four digits the same without zeros at their end; NUL is taken out of the text.
_GROUPS = _table([*_FOURS, *(four.rstrip(b"0").ljust(4, b"\0") for four in _FOURS)])
_WHOLE = _table([sign + (b"%d" % k).rjust(3, b"\0") for sign in (b"\0", b"-") for k in range(1000)])


def decimal_rows(values: Array) -> list[str]:
    """Comma separated numbers of every row of (N, n), without zeros at their ends.

    12 decimals (in degrees 1e-14 rad); rows with a number of 1000 or more have 14 digits, rows with a NaN empty cells.
    """
    plain = (np.abs(values) < _LARGEST - 1e-9).all(axis=-1)
    integers = np.rint(np.abs(np.where(plain[:, None], values, 0.0)) * 10.0**DECIMALS).astype(np.int64)
    upper = integers // 10**8
    lower = integers - upper * 10**8
    cells = np.empty(values.shape, _CELL)
    whole, first, second = upper // 10**4, upper % 10**4, lower // 10**4
    third = lower - second * 10**4
    cells["whole"] = _WHOLE[whole + 1000 * ((values < 0) & (integers > 0))]
    ends = np.ones(values.shape, dtype=bool)  # only zeros follow
    for position, group in ((2, third), (1, second), (0, first)):
        cells["parts"][..., position] = _GROUPS[group + 10_000 * ends]
        ends &= group == 0
    cells["point"] = np.where(ends, 0, ord("."))
    cells["end"] = ord(",")
    cells["end"][:, -1] = ord("\n")
    rows = cells.tobytes().translate(None, b"\0").decode("ascii").splitlines()
    for k in np.flatnonzero(~plain):
        given = values[k].tolist()
        rows[k] = ",".join("" for _ in given) if np.isnan(given).any() else ",".join(f"{value:.14g}" for value in given)
    return rows
