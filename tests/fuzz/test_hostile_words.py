"""Texts of files never become code: hostile words in every text of every kind of file, and every
product that is made of it compiled, parsed or opened.
"""

import csv
import io
import json
import re
import subprocess
import tomllib
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hostile_words import TOGETHER, WORDS, texts_of, urdf_with, with_texts
from readers import arm, calibrations, measurements, studied, without_digest
from structured_text import FunctionBlock

from calibtool.calibration import Calibration, identify
from calibtool.cli.printing import lines
from calibtool.errors import InputError
from calibtool.evaluation.compare import evaluate
from calibtool.evaluation.plots import Subject
from calibtool.evaluation.report import html_report
from calibtool.evaluation.study.study_table import StudyTable
from calibtool.evaluation.view.scene import scene_of
from calibtool.evaluation.view.scene_page import page_of
from calibtool.export.as_json import calibration_as_json
from calibtool.export.as_urdf import calibration_as_urdf
from calibtool.export.c_code import calibration_as_c
from calibtool.export.structured_text import calibration_as_structured_text
from calibtool.measurement.measurements import Measurements
from calibtool.robot.robot import Robot
from calibtool.robot.source import source_from_urdf
from calibtool.storage import read_any, read_study, to_bytes
from calibtool.storage.studies import study_to_bytes
from calibtool.summary import calibration_summary, measurements_summary, robot_summary
from calibtool.tables import format_table

every_word = pytest.mark.parametrize("word", WORDS, ids=map(str, range(len(WORDS))))
words_together = pytest.mark.parametrize("word", TOGETHER, ids=map(str, range(len(TOGETHER))))


# --- how a product is told from the code in it ----------------------------------------------------


def without_comments(text: str, start: str, end: str) -> str:
    return re.sub(rf"{re.escape(start)}.*?{re.escape(end)}", " ", text, flags=re.DOTALL)


