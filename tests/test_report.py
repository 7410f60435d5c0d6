"""The page: the numbers of `evaluate`, names escaped, nothing loaded, every section there
whatever is missing.
"""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from calibtool.calibration import Calibration, identify, train
from calibtool.equivalent.training import TrainingOptions
from calibtool.errors import InputError
from calibtool.evaluation.acceptance import parse_limit
from calibtool.evaluation.compare import evaluate
from calibtool.evaluation.metrics import MethodResult
from calibtool.evaluation.observed import noise_of_errors, point_errors
from calibtool.evaluation.plots import FIGURES, Subject
from calibtool.evaluation.report import html_report, parse_occasion
from calibtool.evaluation.report.content import number
from calibtool.evaluation.report.verdict import cautions, headline, remarks, verdicts
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.setup import Setup
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot

SECTIONS = [
    "verdict",
    "errors",
    "vectors",
    "training",
    "motions",
    "parameters",
    "flagged",
    "observability",
    "coverage",
]
SECTIONS += ["noise", "uncorrectable", "iso9283", "provenance"]
EVIL = '<script>alert("1")</script>&"\' {{ 7*7 }} --> ]]>'


class Page(HTMLParser):
    """Tags, attributes and texts of a page; the contents of scripts by their id."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: dict[str | None, str] = {}
        self.cells: list[str] = []
        self.paragraphs: dict[str, list[str]] = {}
        self._open: list[str] = []
        self._section = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.tags.append((tag, found))
        self._open.append(tag)
        if tag == "section":
            self._section = found["id"] or ""
        if tag == "script":
            self.scripts[found.get("id")] = ""
        if tag in ("td", "th"):
            self.cells.append("")
        if tag == "p":
            self.paragraphs.setdefault(self._section, []).append("")

    def handle_endtag(self, tag: str) -> None:
        while self._open and self._open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] == "script":
            self.scripts[list(self.scripts)[-1]] += data
        if {"td", "th"} & set(self._open) and self.cells:
            self.cells[-1] += data
        if "p" in self._open and self.paragraphs:
            self.paragraphs.setdefault(self._section, [""])[-1] += data

    def ids(self, tag: str) -> list[str | None]:
        return [attributes.get("id") for name, attributes in self.tags if name == tag]


@pytest.fixture(scope="module")
def measurements() -> Measurements:
    robot = load_robot("planar-3r")
    return simulate(robot, Simulation(seed=1, configurations=30))


@pytest.fixture(scope="module")
def fresh(measurements: Measurements) -> Measurements:
    robot = measurements.robot
    options = Simulation(seed=2, configurations=20, same_robot=measurements.truth)
    return simulate(robot, options)


@pytest.fixture(scope="module")
def named(measurements: Measurements) -> list[tuple[str, Calibration]]:
    paper = train(measurements, "nominal", TrainingOptions(restarts=1))
    return [(EVIL, paper), ("complete", identify(measurements, "complete"))]


@pytest.fixture(scope="module")
def subject(named: list[tuple[str, Calibration]], fresh: Measurements) -> Subject:
    limits = (parse_limit("position_max_mm=100"), parse_limit("orientation_p95_mrad=1e-6"))
    return Subject(named, fresh, evaluate(named, fresh), limits)


@pytest.fixture(scope="module")
def text(subject: Subject) -> str:
    return html_report(subject, {"command": EVIL})


@pytest.fixture(scope="module")
def page(text: str) -> Page:
    return Page(text)


@pytest.fixture
def _sketched(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are composed, so that they can refuse, but not drawn: test_plots looks at them."""

    def compose(kind: str, subject: Subject, *_: object, **__: object) -> bytes:
        FIGURES[kind](subject, 120.0)
        return b'<svg viewBox="0 0 1 1"></svg>'

    monkeypatch.setattr("calibtool.evaluation.report.report_page.draw", compose)


def test_every_section_is_there_once_and_in_order(page: Page) -> None:
    assert page.ids("section") == SECTIONS
    every = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(every) == len(set(every))
    links = {a["href"] for tag, a in page.tags if tag == "a"}
    assert links == {f"#{name}" for name in SECTIONS[1:]}


def test_the_numbers_are_those_of_the_evaluation(page: Page, subject: Subject) -> None:
    assert subject.evaluation is not None
    expected = subject.evaluation.as_json()
    assert json.loads(page.scripts["evaluation"]) == json.loads(json.dumps(expected))
    methods: list[dict] = expected["methods"]
    for entry in methods:
        for key in ("position_mm", "orientation_mrad"):
            row = [entry["name"], *(number(value) for value in entry[key].values())]
            at = [k for k in range(len(page.cells)) if page.cells[k : k + len(row)] == row]
            assert at, row


def test_names_from_files_cannot_become_markup(text: str, page: Page) -> None:
    assert "<script>alert" not in text
    assert "49" not in [cell.strip() for cell in page.cells]
    assert EVIL in page.cells
    assert json.loads(page.scripts["evaluation"])["methods"][1]["name"] == EVIL
    assert len(page.scripts) == 3  # two of data and one of ours


