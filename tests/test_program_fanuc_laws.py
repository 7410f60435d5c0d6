"""FANUC programs of every kind through compensation: bytes that stay, poses that the calibrated
robot reaches, turns.
"""

import re
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from cases import examples
from hypothesis import given
from hypothesis import strategies as st
from program_reading import reader, solve_pose
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify
from calibtool.compensation.solve import compensate_joints
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.programs.branches import Controller
from calibtool.programs.compensate import compensate_program
from calibtool.programs.configurations import Fanuc, posture
from calibtool.programs.correction import ProgramOptions
from calibtool.programs.formats import coupling_of
from calibtool.programs.frames import pose, read_frames
from calibtool.programs.motions import POSE
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, inverse

FRAMES = read_frames(
    "[frames.1]\nx_mm=300\nyaw_deg=30\n[frames.2]\n[tools.1]\nz_mm=150\npitch_deg=20\n", "f"
)
NUMBER = re.compile(rb" *[-+]?\d*\.\d+")
TURNS = re.compile(r"CONFIG : '\w \w \w, (-?\d+), (-?\d+), (-?\d+)'")


@cache
def robot() -> Robot:
    return load_robot("fanuc-m1000ia")


@cache
def controller() -> Controller:
    return Controller(robot(), coupling_of(robot(), "fanuc-ls", None))


@cache
def calibrations() -> tuple[Calibration, Calibration]:
    """The identity, and one of a robot with errors."""
    simulation = Simulation(seed=3, workspace=robot().workspace(), configurations=40)
    measurements = simulate(robot(), simulation)
    return identify(measurements, "nominal"), identify(measurements, "local-poe")


def turn(degrees: float) -> int:
    """Turn 0 is from -180 to 180 deg, turn 1 from there to 540 deg."""
    return int((degrees + 180) // 360)


def group(degrees: Array, uf: int = 0, ut: int = 0) -> str:
    """A pose as the controller writes it for its joint values."""
    q = controller().to_serial(np.deg2rad(degrees))
    now, zero = posture(robot(), q, np.deg2rad(degrees)), controller().zero
    letters = (
        f"{'F' if now.flexed else 'N'} {'U' if now.bent == zero.bent else 'D'} "
        f"{'T' if now.front else 'B'}"
    )
    T = robot().mechanism.forward(q[None])[0]
    frame, tool = FRAMES.frames.get(str(uf), np.eye(4)), FRAMES.tools.get(str(ut), np.eye(4))
    T = inverse(frame) @ T @ tool
    x, y, z = T[:3, 3] * 1e3
    w, p, r = Rotation.from_matrix(T[:3, :3]).as_euler("xyz", degrees=True)
    turns = ", ".join(str(turn(degrees[j])) for j in (0, 3, 5))
    return (
        f"\tUF : {uf}, UT : {ut},\t\tCONFIG : '{letters}, {turns}',\n"
        f"\tX = {x:12.6f}  mm,\tY = {y:12.6f}  mm,\tZ = {z:12.6f}  mm,\n"
        f"\tW = {w:12.6f} deg,\tP = {p:12.6f} deg,\tR = {r:12.6f} deg\n"
    )


def joints(degrees: Array) -> str:
    return (
        "\tUF : F, UT : F,\n"
        + ",\t".join(f"J{k + 1}= {v:10.3f} deg" for k, v in enumerate(degrees))
        + "\n"
    )


def program(groups: list[str]) -> str:
    moves = "".join(f"{k:4d}:L P[{k}] 100mm/sec CNT50    ;\n" for k in range(1, len(groups) + 1))
    taught = "".join(f"P[{k}]{{\n   GP1:\n{one}}};\n" for k, one in enumerate(groups, start=1))
    return f"/PROG T\n/MN\n{moves}/POS\n{taught}/END\n"


def corrected(data: bytes, calibration: Calibration) -> bytes:
    return compensate_program(
        calibration, data, "a", "fanuc-ls", ProgramOptions(frames=FRAMES)
    ).data


# --- turns ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "degrees",
    [
        [10.0, 20, -20, 200, -60, 30],
        [10.0, 20, -20, 20, -60, -250],
        [10.0, 20, -20, -200, 60, 300],
        [-170.0, 10, -10, 181, -60, -181],
    ],
)
def test_a_pose_is_solved_and_written_in_its_turns(degrees: list[float]) -> None:
    """The corrected pose is the nominal one at the corrected joints, in
    the turns that these have.
    """
    q = controller().to_serial(np.deg2rad([degrees]))
    expected = compensate_joints(calibrations()[1], q).q
    after = corrected(program([group(np.array(degrees))]).encode(), calibrations()[1]).decode()
    (literal,) = reader("fanuc-ls")(after, robot()).literals
    assert isinstance(literal.configuration, Fanuc)
    solved = solve_pose(
        controller(), pose(literal.values, "extrinsic-xyz"), literal.configuration, None
    )
    np.testing.assert_allclose(np.rad2deg(solved), np.rad2deg(expected[0]), atol=1e-4)
    shown = np.rad2deg(controller().to_controller(expected[0]))
    found = TURNS.search(after)
    assert found is not None
    assert [int(number) for number in found.groups()] == [turn(shown[j]) for j in (0, 3, 5)]


