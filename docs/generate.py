"""Writes docs/commands.md from the help of the commands, and docs/python.md from the public names:
`python docs/generate.py`, or `make docs`.
"""

from pathlib import Path
from typing import Any, get_type_hints

from typer.main import get_command

import calibtool
from calibtool.cli import app

PAGE = Path(__file__).with_name("commands.md")
NAMES_PAGE = Path(__file__).with_name("python.md")

_INTRODUCTION = """# Commands

Generated from the help (`make docs`); do not edit. `calibtool COMMAND --help` says the same. Files:
[file formats](file-formats.md). First steps: [get started](get-started.md).

"""
_NOT_SHOWN = ("help", "install_completion", "show_completion")


def page() -> str:
    """The whole page, from the commands themselves and not from their rendered help, which
    differs by version.
    """
    group: Any = get_command(app)
    links = [f"[{name}](#{name})" for name in group.commands]
    parts = [
        _INTRODUCTION,
        " ·\n".join(" · ".join(links[i : i + 6]) for i in range(0, len(links), 6)) + "\n",
        _section("calibtool", group, str(group.help), app.registered_callback.callback),
        f"\n{group.epilog}\n",
    ]
    functions = {command.name: command.callback for command in app.registered_commands}
    parts += [
        _section(name, command, command.help, functions[name])
        for name, command in group.commands.items()
    ]
    return "".join(parts)


def names_page() -> str:
    """Directives of mkdocstrings for every public name, by the module that holds it."""
    parts = [
        "# Python, name by name\n\nMade from the docstrings by `make site`. [By example]"
        "(library.md) shows how the names work together. All can be imported from `calibtool`.\n"
    ]
    for place, names in calibtool._PLACES.items():
        parts.append(f"\n## {place}\n")
        parts += [f"\n::: calibtool.{place}.{name}\n" for name in names]
    return "".join(parts)


def _section(name: str, command: Any, text: str, function: Any) -> str:
    paragraphs = [" ".join(part.split()) for part in text.strip().split("\n\n")]
    examples = [
        part.removeprefix("Example: ") for part in paragraphs if part.startswith("Example: ")
    ]
    lines = [f"\n## {name}", *(part for part in paragraphs if not part.startswith("Example: "))]
    lines += [f"```text\n{example}\n```" for example in examples]
    hints = get_type_hints(function)
    rows = [
        _row(each, hints.get(each.name)) for each in command.params if each.name not in _NOT_SHOWN
    ]
    table = ["| argument or option | default | |", "|---|---|---|", *rows]
    return "\n\n".join([*lines, "\n".join(table)]) + "\n"


def _row(parameter: Any, hint: object) -> str:
    """One line of the table: names with what they take, default, help."""
    option = parameter.param_type_name == "option"
    names = (
        ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
        if option
        else ""
    )
    takes = "" if "bool" in str(hint) else parameter.metavar or _takes(hint)
    default = "required" if parameter.required and option else parameter.default
    shown = (
        ""
        if default is None or default is False or isinstance(default, list | tuple)
        else f"{default}"
    )
    cells = [
        " ".join(filter(None, (names, f"`{takes}`" if takes else ""))),
        shown,
        str(parameter.help or ""),
    ]
    return "| " + " | ".join(" ".join(cell.split()).replace("|", r"\|") for cell in cells) + " |"


def _takes(hint: object) -> str:
    """What an option without a name for its value takes."""
    return "INTEGER" if "int" in str(hint) else "NUMBER" if "float" in str(hint) else "TEXT"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8", newline="\n")
    NAMES_PAGE.write_text(names_page(), encoding="utf-8", newline="\n")
