"""A part of the rows, and the rest of them."""

import re

import numpy as np

from calibtool.errors import UsageError


def choose_rows(
    count: int, rows: str | None, sample: int | None, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Indices (k,) of the chosen rows and of the others, both rising. rows: 'A:B', from 1 and both
    included.

    sample: a random sample of this number of rows. Raises UsageError for a range or a number that
    does not fit.
    """
    chosen = np.arange(count)
    if rows is not None:
        match = re.fullmatch(r"(\d{1,18}):(\d{1,18})", rows.strip())
        first, last = (int(match[1]), int(match[2])) if match else (0, 0)
        if not 1 <= first <= last <= count:
            raise UsageError(f"--rows {rows}: expected A:B with 1 <= A <= B <= {count}")
        chosen = chosen[first - 1 : last]
    if sample is not None:
        if sample > len(chosen):
            raise UsageError(f"--sample {sample}: there are only {len(chosen)} rows to draw from")
        chosen = np.sort(np.random.default_rng(seed).permutation(chosen)[:sample])
    return chosen, np.setdiff1d(np.arange(count), chosen)


def line_ranges(lines: list[int]) -> str:
    """Line numbers for a message, neighbours joined, at most 200 ranges: '3, 7-9, 12'."""
    ranges: list[list[int]] = []
    for line in lines:
        if ranges and line == ranges[-1][1] + 1:
            ranges[-1][1] = line
        else:
            ranges.append([line, line])
    texts = [str(first) if first == last else f"{first}-{last}" for first, last in ranges[:200]]
    more = sum(last - first + 1 for first, last in ranges[200:])
    return ", ".join(texts) + (f" and {more} more lines" if more else "")
