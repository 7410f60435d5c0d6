"""The documentation is true: links lead somewhere, the index is complete, the reference is fresh,
the examples run.
"""

import contextlib
import importlib.util
import io
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "data" / "README.md"])
_LINK = re.compile(r"(?<!\!)\[[^\]]*\]\(([^)\s]+)\)")


def without_code(text: str) -> str:
    return re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(
        r"^#+ (.+)$",
        re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.DOTALL),
        re.MULTILINE,
    )
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for link in _LINK.findall(without_code(page.read_text("utf-8"))):
        if "://" in link or link.startswith("mailto:"):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f"{page.name}: {link}"
        if anchor:
            assert anchor in anchors(target), f"{page.name}: {link}"


def test_the_readme_counts_the_built_in_robots() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    found = re.search(r"one of (\d+) \[built-in robots\]", readme)
    assert found is not None
    assert int(found[1]) == sum(path.is_dir() for path in (ROOT / "robots").iterdir())


def test_every_page_is_reached_from_the_index() -> None:
    """Directly, or from a page that is."""
    index = ROOT / "docs" / "README.md"
    reached, new = {index}, [index]
    while new:
        page = new.pop()
        for link in _LINK.findall(without_code(page.read_text("utf-8"))):
            target = (page.parent / link.partition("#")[0]).resolve()
            if target.suffix == ".md" and target not in reached and target.exists():
                reached.add(target)
                new.append(target)
    assert {page for page in PAGES if page.is_relative_to(ROOT / "docs")} <= reached


def script(path: Path) -> Any:
    """A program that stands outside of the package, as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_pages_of_reliability_show_the_kept_figures() -> None:
    made = script(ROOT / "benchmarks" / "reliability.py")
    figures = json.loads(made.FIGURES.read_text("utf-8"))
    for page, text in made.pages(figures).items():
        assert page.read_text("utf-8") == text, (
            f"{page.name} is stale: python benchmarks/reliability.py --page"
        )


def test_the_figures_of_reliability_state_that_the_laws_held() -> None:
    figures = json.loads((ROOT / "benchmarks" / "pages" / "figures.json").read_text("utf-8"))
    rows = {
        name: part["rows"]
        for name, part in figures.items()
        if name.startswith(("fuzz ", "faults "))
    }
    assert rows
    for name, found in rows.items():
        for row in found:
            assert row.get("findings", 0) == 0, name
            assert row.get("worst_ms", 0) < 5000, name
            assert row.get("memory_mib", 0) < 1024, name
            assert row.get("held", 0) == row.get("tries", 0), f"{name}: {row}"


def test_the_command_reference_is_fresh() -> None:
    generate = script(ROOT / "docs" / "generate.py")
    assert generate.PAGE.read_text("utf-8") == generate.page(), (
        "docs/commands.md is stale: make docs"
    )
    assert generate.NAMES_PAGE.read_text("utf-8") == generate.names_page(), (
        "docs/python.md is stale: make docs"
    )


def test_every_page_is_in_the_site() -> None:
    """In its navigation, by a path that is there."""
    text = (ROOT / "mkdocs.yml").read_text("utf-8")
    listed = re.findall(r": (\S+\.md)$", text, re.MULTILINE)
    assert all((ROOT / "docs" / page).is_file() for page in listed)
    every = {page for page in PAGES if page.is_relative_to(ROOT / "docs")}
    assert {ROOT / "docs" / page for page in listed} == every


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-d", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "check_drift" in (tmp_path / "python.html").read_text("utf-8")


def library_blocks() -> list[str]:
    text = (ROOT / "docs" / "library.md").read_text("utf-8")
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


def test_the_examples_of_the_library_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    printed = []
    for block in library_blocks():
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(block, names)
        printed.append(out.getvalue().splitlines())
    arrays, steps, real, files, proof, network, models, programs, controller, errors, pages = (
        printed
    )
    assert arrays[0].startswith("complete model of ur5, 30 configurations: residual")
    assert any(line.startswith("parameters:") for line in arrays)
    assert float(arrays[-1].split()[-2]) < 0.3
    assert (tmp_path / "corrected.csv").read_text().count(",") == 5
    assert steps[-1] == "(50, 6) {'ok'}"
    assert real[0].startswith("[] []")
    assert files[0].startswith("<Calibration of fanuc-m1000ia: complete, 40 configurations")
    assert proof[0].startswith("measured [")
    assert [line for line in network if line.startswith(("networks", "folds"))] == [
        "networks: 1 of 1",
        "folds: 1 of 2",
        "folds: 2 of 2",
    ]
    assert models
    assert programs[-1] == "4 of 4"
    assert controller[-1].startswith("b'movel(p[-0.4")
    assert errors[-1].startswith("2 unknown robot 'fanuk-m1000ia'; did you mean ")
    assert pages == ["4 rows"]


def test_the_examples_of_the_library_have_the_right_types(tmp_path: Path) -> None:
    script = tmp_path / "library.py"
    script.write_text("\n".join(library_blocks()), encoding="utf-8")
    options = ["--ignore-missing-imports", "--follow-imports=silent", "--config-file="]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *options, "--cache-dir", ROOT / ".mypy_cache", script],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stdout
