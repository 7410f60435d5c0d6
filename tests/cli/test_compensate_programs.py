"""calibtool compensate on controller programs: files, pipes, the summary, refusals."""

from pathlib import Path

import pytest
from commandline import Files, refused, run, shell

SAMPLES = Path(__file__).parent.parent / "programs"
PROGRAMS = ["weld.ls", "drill.src", "drill.dat", "pick.mod"]
REST = "[9E9,9E9,9E9,9E9,9E9,9E9]"
GOOD = f"MoveAbsJ [[0,10,-10,0,-70,0],{REST}], v100, fine, tool0;\n"
FAR = f"MoveL [[9000,0,0],[1,0,0,0],[0,0,0,0],{REST}], v100, fine, tool0;\n"


@pytest.fixture(scope="session")
def calibration(files: Files) -> str:
    """A calibration of fanuc-m1000ia without a network."""
    path = str(files.folder / "six-local-poe.h5")
    run("identify", files.six_measurements, "--model", "local-poe", "-o", path)
    return path


@pytest.mark.parametrize("name", PROGRAMS)
def test_files_and_pipes_give_the_same_bytes(calibration: str, name: str) -> None:
    data = (SAMPLES / name).read_bytes()
    result = run("compensate", calibration, SAMPLES / name, "-o", "corrected")
    assert result.stdout_bytes == b""
    assert f"{name}: " in result.stderr.splitlines()[0]
    corrected = Path("corrected").read_bytes()
    assert corrected != data
    for target in ([], ["-"]):
        piped = run("compensate", calibration, *target, stdin=data)
        assert piped.stdout_bytes == corrected
        assert piped.stderr.splitlines()[0].startswith("stdin: ")
    assert (SAMPLES / name).read_bytes() == data


def test_in_a_real_pipe(calibration: str, tmp_path: Path) -> None:
    done = shell(f"cat {SAMPLES}/weld.ls | calibtool compensate {calibration} 2>said | tee out.ls | wc -l", tmp_path)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == (SAMPLES / "weld.ls").read_bytes().count(b"\n")
    assert b"5 targets changed" in (tmp_path / "said").read_bytes()


def test_the_format_can_be_given(calibration: str) -> None:
    data = (SAMPLES / "drill.src").read_bytes()
    seen = run("compensate", calibration, stdin=data).stdout_bytes
    assert run("compensate", calibration, "--format", "kuka-krl", stdin=data).stdout_bytes == seen
    other = run("compensate", calibration, "--format", "fanuc-ls", stdin=data)
    assert other.stdout_bytes == data
    assert "say so with --format" in other.stderr
    assert "did you mean kuka-krl" in refused(2, "compensate", calibration, "--format", "kuka", "-o", "a", stdin=data)


def test_a_table_is_still_a_table(calibration: str) -> None:
    text = "j1_deg,j2_deg,j3_serial_deg,j4_deg,j5_deg,j6_deg,note\n0,10,-10,0,-70,0,DEF movej(\n"
    table = run("compensate", calibration, "--format", "csv", stdin=text).stdout
    assert table.splitlines()[0].endswith(",note,status")
    assert run("compensate", calibration, stdin=text.replace("movej(", "")).stdout.replace("DEF", "DEF movej(") == table


# --- never over the original ----------------------------------------------------------------------------------------


def test_a_program_is_never_written_over_itself(calibration: str) -> None:
    Path("a.ls").write_bytes((SAMPLES / "weld.ls").read_bytes())
    Path("link.ls").symlink_to("a.ls")
    Path("hard.ls").hardlink_to("a.ls")
    for output in ("a.ls", "./a.ls", "link.ls", "hard.ls"):
        message = refused(2, "compensate", calibration, "a.ls", "-o", output, "--force")
        assert message == f"{output}: is the input; a program is never overwritten, give another name"
    assert "exists already" in refused(2, "compensate", calibration, "a.ls", "-o", "a.ls")


# --- errors ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (GOOD.replace("10", "95", 1), 4),
        (FAR.replace("[1,0,0,0]", "[1,1,0,0]"), 3),
        (FAR, 4),
    ],
)
def test_errors_stop_or_are_skipped(calibration: str, line: str, code: int) -> None:
    Path("a.mod").write_text(GOOD + line)
    message = refused(code, "compensate", calibration, "a.mod", "-o", "b.mod")
    assert message.startswith("a.mod:2: ")
    assert "--on-error skip" in message
    result = run("compensate", calibration, "a.mod", "--on-error", "skip", "-o", "b.mod")
    assert Path("b.mod").read_text().splitlines()[1] == line.rstrip("\n")
    assert "left alone" in result.stderr


def test_a_calibration_of_another_robot(files: Files) -> None:
    message = refused(3, "compensate", files.local_poe, SAMPLES / "weld.ls", "-o", "b.ls")
    assert "weld.ls:21: P[1]: holds J1, J2, J3, J4, J5, J6, but planar-3r has 3 joints; and" in message


def test_options_that_do_not_fit(calibration: str) -> None:
    weld = SAMPLES / "weld.ls"
    assert "--uncertainty" in refused(2, "compensate", calibration, weld, "--uncertainty", "-o", "b")
    assert "--on-error" in refused(2, "compensate", calibration, weld, "--on-error", "stopp", "-o", "b")
    assert "--joint-values" in refused(2, "compensate", calibration, weld, "--joint-values", "x", "-o", "b")
    assert "no such file" in refused(2, "compensate", calibration, weld, "--frames", "x.toml", "-o", "b")
    Path("t.csv").write_text("j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\n0,10,-10,0,-70,0\n")
    assert "programs" in refused(2, "compensate", calibration, "t.csv", "--on-error", "skip", "-o", "b")


def test_frames_from_a_file(calibration: str) -> None:
    Path("frames.toml").write_text("[frames.3]\nx_mm = 1900\n[tools.2]\n")
    with_frames = run("compensate", calibration, SAMPLES / "weld.ls", "--frames", "frames.toml", "-o", "b.ls")
    assert "5 of 5 targets changed" in with_frames.stderr
    Path("frames.toml").write_text("[frames.3]\nx = 1900\n")
    message = refused(3, "compensate", calibration, SAMPLES / "weld.ls", "--frames", "frames.toml", "-o", "c.ls")
    assert message.startswith("frames.toml: frames.3.x: ")


def test_joint_values(calibration: str) -> None:
    weld = SAMPLES / "weld.ls"
    default, controller, serial = (
        run("compensate", calibration, weld, *more).stdout
        for more in ([], ["--joint-values", "controller"], ["--joint-values", "serial"])
    )
    assert default == controller != serial
