"""Two clocks: a moving arm's joints as a stream, its points with stamps of another clock."""

from dataclasses import replace

import numpy as np
import pytest

from calibtool.calibration import identify
from calibtool.calibration.fit import BaseOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.errors import InputError
from calibtool.identification.complete import CompleteOptions
from calibtool.measurement.checks.clocks import clock_offset
from calibtool.measurement.importing import JointFile, read_table
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.measurement.streams import JointStream
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array, readonly

ARM = load_robot("ur10")


def trajectory(times: Array, speed: float = 0.5) -> Array:
    """Joint positions (N, n) of an arm that moves all its joints, rad."""
    rates = speed * np.array([0.31, 0.47, 0.59, 0.73, 0.89, 1.03])
    phase = np.arange(6) * 1.1
    middle = np.array([0.2, -1.2, 1.3, -1.4, -1.2, 0.3])
    found: Array = middle + 0.7 * np.sin(times[:, None] * rates * 2 * np.pi + phase)
    return found


def moving(offset: float, count: int = 300, seed: int = 0) -> tuple[Measurements, JointStream]:
    """Points every 0.1 s with stamps that are `offset` s early, and joints every 8 ms."""
    known = np.arange(-2.0, 0.1 * count + 2.0, 0.008)
    stamps = np.arange(count) * 0.1
    q = trajectory(stamps + offset)  # where the arm was
    scales = ErrorScales(length=0.4e-3, angle=0.4e-3)
    seen = simulate(ARM, Simulation(seed, at=q, scales=scales, unregistered=True))
    stream = JointStream.of(known, trajectory(known), stamps)
    return replace(seen, q=readonly(stream.at(0.0)[0])), stream


@pytest.mark.parametrize("offset", [-0.5, -0.213, -0.003, 0.0, 0.0011, 0.34, 0.5])
def test_an_offset_is_found_to_a_fifth_of_a_millisecond(offset: float) -> None:
    found = clock_offset(*moving(offset))
    assert found is not None
    assert abs(found.offset - offset) < 0.2e-3
    assert abs(found.offset - offset) < 5 * found.error
    assert found.after <= found.before * (1 + 1e-3)


def test_no_backlash_is_made_of_it() -> None:
    seen, stream = moving(0.003)
    found = clock_offset(seen, stream)
    assert found is not None
    corrected = replace(stream, offset=found.offset)
    direction = readonly(corrected.directions())
    right = replace(seen, q=readonly(corrected.at(found.offset)[0]))
    right = replace(right, conditions=replace(seen.conditions, direction=direction))
    assert not identify(right).errors["backlash"].any()


@pytest.mark.parametrize("offset", [0.31, -0.02])
def test_a_backlash_is_not_taken_for_an_offset(offset: float) -> None:
    """Both move the joints along their motion; the arm turns round between the stamps, too."""
    stamps = np.arange(300) * 0.1
    known = np.arange(-2.0, 32.0, 0.008)
    scales = ErrorScales(("geometric", "backlash"), 0.4e-3, 0.4e-3, {"backlash": 0.3e-3})
    q = trajectory(np.arange(3000) * 0.01 + offset)
    seen = simulate(ARM, Simulation(0, at=q, scales=scales, unregistered=True))
    seen = seen.rows(np.arange(0, 3000, 10))
    stream = JointStream.of(known, trajectory(known), stamps)
    found = clock_offset(replace(seen, q=readonly(stream.at(0.0)[0])), stream)
    assert found is not None
    assert abs(found.offset - offset) < 0.1e-3


def test_half_widths_are_never_negative() -> None:
    """A clock that is late by 3 ms looks like a backlash whose sign is wrong."""
    for offset in (-0.003, 0.003):
        seen, stream = moving(offset)
        direction = readonly(np.sign(stream.at(0.0)[1]))
        late = replace(seen, conditions=replace(seen.conditions, direction=direction))
        asked = BaseOptions("complete", CompleteOptions(orders={"backlash": 1, "harmonics": 0}))
        assert identify(late, asked).errors["backlash"].min() >= 0.0


def tables(points_start: float, points_step: float, joints_end: float) -> tuple[str, str]:
    """A table of points and one of joints with stamps."""
    joints = [f"j{i}_deg" for i in range(1, 7)]
    times = np.arange(0.0, joints_end, 0.02)
    rows = np.column_stack([times, np.rad2deg(trajectory(times))])
    lines = [",".join(f"{v:.6f}" for v in row) for row in rows]
    log = "\n".join([",".join(["time_s", *joints]), *lines])
    stamps = points_start + points_step * np.arange(60)
    q = trajectory(stamps)
    points = simulate(ARM, Simulation(1, at=q)).points[:, 0] * 1e3
    lines = [",".join(f"{v:.6f}" for v in (t, *p)) for t, p in zip(stamps, points, strict=True)]
    return "\n".join(["time_s,x_mm,y_mm,z_mm", *lines]), log


def test_rows_beyond_a_joint_stream_that_is_too_short_are_counted() -> None:
    points, log = tables(0.0, 0.1, 4.0)
    found = read_table(points, "p.csv", ARM, joints=JointFile(log, "j.csv", "time"))
    assert len(found.measurements) in (40, 41)
    assert any("p.csv: 19 of 60 rows have no partner" in w for w in found.warnings)


def test_a_clock_that_runs_backwards_is_named() -> None:
    points, log = tables(5.9, -0.1, 7.0)
    found = read_table(points, "p.csv", ARM, joints=JointFile(log, "j.csv", "time"))
    assert any("p.csv: the clock runs backwards in 59 of 60 rows" in w for w in found.warnings)
    header, *lines = log.split("\n")
    turned = "\n".join([header, *lines[:50], *lines[40:]])
    found = read_table(points, "p.csv", ARM, joints=JointFile(turned, "j.csv", "time"))
    assert any("j.csv: the clock runs backwards in 1 of" in w for w in found.warnings)
    assert len(found.measurements) == 60


def test_streams_without_a_common_time_are_refused() -> None:
    points, log = tables(5.0, 0.1, 4.0)
    with pytest.raises(InputError, match=r"p\.csv: no row has a partner within 0\.1 s in j\.csv"):
        read_table(points, "p.csv", ARM, joints=JointFile(log, "j.csv", "time"))
