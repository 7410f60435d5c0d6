"""calibtool compensate on controller programs: files, pipes, the summary, refusals."""

from pathlib import Path

import pytest
from commandline import Files, refused, remarks, run, shell

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
    result = run("compensate", calibration, SAMPLES / name, "--partial", "-o", "corrected")
    assert result.stdout_bytes == b""
    assert f"{name}: " in result.stderr.splitlines()[0]
    corrected = Path("corrected").read_bytes()
    assert corrected != data
    for target in ([], ["-"]):
        piped = run("compensate", calibration, *target, "--partial", stdin=data)
        assert piped.stdout_bytes == corrected
        assert piped.stderr.splitlines()[0].startswith("stdin: ")
    assert (SAMPLES / name).read_bytes() == data


def test_in_a_real_pipe(calibration: str, tmp_path: Path) -> None:
    command = f"calibtool compensate {calibration} --partial 2>said"
    done = shell(f"cat {SAMPLES}/weld.ls | {command} | tee out.ls | wc -l", tmp_path)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == (SAMPLES / "weld.ls").read_bytes().count(b"\n")
    assert b"5 targets changed" in (tmp_path / "said").read_bytes()


def test_the_format_can_be_given(calibration: str) -> None:
    data = (SAMPLES / "drill.src").read_bytes()
    seen = run("compensate", calibration, "--partial", stdin=data).stdout_bytes
    given = run("compensate", calibration, "--format", "kuka-krl", "--partial", stdin=data)
    assert given.stdout_bytes == seen
    other = run("compensate", calibration, "--format", "fanuc-ls", stdin=data)
    assert other.stdout_bytes == data
    assert "say so with --format" in other.stderr
    assert "did you mean kuka-krl" in refused(
        2, "compensate", calibration, "--format", "kuka", "-o", "a", stdin=data
    )


def test_a_table_is_still_a_table(calibration: str) -> None:
    text = "j1_deg,j2_deg,j3_serial_deg,j4_deg,j5_deg,j6_deg,note\n0,10,-10,0,-70,0,DEF movej(\n"
    table = run("compensate", calibration, "--format", "csv", stdin=text).stdout
    assert table.splitlines()[0].endswith(",note,status")
    assert (
        run("compensate", calibration, stdin=text.replace("movej(", "")).stdout.replace(
            "DEF", "DEF movej("
        )
        == table
    )


# --- never over the original ----------------------------------------------------------------------


def test_a_program_is_never_written_over_itself(calibration: str) -> None:
    Path("a.ls").write_bytes((SAMPLES / "weld.ls").read_bytes())
    Path("link.ls").symlink_to("a.ls")
    Path("hard.ls").hardlink_to("a.ls")
    for output in ("a.ls", "./a.ls", "link.ls", "hard.ls"):
        message = refused(2, "compensate", calibration, "a.ls", "-o", output, "--force")
        assert (
            message == f"{output}: is the input; a program is never overwritten, give another name"
        )
    assert "exists already" in refused(2, "compensate", calibration, "a.ls", "-o", "a.ls")


# --- errors ---------------------------------------------------------------------------------------


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
    assert "not corrected" in result.stderr


def test_a_calibration_of_another_robot(files: Files) -> None:
    message = refused(3, "compensate", files.local_poe, SAMPLES / "weld.ls", "-o", "b.ls")
    assert (
        "weld.ls:21: P[1]: holds J1, J2, J3, J4, J5, J6, but planar-3r has 3 joints; and" in message
    )


def test_options_that_do_not_fit(calibration: str) -> None:
    weld = SAMPLES / "weld.ls"
    assert "--uncertainty" in refused(
        2, "compensate", calibration, weld, "--uncertainty", "-o", "b"
    )
    assert "--on-error" in refused(
        2, "compensate", calibration, weld, "--on-error", "stopp", "-o", "b"
    )
    assert "--joint-values" in refused(
        2, "compensate", calibration, weld, "--joint-values", "x", "-o", "b"
    )
    assert "no such file" in refused(
        2, "compensate", calibration, weld, "--frames", "x.toml", "-o", "b"
    )
    Path("t.csv").write_text("j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\n0,10,-10,0,-70,0\n")
    assert "programs" in refused(
        2, "compensate", calibration, "t.csv", "--on-error", "skip", "-o", "b"
    )


def test_frames_from_a_file(calibration: str) -> None:
    Path("frames.toml").write_text("[frames.3]\nx_mm = 1900\n[tools.2]\n")
    with_frames = run(
        "compensate", calibration, SAMPLES / "weld.ls", "--frames", "frames.toml", "-o", "b.ls"
    )
    assert "5 of 5 targets changed" in with_frames.stderr
    Path("frames.toml").write_text("[frames.3]\nx = 1900\n")
    message = refused(
        3, "compensate", calibration, SAMPLES / "weld.ls", "--frames", "frames.toml", "-o", "c.ls"
    )
    assert message.startswith("frames.toml: frames.3: unknown 'x'; did you mean ")


