"""Help: there for every command and option, true (the examples run), and
quick (no heavy import).
"""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from shutil import copy
from typing import Any

import pytest
from commandline import (
    COMMANDS,
    ENVIRONMENT,
    Files,
    example_of,
    measured_table,
    refused,
    run,
    write_table,
)

import calibtool
from calibtool.cli.command_help import GROUPS, completions

# What scripts rely on (docs/commands.md); a name may be added, none may go.
CONTRACT = {
    "robots": "--json",
    "simulate": "-n --configurations --seed --workspace --errors --length-error-mm "
    "--angle-error-mrad --noise-mm --unregistered --same-robot --at -o --output --force",
    "import": "--robot --columns -o --output --force",
    "plan": "-n --configurations --criterion --from --workspace --candidates --seed --noise-mm "
    "--unregistered --joint-margin --min-singularity-distance --floor-mm --keep-out --instrument "
    "--normal --cone-deg --iso9283 --cube-mm --cycles --json -o --output --force",
    "identify": "--model --json -o --output --force",
    "train": "--base --loss --optimizer --hidden --validation --seed --json -o --output --force",
    "evaluate": "--on --require --json -o --output --force",
    "compensate": "--method -o --output --force",
    "export": "--format --precision --prefix -o --output --force",
    "serve": "--port --rows --method",
    "plot": "--on --width-mm --require -o --output --force",
    "report": "--on --require -o --output --force",
    "view": "--html --magnify --meshes --port --force",
    "study": "--plan --runs --seed --methods -n --configurations --noise-mm --errors --error-scale "
    "--workspace --fresh --workers --cluster --box-plot --json -o --output --force",
    "info": "--json",
    "demo": "-o --output --force",
}


def options_of(command: str) -> list[Any]:
    return [p for p in COMMANDS[command].params if p.param_type_name == "option"]


def test_commands_of_the_contract_are_there() -> None:
    assert set(CONTRACT) <= set(COMMANDS)


@pytest.mark.parametrize("command", CONTRACT)
def test_options_of_the_contract_are_there(command: str) -> None:
    present = {name for option in options_of(command) for name in option.opts}
    assert set(CONTRACT[command].split()) <= present


def test_defaults_of_the_contract() -> None:
    defaults = {(c, o.name): o.default for c in COMMANDS for o in options_of(c)}
    assert defaults["simulate", "configurations"] == 100
    assert defaults["simulate", "seed"] == 0
    assert defaults["simulate", "errors"] == "geometric"
    assert defaults["simulate", "length_error_mm"] == 0.5
    assert defaults["simulate", "angle_error_mrad"] == 0.5
    assert defaults["simulate", "noise_mm"] == 0.05
    assert defaults["train", "validation"] == 0.5


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_states_what_it_does(command: str) -> None:
    first = COMMANDS[command].help.strip().splitlines()[0]
    assert first.endswith(".")
    assert len(first) > 15
    assert f" {command} " in run("--help").stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_the_first_line_is_whole_in_the_list_of_commands(command: str) -> None:
    first = COMMANDS[command].help.strip().splitlines()[0]
    assert first in run("--help").stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_help_uses_no_words_of_the_paper_or_of_python(command: str) -> None:
    text = run(command, "--help").stdout
    assert not re.search(r"\bEq\.|\bthe paper\b|<(int|str|float|list|bool)|x>=", text)


def test_options_are_in_groups_and_every_group_is_used() -> None:
    text = run("evaluate", "--help").stdout
    places = [text.index(f"\n{head}:\n") for head in ("Arguments", "Data", "Method", "Output")]
    assert places == sorted(places)
    assert text.index("--on ") < text.index("\nMethod:") < text.index("--outside ")
    known = {p.name for command in COMMANDS.values() for p in command.params}
    for names in GROUPS.values():
        assert set(names.split()) <= known


