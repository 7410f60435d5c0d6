"""Pages for people: their commands print what is shown, and their sentences are short."""

import re
from pathlib import Path
from typing import Any

import pytest
from test_docs import ROOT, script, without_code

console: Any = script(ROOT / "docs" / "console.py")

EVERY = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
RUN = [page for page in EVERY if "```console\n" in page.read_text("utf-8")]
FOR_PEOPLE = [ROOT / "README.md", *RUN]


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", RUN, ids=name)
def test_commands_print_what_the_page_shows(page: Path, tmp_path: Path) -> None:
    every = console.page_commands(page.read_text("utf-8"))
    for each, printed in zip(every, console.outputs(every, tmp_path), strict=True):
        now = each.displayed(printed)
        assert console.same_output(each.shown, now), (
            f"$ {each.command}\nshown:\n"
            + "\n".join(each.shown)
            + "\nprinted:\n"
            + "\n".join(now)
            + f"\n(python docs/console.py {name(page)} writes it anew)"
        )


def sentences(text: str) -> list[str]:
    """Sentences of prose: without code, tables, headings; links by their words."""
    text = re.sub(r"```.*?```|^\|.*$|^#.*$|<!--.*?-->", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"^\s*(?:[-*]|\d+\.)\s", ". ", text, flags=re.MULTILINE)
    text = re.sub(r"\n\s*\n", ". ", text)
    return [" ".join(part.split()) for part in re.split(r"[.:?!](?=[\s*)])", text) if part.strip()]


@pytest.mark.parametrize("page", FOR_PEOPLE, ids=name)
def test_no_sentence_has_more_than_35_words(page: Path) -> None:
    long = [s for s in sentences(page.read_text("utf-8")) if len(s.split()) > 35]
    assert not long, long


_ODD = ("at the door", "as it comes", "as they come", "carried", "lanes", "come along")


@pytest.mark.parametrize("page", FOR_PEOPLE, ids=name)
def test_words_are_ordinary(page: Path) -> None:
    text = without_code(page.read_text("utf-8")).lower()
    assert not [word for word in _ODD if re.search(rf"\b{word}\b", text)]


def test_the_readme_is_short_and_has_five_commands() -> None:
    text = (ROOT / "README.md").read_text("utf-8")
    assert text.count("\n") <= 130
    assert len(console.page_commands(text)) == 5


def test_a_stranger_is_done_in_ten_commands() -> None:
    """The README's five are among the ten of the page that it leads to."""
    page = ROOT / "docs" / "get-started.md"
    ten = re.findall(r"^\$ ((?:.*\\\n)*.*)$", page.read_text("utf-8"), re.MULTILINE)
    five = [each.command for each in console.page_commands((ROOT / "README.md").read_text("utf-8"))]
    assert len(ten) == 10
    assert set(five) <= set(ten)


def test_outputs_are_compared_by_words_and_numbers() -> None:
    assert console.same_output(("mean  1.23 mm", " ────"), ("mean 1.24 mm", " ──────"))
    assert not console.same_output(("mean 1.23 mm",), ("mean 1.43 mm",))
    assert not console.same_output(("mean 1.23 mm",), ("mean 1.23 mrad",))
    assert not console.same_output(("one", "two"), ("one",))