def test_joint_values(calibration: str) -> None:
    weld = SAMPLES / "weld.ls"
    default, controller, serial = (
        run("compensate", calibration, weld, "--partial", *more).stdout
        for more in ([], ["--joint-values", "controller"], ["--joint-values", "serial"])
    )
    assert default == controller != serial


# --- programs of several files, and those that are corrected in part ------------------------------

TOOLS = """MODULE Cell
  PERS tooldata tGun:=[TRUE,[[0,0,150],[1,0,0,0]],[4,[0,0,60],[1,0,0,0],0,0,0]];
  PERS wobjdata wFix:=[FALSE,TRUE,"",[[600,100,-200],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
ENDMODULE
"""
TARGET = f"[[1715.243,322.580,658.584],[0.033110,-0.258144,0.963310,-0.065566],[0,0,0,0],{REST}]"
PART = (
    f"MODULE Part\n  PROC main()\n    MoveL {TARGET},v100,fine,tGun\\WObj:=wFix;\n  ENDPROC\n"
    "ENDMODULE\n"
)
FLANGE = f"[[2300.597,438.964,606.965],[0.033110,-0.258144,0.963310,-0.065566],[0,0,0,0],{REST}]"
BESIDE = PART.replace("  ENDPROC", f"    MoveL {FLANGE},v100,fine,tool0;\n  ENDPROC")


def test_frames_and_tools_of_another_file(calibration: str) -> None:
    Path("part.mod").write_text(PART)
    Path("cell.sys").write_text(TOOLS)
    alone = run("compensate", calibration, "part.mod")
    assert alone.stdout == PART
    assert "frame 'wfix' is not known; give it with --frames, [frames.wfix]" in alone.stderr
    together = run("compensate", calibration, "part.mod", "--with", "cell.sys")
    assert together.stdout != PART
    assert together.stdout.count("\n") == PART.count("\n")
    Path("all.mod").write_text(TOOLS + PART)
    whole = run("compensate", calibration, "all.mod").stdout
    assert whole == TOOLS + together.stdout
    assert Path("cell.sys").read_text() == TOOLS


def test_files_that_contradict_each_other(calibration: str) -> None:
    Path("part.mod").write_text(PART)
    Path("cell.sys").write_text(TOOLS)
    Path("other.sys").write_text(
        TOOLS.replace("0,0,150", "0,0,151").replace("MODULE Cell", "MODULE Other")
    )
    message = refused(
        3,
        "compensate",
        calibration,
        "part.mod",
        "--with",
        "cell.sys",
        "--with",
        "other.sys",
        "-o",
        "b.mod",
    )
    assert message.startswith("other.sys:2: tGun: differs from cell.sys:2")
    assert not Path("b.mod").exists()
    Path("other.sys").write_text(TOOLS.replace("MODULE Cell", "MODULE Other"))
    run(
        "compensate",
        calibration,
        "part.mod",
        "--with",
        "cell.sys",
        "--with",
        "other.sys",
        "-o",
        "b.mod",
    )


def test_a_program_corrected_in_part(calibration: str) -> None:
    Path("beside.mod").write_text(BESIDE)
    result = run("compensate", calibration, "beside.mod", "-o", "b.mod", code=4)
    assert result.stderr.splitlines()[-1].startswith("beside.mod: 1 pose is left while others")
    partial = run("compensate", calibration, "beside.mod", "-o", "c.mod", "--partial")
    assert Path("b.mod").read_bytes() == Path("c.mod").read_bytes()
    assert remarks(partial).splitlines() == remarks(result).splitlines()[:-1]
    Path("joints.mod").write_text(PART.replace("  ENDPROC", f"    {GOOD}  ENDPROC"))
    run(
        "compensate", calibration, "joints.mod", "-o", "d.mod"
    )  # no pose is corrected beside the one that is left


def test_a_report_of_every_position(calibration: str) -> None:
    Path("beside.mod").write_text(
        BESIDE.replace("  ENDPROC", f"    MoveL Offs(p,1,2,3),v100,fine,tool0;\n{GOOD}  ENDPROC")
    )
    run("compensate", calibration, "beside.mod", "-o", "b.mod", "--partial", "--report", "r.csv")
    header, *rows = Path("r.csv").read_text().splitlines()
    assert header == "file,line,name,kind,fate,why"
    assert [row.split(",")[1:5] for row in rows] == [
        ["3", "MoveL […]", "pose", "left"],
        ["4", "MoveL […]", "pose", "corrected"],
        ["5", "MoveL", "", "left"],
        ["6", "MoveAbsJ […]", "joint", "corrected"],
    ]
    again = refused(2, "compensate", calibration, "beside.mod", "-o", "c.mod", "--report", "r.csv")
    assert "r.csv: exists already" in again
    assert not Path("c.mod").exists()