@pytest.mark.parametrize(
    ("metavar", "begun", "found"),
    [
        ("ROBOT", "ur1", ["ur10", "ur10e", "ur16e"]),
        ("FIGURE", "o", ["observability"]),
        ("KINDS", "g", ["geometric", "gear", "gravity"]),
        ("json|c|st", "", ["json", "c", "st"]),
        ("nominal|FILE", "", ["nominal", "a.h5", "b.csv", "sub/"]),
        ("CALIBRATION...", "", ["a.h5", "sub/"]),
        ("MEASUREMENTS", "sub/", ["sub/c.h5"]),
        ("FILE.csv", "", ["b.csv", "sub/"]),
        ("N", "", []),
    ],
)
def test_values_are_completed(metavar: str, begun: str, found: list[str]) -> None:
    Path("sub").mkdir()
    for name in ("a.h5", "b.csv", "sub/c.h5", ".hidden.h5"):
        Path(name).touch()
    assert sorted(completions(metavar, begun)) == sorted(found)


def test_the_shell_gets_the_values() -> None:
    words = {"COMP_WORDS": "calibtool simulate planar", "COMP_CWORD": "2"}
    asked = {**ENVIRONMENT, **words, "_CALIBTOOL_COMPLETE": "complete_bash"}
    done = subprocess.run(
        [sys.executable, "-m", "calibtool"], env=asked, capture_output=True, timeout=60
    )
    assert done.stdout.decode().split() == ["planar-3r"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["evaluat"], "did you mean evaluate? (see calibtool --help)"),
        (["xyzzy"], "known: guide, robots, "),
        (["train", "m.h5", "--fold", "3"], "did you mean --folds"),
        (["train", "m.h5", "--xyzzy"], "known: --output, --base, "),
        (["train"], "Missing argument 'MEASUREMENTS' (see calibtool train --help)"),
        (["view", "c.h5", "--on", "m.h5"], "no option --on; known: --html"),
        (["identify", "m.h5", "--no-gravty"], "did you mean --no-gravity"),
        (["simulate", "ur5", "-n", "0"], "expected at least 1 (see"),
        (["simulate", "ur5", "-n", "3x"], "expected a whole number (see"),
        (["simulate", "ur5", "--noise-mm", "x"], "expected a number (see"),
        (["identify", "m.h5", "--harmonics", "1000"], "expected at most "),
        (["evaluate", "a", "--on", "b", "--method", "x"], "(see calibtool evaluate --help)"),
    ],
)
def test_wrong_use_leads_to_the_right_page(words: list[str], says: str) -> None:
    assert says in refused(2, *words)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_argument_and_option_has_help(command: str) -> None:
    assert [p.name for p in COMMANDS[command].params if not getattr(p, "help", None)] == []


@pytest.mark.parametrize("command", COMMANDS)
def test_help_page_of_a_command(command: str) -> None:
    result = run(command, "--help")
    assert f"Usage: calibtool {command} " in result.stdout
    assert "Example: calibtool" in result.stdout
    assert result.stderr == ""
    assert run(command, "-h").stdout == result.stdout
    for option in options_of(command):
        assert any(name in result.stdout for name in option.opts)


def test_no_command_prints_help() -> None:
    result = run()
    assert result.stdout == run("--help").stdout
    assert result.stderr == ""
    for command in COMMANDS:
        assert f"\n  {command} " in result.stdout


def test_help_names_the_exit_codes() -> None:
    text = " ".join(run("--help").stdout.split())
    for meaning in (
        "0 done",
        "1 unexpected",
        "2 wrong usage",
        "3 bad input data",
        "4 no solution",
        "130 interrupted",
    ):
        assert meaning in text


def test_version() -> None:
    assert run("--version").stdout == f"calibtool {calibtool.__version__}\n"


@pytest.mark.parametrize(
    "start", [["-m", "calibtool"], [str(Path(sys.executable).with_name("calibtool"))]]
)
def test_the_installed_command(start: list[str]) -> None:
    if not Path(start[-1]).exists() and len(start) == 1:
        pytest.skip("calibtool is not installed beside this Python")
    finished = subprocess.run(
        [sys.executable, *start, "--version"], capture_output=True, env=ENVIRONMENT, timeout=60
    )
    assert finished.returncode == 0
    assert finished.stdout.decode() == f"calibtool {calibtool.__version__}\n"
    assert finished.stderr == b""


