"""How these tests run commands: in this process, in a real shell, and commands that must fail."""

import csv
import io
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from typer.main import get_command
from typer.testing import CliRunner, Result

from calibtool.cli import app

_OWN = (
    "FORCE_COLOR",
    "CLICOLOR_FORCE",
    "PYTHONUNBUFFERED",
    "PYTHONIOENCODING",
)  # the tests choose these themselves
ENVIRONMENT = {
    **{name: value for name, value in os.environ.items() if name not in _OWN},
    "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}

COMMANDS: dict[str, Any] = get_command(app).commands


@dataclass(frozen=True)
class Files:
    """Small files that the commands made once; tests read them and write elsewhere."""

    folder: Path

    def __getattr__(self, name: str) -> str:
        """`files.local_poe` is the path of local-poe.h5."""
        path = self.folder / f"{name.replace('_', '-')}.h5"
        if name.startswith("__") or not path.exists():
            raise AttributeError(name)
        return str(path)


def run(*arguments: object, stdin: bytes | str = b"", code: int = 0) -> Result:
    """Run `calibtool ARGUMENTS` in this process and check its exit code."""
    result = CliRunner().invoke(
        app, [str(a) for a in arguments], input=stdin, prog_name="calibtool"
    )
    assert result.exit_code == code, (
        f"calibtool {arguments}: exit code {result.exit_code}\n{result.stderr}"
    )
    return result


def answer(*arguments: object, stdin: bytes | str = b"", code: int = 0) -> dict[str, Any]:
    """Run a command with --json; stdout is exactly one JSON object, on one
    line, which is returned.
    """
    result = run(*arguments, "--json", stdin=stdin, code=code)
    assert result.stdout.count("\n") == 1
    value = json.loads(result.stdout)
    assert isinstance(value, dict)
    return value


def refused(code: int, *arguments: object, stdin: bytes | str = b"") -> str:
    """Run a command that must fail; returns its message.

    One line on stderr (warnings aside), nothing on stdout, and the working folder as it was before.
    """
    before = contents(Path.cwd())
    result = run(*arguments, stdin=stdin, code=code)
    line = only_line(result.stderr)
    assert result.stdout_bytes == b""
    assert contents(Path.cwd()) == before, "a failed command changed files"
    return line


def remarks(result: Result) -> str:
    """What a command said on stderr but for the lines that name what it wrote."""
    lines = result.stderr.splitlines(keepends=True)
    return "".join(line for line in lines if not line.startswith("wrote "))


def only_line(stderr: str) -> str:
    """The one line of stderr that is neither a warning nor names an output: no traceback, and no
    request for a bug report.
    """
    known = ("warning: ", "wrote ")  # of outputs that are written before a limit is judged
    lines = [line for line in stderr.splitlines() if not line.startswith(known)]
    assert len(lines) == 1, stderr
    assert "Traceback" not in stderr
    assert not lines[0].startswith("unexpected "), lines[0]
    return lines[0]


def contents(folder: Path) -> dict[str, bytes | None]:
    """Every file below a folder with its bytes, hidden ones too; None for folders and what is
    no regular file.
    """
    return {
        str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None
        for p in sorted(folder.rglob("*"))
    }


def shell(
    script: str, folder: Path, timeout: float = 120, **environment: str
) -> subprocess.CompletedProcess[bytes]:
    """Run a bash script with pipefail, `calibtool` on the PATH."""
    return subprocess.run(
        ["bash", "-c", f"set -o pipefail\n{script}"],
        cwd=folder,
        env={**ENVIRONMENT, **environment},
        capture_output=True,
        stdin=subprocess.DEVNULL,
        timeout=timeout,
    )


def rows_of(text: str) -> list[dict[str, str]]:
    """A CSV text as one dictionary per row."""
    return list(csv.DictReader(io.StringIO(text)))


def write_table(
    path: str, header: Sequence[str], rows: Sequence[Sequence[object]], separator: str = ","
) -> str:
    """Write a table without any quoting; returns the path."""
    lines = [separator.join(header), *(separator.join(map(str, row)) for row in rows)]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def stored(path: str, name: str) -> np.ndarray:
    """A dataset of a calibtool file, as docs/file-formats.md names it."""
    with h5py.File(path, "r") as file:
        return np.asarray(file[name][()])


def measured_table(path: str, table: str, joints: Sequence[str] | None = None) -> str:
    """What an instrument would have written: a measurements file (revolute joints) as CSV
    in degrees and mm.
    """
    q, points = stored(path, "measurements/joint_positions"), stored(path, "measurements/points")
    header = list(joints or [f"j{j + 1}_deg" for j in range(q.shape[1])])
    header += [f"t{i + 1}_{axis}_mm" for i in range(points.shape[1]) for axis in "xyz"]
    rows = np.hstack([np.rad2deg(q), points.reshape(len(q), -1) * 1e3])
    return write_table(table, header, rows.tolist())


def example_of(command: str) -> list[str]:
    """The arguments of the command's `Example:` line, without `calibtool`."""
    text = str(COMMANDS[command].help)
    lines = [line.strip() for line in text.splitlines() if line.strip().startswith("Example: ")]
    assert len(lines) == 1, f"{command} has {len(lines)} examples"
    words = shlex.split(lines[0].removeprefix("Example: "))
    assert words[0] == "calibtool", lines[0]
    return words[1:]
