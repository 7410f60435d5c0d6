"""Time stamps in common notations: ISO 8601, 26.11.2026 10:00:13, 11/26/2026 10:00:13 AM."""

import re
from collections.abc import Sequence

import numpy as np

from calibtool.robot.se3 import Array

_CLOCK = r"(?:[T ,]+(\d{1,2}):(\d\d)(?::(\d\d)(?:[.,](\d+))?)?\s*(AM|PM)?)"
_ISO = re.compile(rf"(\d{{4}})[-/.](\d\d?)[-/.](\d\d?){_CLOCK}Z?", re.IGNORECASE)
_POINTS = re.compile(rf"(\d\d?)\.(\d\d?)\.(\d{{4}}){_CLOCK}", re.IGNORECASE)
_SLASHES = re.compile(rf"(\d\d?)[/-](\d\d?)[/-](\d{{4}}){_CLOCK}", re.IGNORECASE)


def is_date(text: str) -> bool:
    """Whether a text is a date with a time."""
    return any(pattern.fullmatch(text.strip()) for pattern in (_ISO, _POINTS, _SLASHES))


def seconds(texts: Sequence[str]) -> tuple[Array, int | None]:
    """Seconds since 1970 of every text (N,), NaN where empty; and the first text that is no date
    with a time, or None.

    With slashes the first number is the day if any is above 12, and the month if any second number
    is. A list in which neither occurs is not read.
    """
    values = np.full(len(texts), np.nan)
    slashes = [match for match in map(_SLASHES.fullmatch, (t.strip() for t in texts)) if match]
    day_first = any(int(match[1]) > 12 for match in slashes)
    month_first = any(int(match[2]) > 12 for match in slashes)
    for row, text in enumerate(texts):
        if not (stripped := text.strip()):
            continue
        if match := _ISO.fullmatch(stripped):
            year, month, day = match[1], match[2], match[3]
        elif match := _POINTS.fullmatch(stripped):
            day, month, year = match[1], match[2], match[3]
        elif (match := _SLASHES.fullmatch(stripped)) and day_first != month_first:
            day, month, year = match[1], match[2], match[3]
            if month_first:
                day, month = month, day
        else:
            return values, row
        hour, half = int(match[4]), (match[8] or "").upper()
        if half:
            hour = hour % 12 + 12 * (half == "PM")
        clock = f"{hour:02}:{match[5]}:{match[6] or '00'}"
        try:
            whole = np.datetime64(f"{year}-{int(month):02}-{int(day):02}T{clock}", "s")
        except ValueError:
            return values, row
        values[row] = float(whole.astype(np.int64)) + float(f"0.{match[7] or 0}")
    return values, None