def test_help_does_not_import_what_computes() -> None:
    """One process asks for every help page, and then what it has imported."""
    pages = [["--help"], ["--version"], *([command, "--help"] for command in COMMANDS)]
    script = (
        "import sys\nfrom calibtool.cli import app\n"
        f"for page in {pages!r}:\n"
        "    try:\n        app(page)\n    except SystemExit as done:\n"
        "        assert not done.code, page\n"
        "heavy = {'numpy', 'scipy', 'pinocchio', 'h5py', 'matplotlib', 'jinja2'} & "
        "set(sys.modules)\n"
        "print('heavy:', *sorted(heavy), file=sys.stderr)\n"
    )
    finished = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, env=ENVIRONMENT, timeout=60
    )
    assert finished.stderr.decode() == "heavy:\n"
    assert finished.returncode == 0


# --- the examples run -----------------------------------------------------------------------------


def _tracker(files: Files) -> None:
    """A tracker's table of a UR10 with names of its own, and the map to it."""
    joints = [f"axis_{j}" for j in range(1, 7)]
    measured_table(files.ten, "tracker.csv", joints)
    targets = "".join(
        f'[[targets]]\nmeasured = ["t{i}_x_mm", "t{i}_y_mm", "t{i}_z_mm"]\nunit = "mm"\n'
        for i in (1, 2, 3)
    )
    Path("map.toml").write_text(
        f'[joints]\ncolumns = {joints}\nunit = "deg"\n{targets}'.replace("'", '"')
    )


def _calibration(files: Files) -> None:
    copy(files.network, "calibration.h5")
    write_table("targets.csv", ["j1_deg", "j2_deg", "j3_deg"], [[10, 20, 30], [0, 60, -20]])


def _measurements(files: Files) -> None:
    copy(files.measurements, "measurements.h5")


def _calibrations(files: Files) -> None:
    _measurements(files)
    for name in ("paper", "local_poe", "fresh"):
        copy(getattr(files, name), ".")


def _nothing(files: Files) -> None:
    del files


def _complete(files: Files) -> None:
    """A complete model, and fresh rows of the same robot."""
    run("identify", files.measurements, "-q", "-o", "complete.h5")
    copy(files.fresh, "fresh.h5")


UNTRIED = ("demo", "serve", "guide")  # long, or not without a client or a terminal
PREPARED: dict[
    str, tuple[Callable[[Files], None], list[str]]
] = {  # what must be there, what must come out
    "robots": (_nothing, []),
    "simulate": (_nothing, ["measurements.h5"]),
    "import": (_tracker, ["measurements.h5"]),
    "plan": (_nothing, ["plan.csv"]),
    "identify": (_measurements, ["complete.h5"]),
    "train": (_measurements, ["paper.h5"]),
    "evaluate": (_calibrations, []),
    "compensate": (_calibration, ["corrected.csv"]),
    "export": (_calibration, ["compensator.c", "compensator.h"]),
    "plot": (_calibrations, ["errors.svg"]),
    "report": (_calibrations, ["report.html"]),
    "view": (_measurements, ["view.html"]),
    "study": (_nothing, ["study.csv"]),
    "monitor": (_complete, ["drift.ndjson"]),
    "info": (_calibration, []),
}


@pytest.mark.parametrize("command", [name for name in COMMANDS if name not in UNTRIED])
def test_example_runs(command: str, files: Files) -> None:
    prepare, outputs = PREPARED[command]
    prepare(files)
    before = {path.name for path in Path().iterdir()}
    arguments = example_of(command)
    assert arguments[0] == command
    result = run(*arguments)
    made = {path.name for path in Path().iterdir()} - before
    assert made == set(outputs)
    assert made or result.stdout


def test_example_of_demo_runs(demo_run: tuple[Path, Any]) -> None:
    assert (demo_run[0] / "measurements.h5").is_file()
