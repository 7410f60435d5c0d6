"""What options of calibtool import mean."""

from typing import TYPE_CHECKING, Any

from calibtool.cli.files import message, shown
from calibtool.cli.input_files import load_calibration, load_described
from calibtool.cli.options import choice
from calibtool.errors import NoSolutionError, UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibtool.measurement.checks.finding import Finding
    from calibtool.measurement.importing import Imported, SecondArm, Stated


def chosen(value: str | None, allowed: tuple[str, ...], option: str) -> Any:
    """An allowed value, or None where the option was not given; UsageError otherwise."""
    return None if value is None else choice(value, allowed, option)


def stated_of(unit: str | None, angle_unit: str | None, convention: str | None) -> "Stated":
    """What the options state where a header does not."""
    from calibtool.measurement.importing import Stated

    return Stated(
        chosen(unit, ("mm", "m", "in"), "--unit"),
        chosen(angle_unit, ("deg", "rad"), "--angle-unit"),
        convention,
    )


def second_arm_of(name: str) -> "SecondArm":
    """A second arm: a nominal robot, or a calibrated one."""
    from calibtool.measurement.importing import SecondArm

    if name.endswith(".h5"):
        calibration, _ = load_calibration(name)
        return SecondArm(calibration.robot, calibration.forward)
    robot = load_described(name, None, [])
    return SecondArm(robot, robot.mechanism.forward)


def in_one_frame(
    imported: "Imported",
    asked: bool,
    references: str | None,
    inputs: "Mapping[str, bytes]",
    stated: "Stated",
) -> "tuple[Imported, list[str]]":
    """The rows brought back by --use-references or --references, with a line of it, and what the
    file has to keep of that.
    """
    if not asked and references is None:
        return imported, []
    from calibtool.measurement.importing import brought_back

    file = None if references is None else (inputs["references"], shown(references))
    imported, told, moved = brought_back(imported, file, stated)
    for text in told:
        message(f"note: {text}")
    return imported, told if moved else []


def offset_of(imported: "Imported", text: str) -> float:
    """The offset of --clock-offset, s; with `auto` it is found from the motion, and reported."""
    from math import isfinite

    from calibtool.measurement.checks.clocks import clock_offset

    if text == "auto":
        stream = imported.with_clock_offset(0.0).stream
        assert stream is not None
        found = clock_offset(imported.measurements.points_alone(), stream)
        if found is None:
            raise NoSolutionError(
                "--clock-offset auto: nothing tells it: the arm stands still, or the points do not "
                "fit the robot; state it in seconds"
            )
        message(f"note: clock offset {found.offset:+.5f} s, ± {found.error * 1e3:.2g} ms")
        return found.offset
    try:
        seconds = float(text)
    except ValueError:
        seconds = float("nan")
    if not isfinite(seconds):
        raise UsageError(f"--clock-offset: '{text}' is no number of seconds, nor auto")
    return seconds


def findings_of(taken: "Imported") -> "list[Finding]":
    """What the checks on import find; nothing where the set-up cannot be registered."""
    from calibtool.measurement.checks import check_measurements

    try:
        measurements = taken.registered().measurements
    except NoSolutionError:
        return []
    return check_measurements(measurements, taken.auxiliary, taken.stream)