@pytest.mark.parametrize(("joint", "side"), [(3, 1), (3, -1), (5, 1), (5, -1)])
def test_a_joint_that_passes_into_another_turn(joint: int, side: int) -> None:
    """Right beside the border on both sides the corrected numbers are the same, and so are the
    corrected turns.
    """
    written = []
    for beside in (-0.0004, 0.0004):
        degrees = np.array([10.0, 20, -20, 30, -60, 40])
        degrees[joint] = side * 180 + beside
        after = corrected(program([group(degrees)]).encode(), calibrations()[1]).decode()
        found = TURNS.search(after)
        assert found is not None
        q = controller().to_serial(np.deg2rad([degrees]))
        shown = np.rad2deg(controller().to_controller(compensate_joints(calibrations()[1], q).q[0]))
        assert [int(n) for n in found.groups()] == [turn(shown[j]) for j in (0, 3, 5)]
        written.append(found.groups())
    assert written[0] == written[1]


def test_the_turn_that_changes_is_reported() -> None:
    looks = []
    for beside in (-0.0004, 0.0004):
        degrees = np.array([10.0, 20, -20, 30, -60, 180 + beside])
        data = program([group(degrees)]).encode()
        result = compensate_program(calibrations()[1], data, "a", "fanuc-ls")
        looks += [remark.why for remark in result.remarks if "another turn" in remark.why]
    assert len(looks) == 1


def test_external_axes_that_are_ignored() -> None:
    """The arm's numbers are those without the axis, whether a motion goes there or not."""
    one = group(np.array([10.0, 20, -20, 30, -60, 40]))
    texts = [program([one.rstrip() + more + "\n"]) for more in ("", ",\n\tE1 = 250.000  mm")]
    for text, other in (texts, [text.replace("L P[1]", "!L P[1]") for text in texts]):
        plain = compensate_program(calibrations()[1], text.encode(), "a", "fanuc-ls")
        assert (
            compensate_program(calibrations()[1], other.encode(), "a", "fanuc-ls").data
            == other.encode()
        )
        options = ProgramOptions(ignore_external=True)
        ignored = compensate_program(calibrations()[1], other.encode(), "a", "fanuc-ls", options)
        assert ignored.data.replace(b",\n\tE1 = 250.000  mm", b"") == plain.data != text.encode()


# --- programs of every kind -----------------------------------------------------------------------


@dataclass(frozen=True)
class Made:
    """A program's bytes."""

    data: bytes


NAMES = st.sampled_from(
    ["", "home", "ゾーン", "原点", "ソ", "能表", "a b", "it's", "P[3] INC", "X = 1.0 mm"]
)
LINE_ENDS = st.sampled_from(["\n", "\r\n", "\r"])
ENCODINGS = st.sampled_from(["cp932", "gbk", "utf-8"])
EXTRAS = st.sampled_from(
    [
        "",
        ",\n\tE1 =     0.000  mm",
        "\n   GP2:\n\tUF : 0, UT : 0,\n\tJ1=     6.425 deg",
        ",\tE1=   120.000  mm",
    ]
)
OPTIONS = st.sampled_from(
    ["", "INC", "Offset,PR[3:INC]", "RTCP", "TB   .10sec,CALL INC", "WKZ_Offset ,PR[11]", "COORD"]
)
ANGLES = st.tuples(
    *(
        st.floats(low, high)
        for low, high in ((-60, 60), (0, 40), (-40, 0), (-300, 300), (-80, -40), (-300, 300))
    )
)