class Skeleton(HTMLParser):
    """The tags of a page with the names of their attributes; what scripts hold."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[object] = []
        self.scripts: list[str] = []
        self._script = False
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, [name for name, _ in attrs]))
        self._script = tag == "script"

    def handle_endtag(self, tag: str) -> None:
        self.tags.append(tag)
        self._script = False

    def handle_data(self, data: str) -> None:
        if self._script:
            self.scripts.append(data)


def no_formula(text: str) -> None:
    """No cell of a CSV begins a formula."""
    for row in csv.reader(io.StringIO(text)):
        for cell in row:
            if cell.lstrip()[:1] in ("=", "@", "+", "-"):
                assert cell == "-" or float(cell.replace(",", ".")) is not None


def for_terminals(printed: list[str]) -> None:
    assert all(line.isprintable() for line in printed)


def compiles(header: str, source: str, folder: Path) -> None:
    (folder / "calibtool.h").write_text(header, encoding="ascii")
    (folder / "calibtool.c").write_text(source, encoding="ascii")
    words = [
        "gcc",
        "-std=c99",
        "-trigraphs",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-fsyntax-only",
        "calibtool.c",
    ]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


# --- calibrations ---------------------------------------------------------------------------------


@cache
def stored() -> tuple[bytes, ...]:
    """A calibration with every part of a file that holds text, and measurements."""
    complete = identify(measurements(), "complete")
    base = replace(
        calibrations()[2].base,
        posterior=complete.base.posterior,
        flagged=complete.base.flagged,
        unobservable=("δζ1.x", "δζ2.y"),
    )
    taught = replace(calibrations()[2], base=base, provenance={"command": "calibtool train"})
    return tuple(without_digest(to_bytes(one)) for one in (taught, measurements()))


@cache
def free() -> tuple[list[tuple[str, str]], ...]:
    """The texts of both files that may be any."""
    found, said = [], []
    for data in stored():
        accepted = []
        for place in texts_of(data):
            try:
                read_any(io.BytesIO(with_texts(data, [place], WORDS[0])), "x.h5")
            except InputError as error:
                said.append(str(error))
            else:
                accepted.append(place)
        found.append(accepted)
    for_terminals(said)
    return tuple(found)


def test_texts_that_are_choices_are_checked_when_they_are_read() -> None:
    calibration, measured = free()
    chosen = {"model name", "networks/0 kind", "training loss", "training optimiser"}
    chosen |= {"training regularisation", "registration kind", "registration_nominal kind"}
    every = {" ".join(place) for place in texts_of(stored()[0])}
    assert chosen <= every
    assert not chosen & {" ".join(place) for place in calibration}
    assert ("training", "reason") in calibration
    assert ("provenance", "command") in calibration
    assert ("registration", "kind") not in measured


def products(calibration: Calibration) -> dict[str, str]:
    header, source = calibration_as_c(calibration)
    return {
        "h": header,
        "c": source,
        "st": calibration_as_structured_text(calibration),
        "json": calibration_as_json(calibration),
        "urdf": calibration_as_urdf(calibration)[0],
        "ros2": calibration_as_urdf(calibration, comments=False)[0],
        "page": page_of(scene_of(calibration), 100.0),
    }


def code(made: dict[str, str]) -> dict[str, object]:
    """What machines read of each product: without comments and names."""
    trees = {
        name: [
            (part.tag, sorted(part.attrib), part.get("xyz"), part.get("rpy"))
            for part in ElementTree.fromstring(made[name]).iter()
        ]
        for name in ("urdf", "ros2")
    }
    assert json.loads(made["json"])
    page = Skeleton(made["page"])
    return {
        "h": without_comments(made["h"], "/*", "*/"),
        "c": without_comments(made["c"], "/*", "*/"),
        "st": without_comments(made["st"], "(*", "*)"),
        "page": page.tags,
        "scripts": page.scripts,
        **trees,
    }


@words_together
def test_every_text_of_a_calibration_at_once(word: str, tmp_path: Path) -> None:
    plain = read_any(io.BytesIO(stored()[0]), "x.h5")
    hostile = read_any(io.BytesIO(with_texts(stored()[0], free()[0], word)), "x.h5")
    assert isinstance(plain, Calibration)
    assert isinstance(hostile, Calibration)
    made = products(hostile)
    assert code(made) == code(products(plain))
    compiles(made["h"], made["c"], tmp_path)
    for_terminals(lines(calibration_summary(hostile) | {"provenance": hostile.provenance}))


@words_together
def test_every_text_of_measurements_at_once(word: str) -> None:
    found = read_any(io.BytesIO(with_texts(stored()[1], free()[1], word)), "x.h5")
    assert isinstance(found, Measurements)
    for_terminals(lines(measurements_summary(found) | {"provenance": found.provenance}))
    plain = Skeleton(page_of(scene_of(measurements()), 1.0))
    assert Skeleton(page_of(scene_of(found), 1.0)).tags == plain.tags


@cache
def report(word: str) -> Skeleton:
    """The page about a calibration and measurements of which all texts are a word, under that
    name.
    """
    data = [with_texts(one, places, word) for one, places in zip(stored(), free(), strict=True)]
    calibration, measured = (read_any(io.BytesIO(one), "x.h5") for one in data)
    assert isinstance(calibration, Calibration)
    assert isinstance(measured, Measurements)
    named = [(word, calibration)]
    subject = Subject(named, measured, evaluate(named, measured))
    return Skeleton(html_report(subject, {word: word}))


@words_together
def test_the_report_has_the_same_elements_whatever_the_words(word: str) -> None:
    kinds = {str(tag) for tag in report("plain").tags}
    found = report(word)
    assert {str(tag) for tag in found.tags} <= kinds
    assert len(found.scripts) == len(report("plain").scripts)


# --- robots ---------------------------------------------------------------------------------------


def compact(text: str) -> object:
    """A description without the words that come from the URDF."""
    table = tomllib.loads(text)
    return [sorted(table), sorted(table["kinematics"]), sorted(table["targets"])]


@words_together
def test_a_bare_urdf_whose_joints_and_links_are_called_by_it(word: str, tmp_path: Path) -> None:
    plain = source_from_urdf(urdf_with(arm(), "x"), "arm")
    try:
        source = source_from_urdf(urdf_with(arm(), word), f"arm{word}")
    except InputError:  # characters that XML does not have
        assert "\x1b" in word
        return
    assert compact(source.toml_text) == compact(plain.toml_text)
    assert tomllib.loads(source.toml_text)["kinematics"]["tool_frame"].startswith("tool0")
    calibrated = replace(
        calibrations()[1],
        robot=Robot.from_source(source),
        base=replace(calibrations()[1].base, model=word),  # as no file says
    )
    made = products(calibrated)
    assert code(made) == code(products(replace(calibrations()[1], robot=Robot.from_source(plain))))
    compiles(made["h"], made["c"], tmp_path)
    assert FunctionBlock(made["st"]).name == "calibtool"
    for_terminals(lines(robot_summary(calibrated.robot)))


# --- tables ---------------------------------------------------------------------------------------


@every_word
def test_no_cell_of_a_table_is_a_formula(word: str) -> None:
    text = format_table([word, "b"], [[word, "-1.5e-3"], ["+2", word], ["-", "=1"]])
    no_formula(text)
    rows = list(csv.reader(io.StringIO(text)))
    assert rows[1][1] == "-1.5e-3"
    assert rows[2][0] == "+2"
    assert [rows[1][0], rows[2][1]] == [rows[0][0]] * 2
    assert rows[0][0].removeprefix("'") == word
    assert format_table(rows[0], rows[1:]) == text  # written again, nothing changes


@every_word
def test_every_text_of_a_study(word: str) -> None:
    data = without_digest(study_to_bytes(studied(), "{}"))
    accepted, said = [], []
    for place in texts_of(data):
        try:
            read_study(io.BytesIO(with_texts(data, [place], word)), "s.h5")
        except InputError as error:
            said.append(str(error))
        else:
            accepted.append(place)
    for_terminals(said)
    assert ("table/status", "") in accepted
    table = read_study(io.BytesIO(with_texts(data, accepted, word)), "s.h5").table
    assert isinstance(table, StudyTable)
    no_formula(table.as_csv())
