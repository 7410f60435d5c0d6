"""calibtool report: the page as a file and on stdout, limits, bad input; and what
Chromium makes of it.
"""

import html
import json
import re
import shutil
import subprocess
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from commandline import Files, answer, only_line, refused, rows_of, run

LIMIT = "position_max_mm=0.001"
Open = Callable[..., dict[str, Any]]

# What a browser sees, written into the page as one line of JSON. The page's clock is virtual, so a
# timer comes in time, unlike a frame, which a busy machine may never show.
_LOOK = """<script>addEventListener("load", () => setTimeout(() => {
  const root = document.documentElement;
  const wide = [...document.querySelectorAll("body *")].filter((e) =>
    e.getBoundingClientRect().right > innerWidth + 1 && !e.closest(".drawing, .scroll, .skip"));
  wide.push(...[...document.querySelectorAll(".card *")].filter((e) =>
    e.getBoundingClientRect().right > e.closest(".card").getBoundingClientRect().right + 1));
  dispatchEvent(new Event("beforeprint"));
  parent.document.title = "seen:" + JSON.stringify({
    width: innerWidth, content: root.scrollWidth,
    wide: wide.map((e) => e.tagName + "." + e.className),
    sections: [...document.querySelectorAll("section")]
      .filter((s) => s.offsetHeight > 40).map((s) => s.id),
    drawings: [...document.querySelectorAll(".drawing svg")]
      .filter((s) => s.getBoundingClientRect().height > 60).length,
    paper: getComputedStyle(document.body).backgroundColor,
    ink: getComputedStyle(document.body).color,
    axes: getComputedStyle(document.querySelector(".drawing svg text")).fill,
    scene: document.querySelector("#scene").getContext("2d")
      .getImageData(0, 0, 4000, 4000).data.some((v) => v),
  });
}, 100));</script></body>"""


@pytest.fixture(scope="module")
def page(files: Files) -> str:
    """One page of two calibrations, one of them from stdin and without a network, and a limit
    that neither meets.
    """
    calibration = Path(files.local_poe).read_bytes()
    judged = ("--on", files.fresh, "-o", "-", "--require", LIMIT)
    result = run("report", files.network, "-", *judged, stdin=calibration, code=5)
    assert "above the limit" in only_line(result.stderr)
    return result.stdout_bytes.decode("utf-8")


def test_the_page_holds_what_evaluate_says(page: str, files: Files) -> None:
    found = re.search(r'<script type="application/json" id="evaluation">(.*?)</script>', page)
    assert found is not None
    calibration = Path(files.local_poe).read_bytes()
    assert json.loads(found[1]) == answer(
        "evaluate", files.network, "-", "--on", files.fresh, stdin=calibration
    )
    assert page.startswith("<!DOCTYPE html>")
    assert page.endswith("</html>\n")


def test_the_page_states_where_it_comes_from(page: str) -> None:
    assert "calibtool report " in page
    assert "sha256_calibration_2" in page


def test_wrong_usage(files: Files) -> None:
    assert "CALIBRATION" in refused(2, "report", "--on", files.fresh)
    assert "--on" in refused(2, "report", files.network)
    assert "foo=1" in refused(2, "report", files.network, "--on", files.fresh, "--require", "foo=1")
    assert "mark" in refused(2, "report", files.network, "--on", files.fresh, "--outside", "marc")
    Path("report.html").write_text("mine", encoding="utf-8")
    assert "--force" in refused(2, "report", files.network, "--on", files.fresh)


def test_wrong_files(files: Files) -> None:
    assert "kinematics differ" in refused(3, "report", files.six_network, "--on", files.fresh)
    assert "expected a calibration" in refused(3, "report", files.fresh, "--on", files.fresh)
    assert "expected measurements" in refused(3, "report", files.network, "--on", files.network)


