"""Machine data of KUKA arms: read, refitted, and read back."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exported import anywhere, calibrated
from test_export_urdf import distances

from calibtool.calibration import Calibration
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import InputError
from calibtool.export.as_kuka_machine import calibration_as_kuka_machine
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

# As they are in the machine data of a KR 6 R900.
TEXT = """\
DECL MAIN_AXIS $MAIN_AXIS=#NR ;GRUNDACHSENKENNUNG
DECL WRIST_AXIS $WRIST_AXIS=#ZEH
$AXIS_DIR[1]=-1
$AXIS_DIR[2]=1
FRAME $TIRORO={X 0.0,Y 0.0,Z 400.000,A 0.0,B 0.0,C 0.0} ;FRAME
FRAME $TFLWP={X 0.0,Y 0.0,Z 80.0000,A 0.0,B 0.0,C 0.0}
FRAME $TX3P3={X 420.000,Y 0.0,Z 35.0000,A 0.0,B 90.0000,C 0.0}
REAL $LENGTH_A=25.0000
REAL $LENGTH_B=455.000
DECL DHART $DH_4={DHART_A 0.0,DHART_D 0.0,DHART_ALPHA 90.0000}
DECL DHART $DH_5={DHART_A 0.0,DHART_D 0.0,DHART_ALPHA -90.0000}
"""
KUKA = ["kuka-kr6-r900", "kuka-kr210-r2700"]


@pytest.fixture
def read(tmp_path: Path) -> Callable[[str | bytes], Robot]:
    def reading(text: str | bytes) -> Robot:
        path = tmp_path / "$machine.dat"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return load_robot(str(path))

    return reading


def having(name: str, **values: Array) -> Calibration:
    calibration = calibrated(name, "local-poe", False)
    errors = RobotErrors.of(calibration.robot, **values)
    return replace(calibration, base=replace(calibration.base, errors=errors))


def test_machine_data_are_the_arm_of_its_urdf(read: Callable[[str | bytes], Robot]) -> None:
    """But for the flange's turn about its axis, the poses are those of ROS-Industrial's numbers."""
    robot, known = read(TEXT), load_robot("kuka-kr6-r900")
    q = np.random.default_rng(0).uniform(known.lower, known.upper, (20, 6))
    found, expected = robot.mechanism.forward(q), known.mechanism.forward(q)
    np.testing.assert_allclose(found[:, :3, 3], expected[:, :3, 3], atol=1e-12)
    np.testing.assert_allclose(found[:, :3, 2], expected[:, :3, 2], atol=1e-12)
    same = read(TEXT.encode("latin-1") + b";\xdcberwachung\n$SOFTN_END[1]=-1\n")
    np.testing.assert_array_equal(same.mechanism.forward(q), found)


def test_letters_are_small_or_large_as_in_krl(read: Callable[[str | bytes], Robot]) -> None:
    """Also what refuses an arm of another kind is found."""
    ends = "$SOFTN_END[{0}]=-9{0}.0\n$SOFTP_END[{0}]=7{0}.0\n"
    text = TEXT + "".join(ends.format(j) for j in range(1, 7))
    robot = read(text)
    for other in (text.lower(), text.replace("{X", "{x").replace(",Z", ",z")):
        same = read(other)
        np.testing.assert_array_equal(same.lower, robot.lower)
        q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (5, 6))
        np.testing.assert_array_equal(same.mechanism.forward(q), robot.mechanism.forward(q))
    for old, new in (("#nr", "#cc"), ("#zeh", "#wih"), ("$axis_dir[1]=-1", "$axis_dir[1]=1")):
        with pytest.raises(InputError, match=r"\$(MAIN_AXIS|WRIST_AXIS|AXIS_DIR)"):
            read(text.lower().replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("#NR", "#CC", "$MAIN_AXIS is #CC"),
        ("#ZEH", "#WIH", "$WRIST_AXIS is #WIH"),
        ("$AXIS_DIR[1]=-1", "$AXIS_DIR[1]=1", "$AXIS_DIR turns an axis the other way"),
        ("REAL $LENGTH_B=", "; REAL $LENGTH_B=", "no $LENGTH_B in the machine data"),
        ("X 420.000,", "", "no $TX3P3 = {X"),
        ("DHART_ALPHA -90.0000", "DHART_ALPHA ?", "no $DH_5 = {DHART_A"),
    ],
)
def test_machine_data_of_another_kind_are_refused(
    old: str, new: str, word: str, read: Callable[[str | bytes], Robot]
) -> None:
    assert old in TEXT
    with pytest.raises(InputError) as caught:
        read(TEXT.replace(old, new))
    assert word in str(caught.value)


@pytest.mark.parametrize("name", KUKA)
def test_what_machine_data_can_hold_reads_back(
    name: str, read: Callable[[str | bytes], Robot]
) -> None:
    """Errors of base, tool, wrist, zeros and lengths: all but tilts of axes 2 and 3."""
    rng = np.random.default_rng(1)
    placements = np.zeros((7, 6))
    placements[0], placements[3], placements[6] = rng.normal(size=(3, 6)) * 1e-3
    placements[1, 0] = placements[2, 0] = 1e-3
    calibration = having(name, placements=placements, offsets=rng.normal(size=6) * 1e-3)
    text, missing = calibration_as_kuka_machine(calibration)
    assert missing == []
    q = anywhere(calibration, 30)
    found = read(text).mechanism.forward(q)
    np.testing.assert_allclose(found, calibration.forward(q), atol=1e-9)


def test_what_machine_data_do_not_hold_is_said(read: Callable[[str | bytes], Robot]) -> None:
    rng = np.random.default_rng(2)
    calibration = having("kuka-kr6-r900", placements=rng.normal(size=(7, 6)) * 1e-3)
    text, missing = calibration_as_kuka_machine(calibration)
    poses = read(text).mechanism.forward(calibration.q)
    mean, most = (
        f(distances(poses, calibration.forward(calibration.q)) * 1e3, axis=1)
        for f in (np.mean, np.max)
    )
    assert missing == [
        f"all together: {mean[0]:.4f} mm, {mean[1]:.4f} mrad in the mean, "
        f"up to {most[0]:.4f} mm, {most[1]:.4f} mrad"
    ]
    assert f"; not held: {missing[0]}\n" in text
    nominal = calibration.robot.mechanism.forward(calibration.q)
    assert mean[0] < 1e3 * distances(nominal, calibration.forward(calibration.q))[0].mean()


@pytest.mark.parametrize("name", ["panda", "ur5", "fanuc-m1000ia"])
def test_arms_of_other_kinds_have_no_machine_data(name: str) -> None:
    with pytest.raises(InputError, match="machine data"):
        calibration_as_kuka_machine(calibrated(name, "nominal", True))
