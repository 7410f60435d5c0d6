"""Many numbers to decimal text at once, four digits at a time from a table.

Six numbers take 0.5 µs instead of the 1.6 µs of string formatting: a fifth of a one-step row.
"""

import numpy as np

from calibtool.robot.se3 import Array

DECIMALS = {"deg": 12, "mm": 12, "rad": 16, "m": 16}  # 1e-14 rad and less
_LARGEST = {12: 1000.0, 16: 10.0}  # beyond it the integer of all digits would lose its last ones

_FOURS = (np.arange(10_000)[:, None] // [1000, 100, 10, 1] % 10 + ord("0")).astype("u1")
_TRAILING = np.logical_and.accumulate(_FOURS[:, ::-1] == ord("0"), axis=1)[:, ::-1]
# Behind the 10,000 groups of four digits the same without zeros at their end; NUL is taken
# out of the text.
_GROUPS = np.concatenate([_FOURS, np.where(_TRAILING, 0, _FOURS)]).view("<u4")[:, 0]
_WHOLE = np.frombuffer(
    b"".join(sign + (b"%d" % k).rjust(3, b"\0") for sign in (b"\0", b"-") for k in range(1000)),
    "<u4",
)


def decimal_rows(values: Array, decimals: int) -> list[str]:
    """Comma separated numbers of every row of (N, n), without zeros at their ends.

    decimals: 12 or 16. Rows with a number too large for them have 14 digits, rows with a
    NaN empty cells.
    """
    groups = decimals // 4
    plain = np.all(np.abs(values) < _LARGEST[decimals] - 1e-9, axis=-1)
    integers = np.rint(np.abs(np.where(plain[:, None], values, 0.0)) * 10.0**decimals).astype(
        np.int64
    )
    negative = (values < 0) & (integers > 0)
    cells = np.empty(
        values.shape, [("whole", "<u4"), ("point", "u1"), ("parts", "<u4", groups), ("end", "u1")]
    )
    ends = np.ones(values.shape, dtype=bool)  # only zeros follow
    for position in reversed(range(groups)):
        upper = integers // 10**4
        group = integers - upper * 10**4
        cells["parts"][..., position] = _GROUPS[group + 10_000 * ends]
        ends &= group == 0
        integers = upper
    cells["whole"] = _WHOLE[integers + 1000 * negative]
    cells["point"] = np.where(ends, 0, ord("."))
    cells["end"] = ord(",")
    cells["end"][:, -1] = ord("\n")
    rows = cells.tobytes().translate(None, b"\0").decode("ascii").splitlines()
    for k in np.flatnonzero(~plain):
        given = values[k].tolist()
        rows[k] = (
            ",".join("" for _ in given)
            if np.isnan(given).any()
            else ",".join(f"{value:.14g}" for value in given)
        )
    return rows
