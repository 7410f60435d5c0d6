"""Options of calibtool plan: points, boxes and lines of sight."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibtool.planning.constraints import Sight


def sight(instrument: str | None, normal: str | None, cone_deg: float | None) -> "Sight | None":
    """The line of sight of three options."""
    from math import radians

    from calibtool.errors import UsageError
    from calibtool.planning.constraints import Sight

    if instrument is None:
        for option, value in (("--normal", normal), ("--cone-deg", cone_deg)):
            if value is not None:
                raise UsageError(f"{option} needs --instrument x,y,z to look at")
        return None
    x, y, z = _numbers(instrument, 3, "--instrument")
    u, v, w = _numbers(normal or "0,0,1", 3, "--normal")
    if not (u or v or w):
        raise UsageError(
            "--normal: 0,0,0 is no direction; give the one in which the targets look, such as 0,0,1"
        )
    cone = 30.0 if cone_deg is None else finite(cone_deg, "--cone-deg")
    return Sight((x * 1e-3, y * 1e-3, z * 1e-3), (u, v, w), radians(cone))


def _numbers(text: str, count: int, option: str) -> list[float]:
    """Comma separated numbers of an option."""
    from calibtool.errors import UsageError

    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count:
        raise UsageError(f"{option}: '{text}' is not {count} numbers with commas between them")
    return [finite(value, option) for value in values]


def box(text: str) -> tuple[float, ...]:
    """A keep-out box of --keep-out, m."""
    from calibtool.errors import UsageError

    values = _numbers(text, 6, "--keep-out")
    if any(low >= high for low, high in zip(values[:3], values[3:], strict=True)):
        raise UsageError(
            f"--keep-out: '{text}' is empty; give x0,y0,z0,x1,y1,z1 with x0 < x1, y0 < y1, z0 < z1"
        )
    return tuple(value * 1e-3 for value in values)


def finite(value: float, option: str) -> float:
    """The number of an option; UsageError for NaN and infinity."""
    from math import isfinite

    from calibtool.errors import UsageError

    if not isfinite(value):
        raise UsageError(f"{option}: {value} is no finite number")
    return value