def test_nothing_is_loaded_from_anywhere(text: str, page: Page) -> None:
    assert not re.search(r"https?:", text)
    for tag, attributes in page.tags:
        assert tag not in ("iframe", "object", "embed", "base"), tag
        for name in ("src", "href", "srcset", "action", "poster"):
            value = attributes.get(name)
            assert value is None or value.startswith(("#", "data:")), (tag, value)
    assert "default-src 'none'" in text
    assert not re.search(r"url\((?!#)|@import|fetch\(|XMLHttpRequest", text)
    assert len(text.encode()) < 5e6


def test_a_reader_without_eyes_or_mouse_gets_everything(page: Page) -> None:
    heads = [tag for tag, _ in page.tags if re.fullmatch(r"h\d", tag)]
    assert heads[0] == "h1"
    assert heads.count("h1") == 1
    assert heads.count("h2") == len(SECTIONS)
    for tag, attributes in page.tags:
        if tag == "th":
            assert attributes["scope"] in ("row", "col")
        if attributes.get("role") == "img":
            assert attributes["aria-label"]
        if attributes.get("class") in ("scroll", "drawing"):
            assert attributes["tabindex"] == "0"
    assert len([t for t, _ in page.tags if t == "table"]) - len(page.ids("article")) == len(
        [t for t, _ in page.tags if t == "caption"]
    )


def test_drawings_take_the_colours_of_the_page(text: str) -> None:
    drawings = re.findall(r"<svg.*?</svg>", text, flags=re.DOTALL)
    assert len(drawings) == 8
    for svg in drawings:
        assert "var(--ink)" in svg
        assert not re.search(r"(fill|stroke): #(?!0{6}|f{6})", svg)


def test_the_verdict_follows_the_limits(subject: Subject, page: Page) -> None:
    found = verdicts(subject)
    assert [[j.met for j in verdict.judgements] for verdict in found] == [[True, False]] * 2
    assert headline(subject, found).good is False
    assert headline(
        replace(subject, limits=subject.limits[:1]),
        verdicts(replace(subject, limits=subject.limits[:1])),
    ).good
    assert headline(replace(subject, limits=()), found).text.startswith(
        "complete brings the mean position error from"
    )
    assert "not met" in " ".join(page.paragraphs["verdict"]).lower()


def test_judging_on_the_rows_of_the_training_is_reported(
    named: list[tuple[str, Calibration]],
    measurements: Measurements,
    subject: Subject,
    fresh: Measurements,
) -> None:
    own = Subject(named, measurements, evaluate(named, measurements))
    assert "30 of the 30 judged configurations were used" in cautions(own, measurements.q)[0]
    assert not [line for line in cautions(subject, fresh.q) if "were used" in line]
    assert any("out of the actual robot's reach" in line for line in remarks(subject))


@pytest.mark.usefixtures("_sketched")
def test_one_target_and_no_truth(named: list[tuple[str, Calibration]], fresh: Measurements) -> None:
    """Real measurements of one target: no orientation, no network, nothing known of what
    no joint corrects.
    """
    setup = Setup(fresh.setup.T_instrument_base, fresh.setup.targets[:1])
    real = replace(fresh, points=fresh.points[:, :1], setup=setup, truth=None)
    poe = [
        (
            "local-poe",
            replace(named[1][1], base=replace(named[1][1].base, posterior=None, flagged=None)),
        )
    ]
    limits = (parse_limit("orientation_max_mrad=1"),)
    page = Page(html_report(Subject(poe, real, evaluate(poe, real), limits), {}))
    assert page.ids("section") == SECTIONS
    for section, words in {
        "verdict": "measured and predicted",
        "errors": "do not show the orientation",
        "training": "No network was trained",
        "motions": "No calibration has joint motions",
        "flagged": "only the complete model",
        "uncorrectable": "Not known",
        "iso9283": "No configuration was measured",
        "provenance": "Nothing is recorded",
    }.items():
        assert words in " ".join(page.paragraphs[section]), section


@pytest.mark.usefixtures("_sketched")
def test_repeated_and_flagged_rows_are_listed(
    named: list[tuple[str, Calibration]], fresh: Measurements
) -> None:
    complete = named[1][1]
    flagged = replace(
        complete.base.flagged,
        rows=np.array([4, 7]),
        deviation=np.array([5.0, 9.0]),
        position=np.array([1e-3, 2e-3]),
        cluster="joint 2 near 30 deg",
    )
    known = [("complete", replace(complete, base=replace(complete.base, flagged=flagged)))]
    repeated = replace(fresh.rows(np.repeat(np.arange(4), 3)), truth=None)
    subject = Subject(known, repeated, evaluate(known, repeated))
    page = Page(html_report(subject, {}))
    assert page.cells[page.cells.index("8") : page.cells.index("8") + 6] == [
        "8",
        "2.000",
        "9.0",
        "5",
        "1.000",
        "5.0",
    ]
    assert any("joint 2 near 30 deg" in line for line in page.paragraphs["flagged"])
    assert subject.evaluation is not None
    test = subject.evaluation.pose_test
    assert test is not None
    assert number(float(test.repeatability[0]) * 1e3) in page.cells


