"""calibtool compensate --controller: poses of programs for the controller's own model."""

from dataclasses import replace
from pathlib import Path

import pytest
from commandline import Files, refused, run, write_table

import calibtool as ct

SHARED = Path(__file__).parent.parent / "controllers"
POSES = (
    "def a():\n  set_tcp(p[0, 0, 0, 0, 0, 0])\n"
    "  movel(p[-0.482478, -0.221476, 0.362441, 2.2, -2.1, 0.1])\nend\n"
)
JOINTS = "movej([0.1, -1.4, 1.7, -1.9, -1.6, 0.2])\n"


@pytest.fixture(scope="session")
def ten(files: Files) -> str:
    """A calibration of a ur10, as if its measurements were real."""
    path = str(files.folder / "ten-local-poe.h5")
    run("identify", files.ten, "--model", "local-poe", "-o", path)
    ct.write(replace(ct.read(path), simulated=False), path, force=True)
    return path


@pytest.fixture(autouse=True)
def program(here: Path) -> None:
    Path("work.script").write_text(POSES, encoding="utf-8")
    Path("joints.script").write_text(JOINTS, encoding="utf-8")


def test_a_program_with_poses_is_refused_until_the_model_is_stated(ten: str) -> None:
    message = refused(2, "compensate", ten, "work.script", "-o", "out.script")
    assert message.startswith(
        "work.script: holds poses, and the controller of ur10 has a model of its own"
    )
    assert "--controller nominal or --controller FILE" in message
    assert not Path("out.script").exists()
    assert refused(2, "compensate", ten, "--format", "ur-script", stdin=POSES).startswith("stdin: ")
    run("compensate", ten, "joints.script", "-o", "joints_out.script")


def test_the_controller_of_a_simulated_robot_is_nominal(files: Files) -> None:
    run("identify", files.ten, "--model", "local-poe", "-o", "simulated.h5")
    plain = run("compensate", "simulated.h5", "work.script")
    nominal = run("compensate", "simulated.h5", "work.script", "--controller", "nominal")
    assert plain.stdout == nominal.stdout != POSES


def test_nominal_and_a_factory_calibration_give_other_poses(ten: str) -> None:
    nominal = run("compensate", ten, "work.script", "--controller", "nominal")
    factory = run(
        "compensate", ten, "work.script", "--controller", SHARED / "factory_calibration.yaml"
    )
    assert nominal.stdout != factory.stdout != POSES
    assert factory.stdout.splitlines()[1] == POSES.splitlines()[1]
    assert (
        "factory_calibration.yaml: the controller's tool is up to 1.95 mm and 3.46 mrad"
        in factory.stderr
    )
    data = (SHARED / "factory_calibration.yaml").read_bytes()
    assert (
        run("compensate", ten, "work.script", "--controller", "-", stdin=data).stdout
        == factory.stdout
    )
    joints = [
        run("compensate", ten, "joints.script", *more).stdout
        for more in (
            [],
            ["--controller", "nominal"],
            ["--controller", SHARED / "factory_calibration.yaml"],
        )
    ]
    assert len(set(joints)) == 1


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        (
            "a.yaml",
            lambda text: text.replace("wrist_2", "wrist_5"),
            ["a.yaml: ", "no frame wrist_2"],
        ),
        (
            "a.yaml",
            lambda text: text[: text.index("  wrist_1")],
            ["no frame wrist_1, wrist_2, wrist_3"],
        ),
        ("a.yml", lambda text: text.replace("-0.6125", "-0.425"), ["a.yml: no model of this ur10"]),
        (
            "a.yaml",
            lambda text: text.replace("0.1274", "0,1274"),
            ["a.yaml:5: kinematics.shoulder.z is '0,1274'"],
        ),
        ("a.txt", lambda text: "hello\n", ["a.txt: no model of a controller"]),
        ("dh.csv", lambda text: (SHARED / "dh.csv").read_text(encoding="utf-8"), ["--dh standard"]),
    ],
)
def test_bad_files_are_one_line_and_nothing_is_written(
    ten: str, name: str, change, words: list[str]
) -> None:
    Path(name).write_text(
        change((SHARED / "factory_calibration.yaml").read_text(encoding="utf-8")), encoding="utf-8"
    )
    code = 2 if name == "dh.csv" else 3
    message = refused(
        code, "compensate", ten, "work.script", "--controller", name, "-o", "out.script"
    )
    for word in words:
        assert word in message
    assert not Path("out.script").exists()


def test_a_dh_table_states_its_convention(ten: str) -> None:
    """The lengths of a ur10 instead of those of the table."""
    text = (SHARED / "dh.csv").read_text(encoding="utf-8")
    for old, new in (
        ("130", "127.3"),
        ("-600", "-612"),
        ("-550", "-572.3"),
        ("160", "163.941"),
        ("115", "115.7"),
    ):
        text = text.replace(old, new)
    Path("ur10.csv").write_text(text.replace(",90,0\n", ",92.2,0\n"), encoding="utf-8")
    told = run("compensate", ten, "work.script", "--controller", "ur10.csv", "--dh", "standard")
    assert "up to 0.00 mm" in told.stderr
    assert told.stdout == run("compensate", ten, "work.script", "--controller", "nominal").stdout
    assert "as --dh standard it fits" in refused(
        3, "compensate", ten, "work.script", "--controller", "ur10.csv", "--dh", "modified"
    )


def test_what_does_not_fit_together(ten: str, files: Files) -> None:
    write_table("t.csv", [f"j{k}_deg" for k in range(1, 7)], [[0, -80, 100, -110, -90, 0]])
    assert "--controller" in refused(2, "compensate", ten, "t.csv", "--controller", "nominal")
    assert "--controller" in refused(2, "compensate", ten, "t.csv", "--dh", "standard")
    assert "no such file" in refused(
        2, "compensate", ten, "work.script", "--controller", "nothing.yaml"
    )
    assert "--dh" in refused(
        2, "compensate", ten, "work.script", "--controller", "nominal", "--dh", "standard"
    )
    assert "--dh" in refused(2, "compensate", ten, "work.script", "--dh", "standard")
    said = refused(2, "compensate", ten, "work.script", "--controller", "x", "--dh", "classic")
    assert "--dh: unknown 'classic'" in said
    assert "only one input" in refused(2, "compensate", ten, "-", "--controller", "-", stdin=POSES)