def test_the_programs_of_a_folder(calibration: str) -> None:
    folder = Path("programs")
    (folder / "sub").mkdir(parents=True)
    (folder / "part.mod").write_text(PART)
    (folder / "sub" / "cell.sys").write_text(TOOLS)
    (folder / "weld.src").write_bytes((SAMPLES / "drill.src").read_bytes())
    (folder / "notes.txt").write_text("nothing\n")
    result = run(
        "compensate", calibration, "programs", "-o", "corrected", "--partial", "--report", "r.csv"
    )
    written = sorted(str(path) for path in Path("corrected").rglob("*") if path.is_file())
    assert written == ["corrected/part.mod", "corrected/sub/cell.sys", "corrected/weld.src"]
    assert Path("corrected/sub/cell.sys").read_text() == TOOLS
    assert Path("corrected/part.mod").read_text() != PART
    assert any(
        line.startswith("programs (abb-rapid): 1 of 1 targets changed")
        for line in result.stderr.splitlines()
    )
    assert {row.split(",")[0] for row in Path("r.csv").read_text().splitlines()[1:]} == {
        "programs/part.mod",
        "programs/weld.src",
    }
    assert "exists already" in refused(
        2, "compensate", calibration, "programs", "-o", "corrected", "--partial"
    )
    (folder / "part.mod").write_text(PART.replace("658.584", "nan"))
    assert refused(3, "compensate", calibration, "programs", "-o", "new").startswith(
        "programs/part.mod:3: "
    )
    assert not Path("new").exists()
    assert "-o" in refused(2, "compensate", calibration, "programs")
    Path("empty").mkdir()
    assert "holds no programs" in refused(3, "compensate", calibration, "empty", "-o", "new")


def test_documents_and_scripts_in_a_folder_are_no_programs(calibration: str) -> None:
    folder = Path("cell")
    folder.mkdir()
    (folder / "part.mod").write_text(PART)
    (folder / "readme.md").write_text(f"An example:\n{GOOD}")
    (folder / "old.mod.bak").write_text(PART)
    (folder / "drive.py").write_text("def home(arm) -> None:\n    arm = {X 1, Y 2}\n")
    (folder / "epson.prg").write_text("Function main\n  Go P1\nFend\n")
    (folder / "page.js").write_text("define('arm', []);\ndefault(a)\n")
    result = run("compensate", calibration, "cell", "-o", "out", "--partial")
    assert [path.name for path in Path("out").iterdir()] == ["part.mod"]
    assert "cell: passed over" in result.stderr
    assert ": epson.prg, old.mod.bak, readme.md; --format takes them too" in result.stderr
    run("compensate", calibration, "cell", "-o", "all", "--partial", "--format", "abb-rapid")
    assert sorted(path.name for path in Path("all").iterdir()) == [
        *["epson.prg", "old.mod.bak", "part.mod", "readme.md"]
    ]
    assert "is empty" in refused(2, "compensate", calibration, "", "-o", "none")


def test_motions_of_another_maker_are_not_taken_for_those_of_one_that_is_read(
    calibration: str,
) -> None:
    """DRL has UR's names with degrees, and Epson ABB's suffix; nothing is written."""
    Path("home.drl").write_text("movej([0, 0, 1, 0, 0, 0], vel=30, acc=30)\n")
    Path("main.prg").write_text("Function main\n  Go P1\nFend\n")
    for name, maker in (("home.drl", "Doosan"), ("main.prg", "Epson")):
        assert maker in refused(3, "compensate", calibration, name, "-o", "out")
        assert maker in refused(3, "compensate", calibration, stdin=Path(name).read_text())
        assert not Path("out").exists()


def test_external_axes_beside_a_pose(calibration: str) -> None:
    text = f"MoveL {FLANGE.replace('[9E9,', '[120.5,')},v100,fine,tool0;\n"
    left = run("compensate", calibration, stdin=text)
    assert left.stdout == text
    assert "external axes beside a pose" in left.stderr
    ignored = run("compensate", calibration, "--external", "ignore", stdin=text).stdout
    assert "[120.5,9E9" in ignored
    plain = run("compensate", calibration, stdin=text.replace("[120.5,", "[9E9,")).stdout
    assert ignored == plain.replace("[9E9,9E9", "[120.5,9E9", 1)
    zero = run("compensate", calibration, stdin=text.replace("[120.5,", "[0,")).stdout
    assert zero == plain.replace("[9E9,9E9", "[0,9E9", 1)


def test_the_message_states_how_many_and_which(calibration: str) -> None:
    bad = FAR.replace("[1,0,0,0]", "[1,1,0,0]")
    Path("a.mod").write_text(
        GOOD + bad + bad + GOOD.replace("10", "x", 1) + bad.replace("9000", "nan")
    )
    message = refused(3, "compensate", calibration, "a.mod", "-o", "b.mod")
    assert message.startswith(
        "a.mod:2: MoveL […]: quaternion of length 1.414; expected 1; and 2 more (1 × "
    )


def test_a_program_of_very_many_positions(
    calibration: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calibtool.programs.compensate.LARGEST", 2)
    Path("a.mod").write_text(GOOD * 3)
    message = refused(3, "compensate", calibration, "a.mod", "-o", "b.mod")
    assert message.startswith("a.mod: holds 3 positions; at most 2 are corrected together")