@pytest.fixture
def look(page: str, tmp_path: Path) -> Open:
    """Open the page in headless Chromium; returns what `_LOOK` saw.

    Anything on the console is a failure.
    """
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("there is no chromium on the PATH (apt-get install chromium)")

    def opened(width: int, dark: bool) -> dict[str, Any]:
        place = tmp_path / "page.html"
        framed = html.escape(
            page.replace("</body>", _LOOK)
        )  # a window is never as narrow as a frame can be
        style = f"width: {width}px; height: 800px; border: 0; color-scheme: light dark"
        place.write_text(
            '<!DOCTYPE html><html style="color-scheme: light dark"><link rel="icon" '
            f'href="data:,"><title></title><iframe style="{style}" srcdoc="{framed}"></iframe>',
            encoding="utf-8",
        )
        options = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--enable-logging=stderr",
            "--virtual-time-budget=2000",
        ]
        options += [
            f"--user-data-dir={tmp_path / 'profile'}",
            "--window-size=1200,900",
            "--hide-scrollbars",
        ]
        if dark:
            options.append("--blink-settings=preferredColorScheme=0")
        command = [browser, *options, "--dump-dom", place.as_uri()]
        done = subprocess.run(command, capture_output=True, timeout=60, text=True, encoding="utf-8")
        assert "CONSOLE" not in done.stderr, done.stderr
        seen = re.search(r"<title>seen:(.*?)</title>", done.stdout)
        assert seen is not None, done.stderr[-2000:]
        result: dict[str, Any] = json.loads(html.unescape(seen[1]))
        return result

    return opened


def _lightness(colour: str) -> float:
    return sum(map(int, re.findall(r"\d+", colour)[:3])) / 3


@pytest.mark.parametrize(("width", "dark"), [(1100, False), (400, True)])
def test_the_page_in_a_browser(look: Open, width: int, dark: bool) -> None:
    seen = look(width, dark)
    assert seen["width"] == width
    assert seen["content"] <= width
    assert seen["wide"] == []
    assert len(seen["sections"]) == 13
    assert seen["drawings"] >= 6
    assert seen["scene"]
    assert (_lightness(seen["paper"]) < 60) == dark
    assert (_lightness(seen["ink"]) > 180) == dark
    assert (_lightness(seen["axes"]) > 180) == dark


@pytest.mark.parametrize("paper", ["a4", "letter"])
def test_the_printed_document_has_six_pages_at_most(files: Files, paper: str) -> None:
    if shutil.which("chromium") is None and find_spec("weasyprint") is None:
        pytest.skip("there is neither Chromium nor WeasyPrint")
    judged = ["report", files.six_network, "--on", files.six_fresh, "--pdf", "r.pdf"]
    said = run(*judged, "--paper", paper, "--serial", "7").stderr
    assert "wrote r.pdf: " in said
    pdf = Path("r.pdf").read_bytes()
    assert pdf.startswith(b"%PDF-")
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 6


def test_an_output_called_pdf_is_a_pdf(files: Files, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calibtool.evaluation.report.pdf.to_pdf", lambda page, paper: b"%PDF-")
    said = run("report", files.network, "--on", files.fresh, "-o", "r.PDF").stderr
    assert said.startswith("wrote r.PDF: report of ")
    assert Path("r.PDF").read_bytes() == b"%PDF-"
    assert not Path("report.html").exists()
    judged = ["report", files.network, "--on", files.fresh, "-o", "s.pdf", "--pdf", "t.pdf"]
    assert "-o names a PDF already" in refused(2, *judged)


def test_a_pdf_needs_something_that_prints(files: Files, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calibtool.evaluation.report.pdf.shutil.which", lambda name: None)
    monkeypatch.setattr("calibtool.evaluation.report.pdf.find_spec", lambda name: None)
    message = refused(2, "report", files.network, "--on", files.fresh, "--pdf", "r.pdf")
    assert message.startswith("a PDF needs Chromium or WeasyPrint")


def test_every_parameter_is_in_its_table(files: Files) -> None:
    run("identify", files.measurements, "-o", "c.h5")
    run("report", "c.h5", "--on", files.fresh, "--parameters", "p.csv")
    rows = rows_of(Path("p.csv").read_text())
    known = answer("info", "c.h5")["base"]["parameter_table"]
    assert [row["parameter"] for row in rows] == [entry["id"] for entry in known]
    assert all(
        float(row["value"]) == pytest.approx(entry["value"], rel=1e-6)
        for row, entry in zip(rows, known, strict=True)
    )
