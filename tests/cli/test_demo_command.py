"""calibtool demo: the whole way in one folder."""

import json
import re
from pathlib import Path

import pytest
from commandline import answer, refused, rows_of, run
from typer.testing import Result

Demo = tuple[Path, Result]

FITTED = ["paper", "local-poe", "complete"]
TABLES = ["evaluation.csv", "line.csv", "corrected.csv"]
FIGURES = [f"{name}.{image}" for name in ("training", "errors") for image in ("png", "svg")]
EXPORTED = [f"compensator.{suffix}" for suffix in ("json", "c", "h")]
NAMES = [
    *(f"{name}.h5" for name in ("measurements", "fresh", *FITTED)),
    *TABLES,
    *FIGURES,
    *EXPORTED,
    "report.html",
]


def test_every_file_is_there_and_named(demo_run: Demo) -> None:
    folder, result = demo_run
    assert sorted(path.name for path in folder.iterdir()) == sorted(NAMES)
    for name in NAMES:
        assert (folder / name).stat().st_size > 100
        assert f"demo/{name}" in result.stderr


def test_it_ends_with_what_there_is_to_look_at(demo_run: Demo) -> None:
    last = [Path(line.strip()).name for line in demo_run[1].stderr.splitlines()[-5:]]
    assert last == ["report.html", *sorted(FIGURES)]


def test_the_report_is_that_of_the_evaluation(demo_run: Demo) -> None:
    page = (demo_run[0] / "report.html").read_text(encoding="utf-8")
    found = json.loads(re.search(r'id="evaluation"[^>]*>(.*?)</script>', page, re.DOTALL)[1])
    files = [demo_run[0] / f"{name}.h5" for name in FITTED]
    assert found == answer("evaluate", *files, "--on", demo_run[0] / "fresh.h5")
    assert len(page.encode()) < 5e6


def test_stdout_stays_empty(demo_run: Demo) -> None:
    assert demo_run[1].stdout_bytes == b""


def test_the_evaluation_is_printed_and_true(demo_run: Demo) -> None:
    """The printed table is that of `evaluate` on the files left behind."""
    folder, result = demo_run
    value = answer(
        "evaluate", *(folder / f"{name}.h5" for name in FITTED), "--on", folder / "fresh.h5"
    )
    assert [method["name"] for method in value["methods"]] == ["nominal", *FITTED]
    assert value["configurations"] == 1000
    printed = {
        line.split()[0]: line.split()
        for line in reversed(result.stderr.splitlines())
        if line.strip()
    }
    for method in value["methods"]:
        found = method["position_mm"]
        assert float(printed[method["name"]][1]) == pytest.approx(found["mean"], rel=5e-3)
        assert float(printed[method["name"]][4]) == pytest.approx(found["max"], rel=5e-3)


def test_compensation_helps(demo_run: Demo) -> None:
    folder, _ = demo_run
    for method in answer("evaluate", folder / "paper.h5", "--on", folder / "fresh.h5")["methods"][
        1:
    ]:
        assert method["reduction_percent"]["position_mean"] > 80


def test_the_files_are_those_of_the_commands(demo_run: Demo) -> None:
    folder, _ = demo_run
    best = folder / "complete.h5"
    values = ["--joint-values", "controller"]
    corrected = run("compensate", best, folder / "line.csv", *values).stdout
    assert corrected == (folder / "corrected.csv").read_text()
    exported = json.loads(run("export", best, "--format", "json", *values).stdout)
    left = json.loads((folder / "compensator.json").read_text(encoding="utf-8"))
    assert {**left, "provenance": None} == {**exported, "provenance": None}
    run("export", best, "--format", "c", *values, "-o", "compensator.c")
    for name in ("compensator.c", "compensator.h"):
        assert Path(name).read_bytes() == (folder / name).read_bytes()
    compared = [folder / f"{name}.h5" for name in FITTED]
    table = run("evaluate", *compared, "--on", folder / "fresh.h5", "-o", "-").stdout
    assert table == (folder / "evaluation.csv").read_text()


def test_every_file_states_where_it_comes_from(demo_run: Demo) -> None:
    folder, _ = demo_run
    for name in ("measurements", "fresh", *FITTED):
        assert answer("info", folder / f"{name}.h5")["provenance"]["command"] == "calibtool demo"
    provenance = json.loads((folder / "compensator.json").read_text(encoding="utf-8"))["provenance"]
    assert provenance == answer("info", folder / "complete.h5")["provenance"]


def test_the_line_is_straight_and_all_of_it_is_corrected(demo_run: Demo) -> None:
    folder, _ = demo_run
    line, corrected = (
        rows_of((folder / name).read_text()) for name in ("line.csv", "corrected.csv")
    )
    assert len(line) == len(corrected) == 100
    assert {row["x_mm"] for row in line} == {line[0]["x_mm"]}
    assert {row["status"] for row in corrected} == {"ok"}
    assert [row["point"] for row in corrected] == [row["point"] for row in line]


def test_the_files_describe_themselves(demo_run: Demo) -> None:
    folder, _ = demo_run
    assert answer("info", folder / "measurements.h5")["configurations"] == 100
    assert answer("info", folder / "paper.h5")["base"]["model"] == "nominal"
    assert answer("info", folder / "local-poe.h5")["network"]["used"] is False
    assert (
        json.loads((folder / "compensator.json").read_text(encoding="utf-8"))["robot"]
        == "fanuc-m1000ia"
    )


def test_a_folder_with_files_is_left_alone() -> None:
    Path("demo").mkdir()
    Path("demo/mine.txt").write_text("mine")
    assert "--force" in refused(2, "demo")
    assert "--force" in refused(2, "demo", "-o", "demo")


@pytest.mark.parametrize("output", ["-", "taken", "taken/below"])
def test_outputs_that_are_no_folder(output: str) -> None:
    Path("taken").write_text("a file")
    assert output in refused(2, "demo", "-o", output).replace(
        "-o DIR", "-" if output == "-" else ""
    )


def test_an_empty_name_is_no_folder() -> None:
    """Not the working folder either: sixteen files there would be a surprise."""
    refused(2, "demo", "-o", "")
