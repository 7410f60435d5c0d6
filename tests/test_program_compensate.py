"""Programs through compensation: the identity changes no byte, corrections come back, all else
stays, errors by line.
"""

import importlib.util
import re
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from program_reading import reader

from calibtool.calibration import Calibration
from calibtool.compensation.solve import compensate_joints, compensate_poses
from calibtool.errors import InputError, NoSolutionError
from calibtool.programs.compensate import compensate_program
from calibtool.programs.correction import ProgramOptions
from calibtool.programs.formats import PROGRAM_FORMATS, detected
from calibtool.programs.frames import pose, read_frames
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import inverse

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "tests" / "programs"
SAMPLES = {
    "weld.ls": "fanuc-m1000ia",
    "drill.src": "fanuc-m1000ia",
    "drill.dat": "fanuc-m1000ia",
    "pick.mod": "fanuc-m1000ia",
    "pick.script": "ur5",
    "path.yaml": "ur5",
}
SPAN = re.compile(r" *[-+]?\d*\.?\d+")


@cache
def bench() -> ModuleType:
    """benchmarks/programs.py, which writes programs of any length."""
    spec = importlib.util.spec_from_file_location(
        "bench_programs", ROOT / "benchmarks" / "programs.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def calibrations(name: str) -> tuple[Calibration, Calibration]:
    """The identity, and one of a robot with errors."""
    identity, calibrated = bench().calibrations(load_robot(name))
    return identity, calibrated


def nominal(name: str) -> ProgramOptions:
    """Poses for a controller that computes with the nominal robot: on a UR it has to be said."""
    return ProgramOptions(controller_model=load_robot(name).mechanism)


def program_of(sample: str) -> tuple[bytes, str]:
    data = (FOLDER / sample).read_bytes()
    return data, detected(data.decode("latin-1"), sample)


def robot_of(program_format: str) -> str:
    return str(bench().ROBOTS.get(program_format, bench().OTHER_ROBOT))


# --- laws -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("program_format", PROGRAM_FORMATS)
def test_the_identity_changes_no_byte(program_format: str) -> None:
    name = robot_of(program_format)
    robot = load_robot(name)
    data = bench().WRITERS[program_format](robot, bench().configurations(robot, 20)).encode()
    result = compensate_program(calibrations(name)[0], data, "a", program_format, nominal(name))
    assert result.data == data
    assert (result.targets, result.changed, result.left_alone, result.remarks) == (20, 0, (), ())


@pytest.mark.parametrize("sample", SAMPLES)
def test_the_identity_changes_no_byte_of_a_written_program(sample: str) -> None:
    data, program_format = program_of(sample)
    name = SAMPLES[sample]
    result = compensate_program(calibrations(name)[0], data, sample, program_format, nominal(name))
    assert result.data == data


@pytest.mark.parametrize("program_format", PROGRAM_FORMATS)
def test_the_corrected_program_holds_the_corrected_joints(program_format: str) -> None:
    """Read again and solved as the controller does, on the branch of its configuration data."""
    name = robot_of(program_format)
    robot, calibration = load_robot(name), calibrations(name)[1]
    q = bench().configurations(robot, 10)
    text = bench().WRITERS[program_format](robot, q)
    result = compensate_program(calibration, text.encode(), "a", program_format, nominal(name))
    commanded = bench().read_joints(robot, text, program_format, q)
    expected = compensate_joints(calibration, commanded).q
    again = bench().read_joints(robot, result.data.decode(), program_format, expected)
    assert result.changed == 10
    np.testing.assert_allclose(np.rad2deg(commanded), np.rad2deg(q), atol=0.02)
    np.testing.assert_allclose(np.rad2deg(again), np.rad2deg(expected), atol=5e-5)
    assert result.largest_deg == pytest.approx(
        np.rad2deg(np.abs(expected - commanded).max()), abs=1e-6
    )


@pytest.mark.parametrize("sample", SAMPLES)
def test_only_numbers_change(sample: str) -> None:
    """With every number (and the blanks before it) taken out, both texts are the same; and
    comments are untouched.
    """
    data, program_format = program_of(sample)
    name = SAMPLES[sample]
    result = compensate_program(calibrations(name)[1], data, sample, program_format, nominal(name))
    before, after = data.decode(), result.data.decode()
    assert SPAN.sub("#", before) == SPAN.sub("#", after)
    assert before != after
    lines = {
        target.line + k
        for target in reader(program_format)(before, load_robot(SAMPLES[sample])).literals
        for k in range(7)
    }
    for k, (one, other) in enumerate(
        zip(before.splitlines(), after.splitlines(), strict=True), start=1
    ):
        assert one == other or k in lines


def test_columns_stay_columns() -> None:
    """A number takes the blanks before it as far as they go: `-179.729` with six decimals is wider
    than its column.
    """
    data, program_format = program_of("weld.ls")
    result = compensate_program(calibrations("fanuc-m1000ia")[1], data, "weld.ls", program_format)
    before, after = data.splitlines(), result.data.splitlines()
    assert [len(line) for line in after[20:22]] == [len(line) for line in before[20:22]]
    assert all(
        len(one) <= len(other) <= len(one) + 3 for one, other in zip(before, after, strict=True)
    )


def test_bytes_of_any_encoding_pass_through() -> None:
    text = "DEF a()\n; Türe öffnen\nPTP {A1 0,A2 10,A3 -10,A4 0,A5 -70,A6 0}\nEND\n"
    for encoding in ("utf-8", "latin-1"):
        result = compensate_program(
            calibrations("fanuc-m1000ia")[1], text.encode(encoding), "a.src", "kuka-krl"
        )
        assert result.data.splitlines()[1] == text.encode(encoding).splitlines()[1]
        assert result.changed == 1


# --- frames and tools -----------------------------------------------------------------------------


def test_frames_and_tools() -> None:
    """The same flange pose, written in a frame and with a tool, gets the same corrected joints."""
    robot, calibration = load_robot("fanuc-m1000ia"), calibrations("fanuc-m1000ia")[1]
    frames = read_frames(
        "[frames.3]\nx_mm=900\nyaw_deg=20\n[tools.2]\nz_mm=150\npitch_deg=30\n", "f"
    )
    q = np.deg2rad([[20.0, 20, -30, 5, -60, 10]])
    T = inverse(frames.frames["3"]) @ robot.mechanism.forward(q)[0] @ frames.tools["2"]
    numbers = [
        *T[:3, 3] * 1e3,
        *bench().Rotation.from_matrix(T[:3, :3]).as_euler("xyz", degrees=True),
    ]
    text = (FOLDER / "weld.ls").read_bytes().decode("ascii")
    old = ["100.000", "200.000", "50.000", "180.000", "0.000", "0.000"]
    head, tail = text[: text.index("P[5]{")], text[text.index("P[5]{") :]
    for key, was, value in zip("XYZWPR", old, numbers, strict=True):
        tail = re.sub(rf"{key} = +{was}", f"{key} = {value:.7f}", tail, count=1)
    options = ProgramOptions(frames=frames)
    result = compensate_program(calibration, (head + tail).encode(), "a", "fanuc-ls", options)
    framed = next(
        t for t in reader("fanuc-ls")(result.data.decode(), robot).literals if t.name == "P[5]"
    )
    T_new = frames.frames["3"] @ pose(framed.values, "extrinsic-xyz") @ inverse(frames.tools["2"])
    np.testing.assert_allclose(
        T_new, robot.mechanism.forward(compensate_joints(calibration, q).q)[0], atol=2e-7
    )


def test_default_frame_and_tool() -> None:
    text = "DEF a()\nLIN {X 1904.939,Y 662.417,Z -93.227,A -146.687,B -20.350,C 179.729}\nEND\n"
    calibration = calibrations("fanuc-m1000ia")[1]
    result = compensate_program(calibration, text.encode(), "a", "kuka-krl")
    (remark,) = result.left_alone
    assert (
        remark.why
        == "the program does not state its frame; give it with --frames, [frames.default]"
    )
    assert result.data == text.encode()
    options = ProgramOptions(frames=read_frames("[frames.default]\n[tools.default]\n", "f"))
    assert compensate_program(calibration, text.encode(), "a", "kuka-krl", options).changed == 1


# --- joint values, configuration data, options ----------------------------------------------------


def test_joint_values_of_the_controller_and_of_the_chain() -> None:
    """weld.ls states J3 against the horizontal: P[1] is the chain's (0, 10, −10, 0, −70, 0)."""
    robot, calibration = load_robot("fanuc-m1000ia"), calibrations("fanuc-m1000ia")[1]
    data, _ = program_of("weld.ls")
    written = np.array([0.0, 10, -20, 0, -70, 0])
    for joint_values, j3 in (("controller", -10.0), ("serial", -20.0)):
        result = compensate_program(
            calibration, data, "a", "fanuc-ls", ProgramOptions(joint_values=joint_values)
        )
        target = reader("fanuc-ls")(result.data.decode(), robot).literals[0]
        chain = written.copy()
        chain[2] = j3
        expected = np.rad2deg(compensate_joints(calibration, np.deg2rad(chain[None])).q[0])
        if joint_values == "controller":
            expected[2] -= expected[1]
        np.testing.assert_allclose(np.rad2deg(target.values), expected, atol=1e-6)


def test_a_turn_that_changes_is_written_and_reported() -> None:
    """A3 is commanded at 0, which T may call negative or not; once corrected only one of
    the two is true.
    """
    data, program_format = program_of("drill.dat")
    results = [
        compensate_program(
            calibrations("fanuc-m1000ia")[1],
            data.replace(b"T 25", turn),
            "drill.dat",
            program_format,
        )
        for turn in (b"T 25", b"T 29")
    ]
    assert results[0].data.splitlines()[9] == results[1].data.splitlines()[9]
    (remark,) = [remark for result in results for remark in result.remarks]
    assert "configuration data are changed" in remark.why
    assert remark.line == 10


def test_poses_without_configuration_data_are_corrected_as_poses() -> None:
    robot, calibration = load_robot("ur5"), calibrations("ur5")[1]
    data, _ = program_of("pick.script")
    before, after = (
        reader("ur-script")(text.decode(), robot)
        for text in (
            data,
            compensate_program(calibration, data, "a", "ur-script", nominal("ur5")).data,
        )
    )
    tool = pose([0, 0, 0.1, 0, 0, 0], "rotation-vector")
    q_near = np.array([before.literals[0].values])
    T = pose(before.literals[1].values, "rotation-vector") @ inverse(tool)
    expected = robot.mechanism.forward(compensate_poses(calibration, T[None], q_near).q)[0]
    np.testing.assert_allclose(
        pose(after.literals[1].values, "rotation-vector") @ inverse(tool), expected, atol=1e-7
    )


def test_the_summary() -> None:
    data, program_format = program_of("weld.ls")
    result = compensate_program(calibrations("fanuc-m1000ia")[1], data, "weld.ls", program_format)
    lines = result.summary("weld.ls")
    assert re.fullmatch(
        r"weld\.ls: 4 of 5 targets changed, at most \d\.\d{3} mm and 0\.\d{4} deg; "
        "4 positions or motions not corrected",
        lines[0],
    )
    assert "weld.ls: not corrected: a relative motion (INC in line 12): line 30 (P[3])" in lines
    assert (
        "weld.ls: not corrected: frame '3' is not known; give it with --frames, [frames.3]: "
        "line 45 (P[5])" in lines
    )
    assert "weld.ls: note: line 13: P[4] is corrected without its offset" in lines


def test_a_summary_of_many_lines_is_short() -> None:
    text = "def a():\n" + "  movej(q)\n" * 50
    result = compensate_program(calibrations("ur5")[1], text.encode(), "a", "ur-script")
    (_, line) = result.summary("a")
    why = "a variable that no file gives a value"
    assert line.startswith(f"a: not corrected: {why}: lines 2, 3, 4, ")
    assert line.endswith(" and 30 more")


# --- errors ---------------------------------------------------------------------------------------

REST = "[9E9,9E9,9E9,9E9,9E9,9E9]"
GOOD = f"MoveAbsJ [[0,10,-10,0,-70,0],{REST}], v100, fine, tool0;"
FAR = f"MoveL [[9000,0,0],[1,0,0,0],[0,0,0,0],{REST}], v100, fine, tool0;"
BEYOND = GOOD.replace("10", "95", 1)
BAD = FAR.replace("[1,0,0,0]", "[1,1,0,0]")


@pytest.mark.parametrize(
    ("line", "error", "why"),
    [
        (FAR, NoSolutionError, r"^a\.mod:2: .*the pose is unreachable"),
        (
            BEYOND,
            NoSolutionError,
            r"^a\.mod:2: .*joint 2 at 95 deg is outside its limits \(-64 … 90 deg\)",
        ),
        (BAD, InputError, r"^a\.mod:2: .*length 1.414"),
    ],
)
def test_a_target_without_an_answer(line: str, error: type[Exception], why: str) -> None:
    calibration = calibrations("fanuc-m1000ia")[1]
    data = f"{GOOD}\n{line}\n{GOOD}\n".encode()
    with pytest.raises(error, match=why):
        compensate_program(calibration, data, "a.mod", "abb-rapid")
    result = compensate_program(
        calibration, data, "a.mod", "abb-rapid", ProgramOptions(on_error="skip")
    )
    assert result.data.splitlines()[1] == line.encode()
    assert result.changed == 2
    assert [remark.line for remark in result.left_alone] == [2]


def test_corrections_that_lead_over_a_limit() -> None:
    """Targets at the very limit: where the correction leads over it, the joint stays there and the
    target is named.
    """
    robot, calibration = load_robot("fanuc-m1000ia"), calibrations("fanuc-m1000ia")[1]
    held = []
    for j in range(3):
        for limit in (robot.lower[j], robot.upper[j]):
            degrees = [0.0, 10, -10, 20, -70, 0]
            degrees[j] = float(np.rad2deg(limit))
            q = np.deg2rad([degrees])
            corrected = compensate_joints(calibration, q)
            text = f"MoveAbsJ [[{','.join(map(repr, degrees))}],{REST}], v100, fine, tool0;\n"
            result = compensate_program(
                calibration, text.encode(), "a", "abb-rapid", ProgramOptions()
            )
            written = np.deg2rad(
                [[float(v) for v in result.data.decode().split("[[")[1].split("]")[0].split(",")]]
            )
            assert robot.within_limits(np.round(written, 9))[0]
            np.testing.assert_allclose(written, corrected.q, atol=1e-6)
            held.append(bool(abs(corrected.q[0, j] - q[0, j]) < 1e-9))
            named = [
                remark.why
                for remark in result.remarks
                if "limit" in remark.why or "singular" in remark.why
            ]
            assert (
                len(named) >= held[-1]
            )  # a joint stays at its limit near a singularity: that is said first
    assert True in held
    assert False in held


def test_outside_of_the_training_is_refused_on_request() -> None:
    data = GOOD.replace("[[0,", "[[170,").encode()
    calibration = calibrations("fanuc-m1000ia")[1]
    marked = compensate_program(calibration, data, "a", "abb-rapid")
    assert [remark.why for remark in marked.remarks] == [
        "outside the configurations of the training"
    ]
    with pytest.raises(NoSolutionError, match="--outside refuse"):
        compensate_program(calibration, data, "a", "abb-rapid", ProgramOptions(outside="refuse"))


@pytest.mark.parametrize("change", ["P[1]=LPOS", "IF R[1]=1,P[1,3]=R[2]"])
def test_a_pose_that_is_left_beside_corrected_ones(change: str) -> None:
    """The path has a step where FANUC's program assigns a position; beside joint targets
    alone there is none.
    """
    calibration = calibrations("fanuc-m1000ia")[1]
    head = "{\n GP1:\n UF : 0, UT : 0, CONFIG : 'N U T, 0, 0, 0',\n"
    place = (
        " X = {} mm, Y = 438.964 mm, Z = 606.965 mm,\n"
        " W = -171.751 deg, P = 1.716 deg, R = -149.873 deg\n}};\n"
    )
    joints = (
        "{\n GP1:\n UF : 0, UT : 0,\n"
        + ", ".join(f"J{k + 1}= {5 - 10 * k} deg" for k in range(6))
        + "\n};\n"
    )
    first, pose_there = (f"P[{k}]{head}{place.format(x)}" for k, x in ((1, 2300.597), (2, 2280.0)))
    for second, steps in ((f"P[2]{joints}", 0), (pose_there, 1)):
        code = (
            f"/PROG A\n/MN\n1:J P[2] 20% FINE ;\n2:{change} ;\n3:L P[1] 100mm/sec FINE ;\n/POS\n"
            f"{first}{second}/END\n"
        )
        result = compensate_program(calibration, code.encode(), "a", "fanuc-ls")
        assert result.changed == 1
        assert result.inconsistent == steps


def test_a_program_for_another_number_of_axes() -> None:
    data, program_format = program_of("weld.ls")
    with pytest.raises(
        InputError, match=r"^weld\.ls:21: P\[1\]: holds J1, .* but scara has 4 joints"
    ):
        compensate_program(calibrations("scara")[1], data, "weld.ls", program_format)


def test_zero_bytes_are_no_program() -> None:
    with pytest.raises(InputError, match="zero bytes"):
        compensate_program(calibrations("ur5")[0], "def a():".encode("utf-16"), "a", "ur-script")


def test_nothing_found_is_reported() -> None:
    result = compensate_program(calibrations("ur5")[0], b"hello\n", "a", "fanuc-ls")
    assert result.data == b"hello\n"
    assert "no positions are written in it as fanuc-ls" in result.summary("a")[1]
