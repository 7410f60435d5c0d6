"""Poses as programs write them: conventions, nearest numbers, and the frames file."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibtool.errors import InputError
from calibtool.programs.frames import pose, pose_values, read_frames

ANGLES = st.tuples(*[st.floats(-3.1, 3.1)] * 3)


def turn(axis: str, angle: float) -> np.ndarray:
    """A rotation written out."""
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


@given(ANGLES)
def test_conventions(angles: tuple[float, float, float]) -> None:
    """FANUC: W, P, R about fixed x, y, z. KUKA: A about z, B about the new y, C about the new x."""
    a, b, c = angles
    wpr, abc = pose([1, 2, 3, a, b, c], "extrinsic-xyz"), pose([1, 2, 3, a, b, c], "intrinsic-zyx")
    np.testing.assert_allclose(wpr[:3, :3], turn("z", c) @ turn("y", b) @ turn("x", a), atol=1e-12)
    np.testing.assert_allclose(abc[:3, :3], turn("z", a) @ turn("y", b) @ turn("x", c), atol=1e-12)
    assert wpr[:3, 3].tolist() == [1, 2, 3]


@pytest.mark.parametrize("orientation", ["extrinsic-xyz", "intrinsic-zyx", "rotation-vector"])
@given(ANGLES)
def test_numbers_come_back(orientation: str, angles: tuple[float, float, float]) -> None:
    """Whatever branch the program wrote, its own numbers are the nearest ones (away
    from gimbal lock).
    """
    if orientation != "rotation-vector" and abs(np.cos(angles[1])) < 1e-3:
        return
    numbers = [0.1, 0.2, 0.3, *angles]
    back = pose_values(pose(numbers, orientation), orientation, numbers)
    np.testing.assert_allclose(pose(back, orientation), pose(numbers, orientation), atol=1e-9)
    if orientation != "rotation-vector" or np.linalg.norm(angles) > 1e-3:
        np.testing.assert_allclose(back, numbers, atol=1e-6)


@pytest.mark.parametrize("orientation", ["extrinsic-xyz", "intrinsic-zyx"])
@pytest.mark.parametrize("pitch", [90.0, -90.0, 89.9999999999])
def test_gimbal_lock(orientation: str, pitch: float) -> None:
    numbers = [0.0, 0.0, 0.0, *np.deg2rad([20.0, pitch, -70.0])]
    back = pose_values(pose(numbers, orientation), orientation, numbers)
    np.testing.assert_allclose(back, numbers, atol=1e-7)


def test_a_quaternion_keeps_its_sign() -> None:
    numbers = [0, 0, 0, -0.5, 0.5, -0.5, 0.5]
    np.testing.assert_allclose(
        pose_values(pose(numbers, "quaternion-wxyz"), "quaternion-wxyz", numbers),
        numbers,
        atol=1e-12,
    )


def test_angles_stay_in_their_turn() -> None:
    numbers = [0, 0, 0, *np.deg2rad([-180.0, 0.0, 540.0])]
    np.testing.assert_allclose(
        pose_values(pose(numbers, "extrinsic-xyz"), "extrinsic-xyz", numbers), numbers, atol=1e-12
    )


def test_frames_file() -> None:
    frames = read_frames(
        "[frames.7]\nx_mm = 100\nyaw_deg = 90\n[tools.gripper]\nz_mm = 50.5\n", "f.toml"
    )
    np.testing.assert_allclose(frames.frames["7"][:3, :3], turn("z", np.pi / 2), atol=1e-12)
    assert frames.frames["7"][0, 3] == pytest.approx(0.1)
    assert frames.tools["gripper"][2, 3] == pytest.approx(0.0505)


@pytest.mark.parametrize(
    "text", ["[frames", "[frames.1]\nx = 1", "[tool.1]\nx_mm = 1", "[frames.1]\nx_mm = nan"]
)
def test_a_bad_frames_file(text: str) -> None:
    with pytest.raises(InputError, match=r"^f\.toml: "):
        read_frames(text, "f.toml")


@pytest.mark.parametrize(
    ("numbers", "turns"),
    [
        ("w_deg = 10\np_deg = 20\nr_deg = 30", [("z", 30), ("y", 20), ("x", 10)]),
        ("a_deg = 30\nb_deg = 20\nc_deg = 10", [("z", 30), ("y", 20), ("x", 10)]),
        ("roll_deg = 90", [("x", 90)]),
        ("rz_deg = 90", [("z", 90)]),
        ("ry_rad = 1.5707963267948966", [("y", 90)]),
        ("qw = 0.5\nqx = 0.5\nqy = 0.5\nqz = 0.5", [("x", 90), ("y", 90)]),
        ("qy = 1", [("y", 180)]),
        ("", []),
    ],
)
def test_orientations_of_a_frames_file(numbers: str, turns: list[tuple[str, float]]) -> None:
    R = np.eye(3)
    for axis, degrees in turns:
        R = R @ turn(axis, np.deg2rad(degrees))
    for place, z in (("z_mm = 5", 0.005), ("z_m = 0.25", 0.25)):
        T = read_frames(f"[tools.2]\n{place}\n{numbers}\n", "f").tools["2"]
        np.testing.assert_allclose(T[:3, :3], R, atol=1e-12)
        np.testing.assert_allclose(T[:3, 3], [0, 0, z])


@pytest.mark.parametrize(
    ("numbers", "why"),
    [
        ("qw = 0.5", "a quaternion of length 0.5"),
        ("a_deg = 1\nw_deg = 1", "w_deg and a_deg in one pose"),
        ("x_mm = 1\ny_m = 1", "x_mm and y_m in one pose"),
        ("yaw = 1", "unknown 'yaw'; did you mean yaw_deg"),
        ("x_mm = inf", "finite"),
    ],
)
def test_a_pose_of_a_frames_file_that_is_none(numbers: str, why: str) -> None:
    with pytest.raises(InputError, match=rf"^f: tools\.2.*{why}"):
        read_frames(f"[tools.2]\n{numbers}\n", "f")
