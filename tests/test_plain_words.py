"""README, how-to pages and help are in short sentences and ordinary words."""

import ast
import re
from pathlib import Path

import pytest
from typer.main import get_command

from calibtool.cli import app

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = [
    ROOT / "README.md",
    DOCS / "get-started.md",
    DOCS / "glossary.md",
    *sorted((DOCS / "how-to").glob("*.md")),
    *sorted((DOCS / "evidence").glob("*.md")),
]
COMMANDS = get_command(app).commands
LONGEST = 35  # words of a sentence
PRIVATE = r"\blanes?\b|at the door|\bcarried\b|what is left|as it comes|t(old|ell) apart|freed of"


def sentences(text: str) -> list[str]:
    """The sentences of a page's prose, without code, tables, headings and the targets of links."""
    text = re.sub(
        r"\[([^\]]*)\]\([^)]*\)", r"\1", re.sub(r"```.*?```", "\n\n", text, flags=re.DOTALL)
    )
    text = re.sub(r"^(?:    .*|\|.*|#.*)$", "\n", text, flags=re.MULTILINE)
    parts = re.split(r"\n\s*\n|\n\s*- ", text)
    return [s for part in parts for s in re.split(r"(?<=[.:;?])\s+", " ".join(part.split())) if s]


def help_of(command: str) -> str:
    """What `--help` of a command says, a paragraph for each option."""
    known = COMMANDS[command]
    return "\n\n".join([known.help, *(str(p.help) for p in known.params if getattr(p, "help", ""))])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_pages_have_short_sentences(page: Path) -> None:
    assert [s for s in sentences(page.read_text("utf-8")) if len(s.split()) > LONGEST] == []


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_short_sentences(command: str) -> None:
    assert [s for s in sentences(help_of(command)) if len(s.split()) > LONGEST] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_pages_use_no_private_words(page: Path) -> None:
    assert re.findall(PRIVATE, page.read_text("utf-8")) == []


@pytest.mark.parametrize("command", COMMANDS)
def test_help_uses_no_private_words(command: str) -> None:
    assert re.findall(PRIVATE, help_of(command)) == []


@pytest.mark.parametrize("room", sorted((ROOT / "calibtool").iterdir()), ids=lambda path: path.name)
def test_docstrings_use_no_private_words(room: Path) -> None:
    found = []
    for path in sorted(room.rglob("*.py")) if room.is_dir() else [room] * (room.suffix == ".py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                text = " ".join((ast.get_docstring(node) or "").split())
                found += [f"{path.name}: {word[0]}" for word in re.finditer(PRIVATE, text)]
    assert found == []


def test_a_long_sentence_is_found() -> None:
    long = " ".join(["word"] * (LONGEST + 1))
    assert sentences(f"Short one. {long}.\n\n    code {long}\n") == ["Short one.", f"{long}."]
