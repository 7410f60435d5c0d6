"""Runs the ```console blocks of pages and writes what the commands print: `python docs/console.py
PAGE...`. The tests compare it with what the pages show.

A line `$ COMMAND` is run by bash (a command that ends in a backslash goes on in the next line);
what it prints follows. Blocks of a page share one folder. Where the shown output ends in `…`, it is
only the beginning: as many lines as are shown.
"""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_BLOCK = re.compile(r"(```console\n)(.*?)(```)", re.DOTALL)
_NUMBER = re.compile(r"\d[\d,]*(?:\.\d+)?")
_LONGEST = 120  # s that a command may take


@dataclass(frozen=True)
class Command:
    """A command and what is shown below it, as lines."""

    command: str
    shown: tuple[str, ...]

    @property
    def shortened(self) -> bool:
        """Whether only the beginning of the output is shown."""
        return self.shown[-1:] == ("…",)

    def displayed(self, output: str) -> tuple[str, ...]:
        """The lines of an output that a page shows."""
        every = output.rstrip("\n").splitlines()
        lines = tuple(part for line in every for part in _as_on_a_terminal(line))
        first = len(self.shown) - 1
        return (*lines[:first], "…") if self.shortened and len(lines) > first else lines


def _as_on_a_terminal(line: str) -> list[str]:
    """A long line of prose as a terminal of 80 columns shows it; tables and data as they are."""
    from calibtool.cli.files import wrapped

    return wrapped(line, 80) if len(line) > 80 and " " in line.strip() else [line]


def commands(block: str) -> list[Command]:
    """The commands of a block with the output that is shown."""
    found: list[tuple[list[str], list[str]]] = []
    for line in block.splitlines():
        if line.startswith("$ "):
            found.append(([line[2:]], []))
        elif found and not found[-1][1] and found[-1][0][-1].endswith("\\"):
            found[-1][0].append(line)
        else:
            found[-1][1].append(line)
    return [Command("\n".join(given), tuple(shown)) for given, shown in found]


def page_commands(text: str) -> list[Command]:
    """Every command of a page."""
    return [each for match in _BLOCK.finditer(text) for each in commands(match[2])]


def outputs(every: list[Command], folder: Path) -> Iterator[str]:
    """What each command prints, stdout and stderr in the order in which they come.

    RuntimeError where one fails, unless the command says so itself with `|| echo "exit code $?"`.
    """
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "COLUMNS": "80", "OMP_NUM_THREADS": "1"}
    for each in every:
        done = subprocess.run(
            ["bash", "-c", f"set -o pipefail\n{each.command}"],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            timeout=_LONGEST,
            check=False,
        )
        text = done.stdout.decode()
        if done.returncode != 0:
            raise RuntimeError(f"$ {each.command}\n{text}exit code {done.returncode}")
        yield text


def same_output(shown: tuple[str, ...], printed: tuple[str, ...]) -> bool:
    """Whether two outputs agree: their words, and their numbers to 2 % or their last digit.

    Machines differ in the last digits of a sum, and so in the width of a column.
    """
    a, b = (" ".join("\n".join(lines).split()) for lines in (shown, printed))
    a, b = (re.sub("─+", "─", text) for text in (a, b))
    if _NUMBER.sub("#", a) != _NUMBER.sub("#", b):
        return False
    pairs = zip(_NUMBER.findall(a), _NUMBER.findall(b), strict=True)
    return all(_near(x, y) for x, y in pairs)


def _near(x: str, y: str) -> bool:
    values = [float(text.replace(",", "")) for text in (x, y)]
    last = max(10.0 ** -len(text.partition(".")[2]) if "." in text else 0.0 for text in (x, y))
    return abs(values[0] - values[1]) <= max(0.02 * max(values), 1.001 * last)


def rewritten(text: str, folder: Path) -> str:
    """The page with what its commands print now."""
    printed = outputs(page_commands(text), folder)

    def block(match: re.Match[str]) -> str:
        lines = []
        for each in commands(match[2]):
            lines += [f"$ {each.command}", *each.displayed(next(printed))]
        return match[1] + "".join(f"{line}\n" for line in lines) + match[3]

    return _BLOCK.sub(block, text)


if __name__ == "__main__":
    for name in sys.argv[1:]:
        with tempfile.TemporaryDirectory() as made:
            page = Path(name)
            page.write_text(
                rewritten(page.read_text("utf-8"), Path(made)), encoding="utf-8", newline="\n"
            )