@st.composite
def programs(draw: st.DrawFn) -> Made:
    """Programs with joints and poses in any frame, options, names, groups,
    line ends and encodings.
    """
    moves, taught = ["UFRAME_NUM=1", "UTOOL_NUM=1"], []
    for k in range(1, draw(st.integers(1, 4)) + 1):
        degrees = np.round(np.array(draw(ANGLES)), 3)
        inside = robot().within_limits(controller().to_serial(np.deg2rad(degrees))[None])[0]
        degrees = degrees if inside else np.array([0.0, 10, -20, 0, -70, 0])
        frames = draw(st.integers(0, 2)), draw(st.integers(0, 1))
        body = group(degrees, *frames) if draw(st.booleans()) else joints(degrees)
        name = draw(NAMES)
        letter, options = draw(st.sampled_from("JLAS")), draw(OPTIONS)
        moves.append(
            f"{letter} P[{k}{':' * bool(name)}{name.replace('[', '(').replace(']', ')')}] 10% "
            f"FINE {options}"
        )
        head = f'P[{k}:"{name}"]' if name else f"P[{k}]"
        taught.append(f"{head}{{\n   GP1:\n{body.rstrip()}{draw(EXTRAS)}\n}};\n")
    lines = "".join(f"{k:4d}:{move} ;\n" for k, move in enumerate(moves, start=1))
    text = (
        f'/PROG T\n/ATTR\nCOMMENT = "J1= 5.000 deg";\n/MN\n   0: !P[1] 10.0 ;\n{lines}/POS\n'
        f"{''.join(taught)}/END\n"
    )
    data = text.replace("\n", draw(LINE_ENDS)).encode(draw(ENCODINGS), errors="replace")
    return Made(data)


@given(programs())
@examples(25)
def test_the_identity_changes_no_byte(made: Made) -> None:
    options = ProgramOptions(frames=FRAMES, on_error="skip")
    assert (
        compensate_program(calibrations()[0], made.data, "a", "fanuc-ls", options).data == made.data
    )


@given(programs())
@examples(25)
def test_bytes_outside_of_numbers_stay_and_the_calibrated_robot_reaches_what_was_meant(
    made: Made,
) -> None:
    """The corrected pose, solved by the nominal robot, is where the calibrated robot takes the pose
    that was written.
    """
    options = ProgramOptions(frames=FRAMES, on_error="skip")
    result = compensate_program(calibrations()[1], made.data, "a", "fanuc-ls", options)
    turns = re.compile(rb"(?<=[UDTB]), -?\d+, -?\d+, -?\d+'")
    assert turns.sub(b"", NUMBER.sub(b"#", result.data)) == turns.sub(
        b"", NUMBER.sub(b"#", made.data)
    )
    before, after = (
        reader("fanuc-ls")(data.decode("latin-1"), robot()).literals
        for data in (made.data, result.data)
    )
    fates = [fate.fate for fate in result.fates]
    assert len(before) == len(after) == len(fates)
    for old, new, fate in zip(before, after, fates, strict=True):
        if fate == "left":
            assert old.values == new.values
        elif old.kind == POSE:
            assert old.alone is not None
            frame, tool = (
                FRAMES.frames.get(getattr(old.alone.frame, "name", ""), np.eye(4)),
                FRAMES.tools.get(getattr(old.alone.tool, "name", ""), np.eye(4)),
            )
            wanted, stated = (
                frame @ pose(one.values, "extrinsic-xyz") @ inverse(tool) for one in (old, new)
            )
            q = solve_pose(controller(), stated, new.configuration, None)
            assert not isinstance(q, str)
            reached = calibrations()[1].forward(q[None])[0]
            np.testing.assert_allclose(reached, wanted, atol=2e-6)
        else:
            q, q_wanted = (controller().to_serial(np.array(one.values)) for one in (new, old))
            reached = calibrations()[1].forward(q[None])[0]
            np.testing.assert_allclose(
                reached, robot().mechanism.forward(q_wanted[None])[0], atol=2e-6
            )