def test_the_headline_names_who_keeps_the_limits_and_who_does_not(subject: Subject) -> None:
    def said(*limits: str) -> str:
        judged = replace(subject, limits=tuple(parse_limit(limit) for limit in limits))
        return headline(judged, verdicts(judged)).text

    assert said("position_max_mm=1e-6").startswith(
        f"Not met: {EVIL} and complete miss the limit. complete brings "
    )
    assert said("position_max_mm=100", "position_mean_mm=100").startswith(
        f"Met: {EVIL} and complete keep both limits. "
    )
    assert subject.evaluation is not None
    nominal, paper, complete = subject.evaluation.methods
    between = 0.5e3 * float(paper.position_size.max() + complete.position_size.max())
    assert said(f"position_max_mm={between!r}").startswith(
        f"Met: complete keeps the limit; {EVIL} does not. "
    )
    worse = replace(
        subject,
        limits=(),
        evaluation=replace(
            subject.evaluation,
            results=tuple(MethodResult(errors, errors) for errors in (complete, nominal, paper)),
        ),
    )
    found = headline(worse, verdicts(worse))
    assert found.good is False
    assert found.text.startswith("No calibration lowers the mean position error: ")


def test_doubtful_corrections_and_unlike_rows_are_cautions(
    subject: Subject, fresh: Measurements
) -> None:
    assert subject.evaluation is not None
    nominal, paper, complete = subject.evaluation.results
    results = (nominal, replace(paper, outside=2), replace(complete, marked=3))
    doubtful = replace(subject, evaluation=replace(subject.evaluation, results=results))
    found = cautions(doubtful, fresh.q)
    assert f"2 judged configurations are unlike those of the training of {EVIL}." in found
    assert "3 corrections by complete leave a part of the error, or all of it." in found


def test_rows_of_the_training_prove_nothing(
    named: list[tuple[str, Calibration]], measurements: Measurements
) -> None:
    limits = (parse_limit("position_max_mm=100"),)
    own = Subject(named[1:], measurements, evaluate(named[1:], measurements), limits)
    found = verdicts(own)
    assert found[0].met
    assert found[0].badge == ("met on training rows only", "doubt")
    said = headline(own, found)
    assert said.good is None
    assert said.text.startswith("Not proven: the calibration keeps the limit, but on rows that")
    page = html_report(own, {})
    assert 'class="badge good"' not in page
    assert 'class="headline good"' not in page


def test_the_first_page_names_the_occasion(subject: Subject) -> None:
    about = """
title = "Acceptance <b>"
serial = 1234
date = 2026-11-27
[calibrations]
complete = "Calibration of May"
"""
    occasion = parse_occasion(about, "about.toml").changed({"customer": "A & B", "date": None})
    page = Page(html_report(subject, {}, occasion))
    text = html_report(subject, {}, occasion)
    assert "Acceptance &lt;b&gt;" in text
    entries = dict(re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", text))
    assert entries["serial number"] == "1234"
    assert entries["date"] == "2026-11-27"
    assert entries["customer"] == "A &amp; B"
    assert entries["operator"] == ""
    assert "Calibration of May" in page.cells
    methods = json.loads(page.scripts["evaluation"])["methods"]
    assert methods[2]["name"] == "complete"  # data keep the name of the file
    with pytest.raises(InputError, match=r"about.toml: unknown key 'seril'; did you mean serial\?"):
        parse_occasion("seril = 1", "about.toml")
    with pytest.raises(InputError, match=r"about\.toml: "):
        parse_occasion("title = ", "about.toml")


def test_the_noise_beside_an_error_is_that_of_drawn_measurements() -> None:
    """Targets of random places with noise: position and turn of the rigid fit, again and again."""
    rng = np.random.default_rng(4)
    targets, sigma = rng.normal(size=(4, 3)) * 0.2, 5e-5
    setup = Setup(np.eye(4), targets)
    seen = targets + rng.normal(size=(4000, 4, 3)) * sigma
    blank = np.zeros((4000, 6))
    drawn = Measurements(load_robot("ur10"), blank, seen, None, setup, sigma, 1e-4)
    errors = point_errors("noise", seen, np.broadcast_to(np.eye(4), (4000, 4, 4)), setup)
    stated = noise_of_errors(drawn)
    assert np.sqrt((errors.position_size**2).mean()) == pytest.approx(stated["position"], rel=0.02)
    assert errors.orientation_size is not None
    turned = np.sqrt((errors.orientation_size**2).mean())
    assert turned == pytest.approx(stated["orientation"], rel=0.02)
