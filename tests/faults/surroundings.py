"""Surroundings that a command must not notice: the same bytes come out, whatever the locale, the
clock, HOME, the folder.

Every one is a real process: `with placed(...)` gives the folder to work in, `run` starts
the command there.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

GERMAN = "de_DE.UTF-8"
INPUTS = ("m.h5", "c.h5", "six.h5", "t.csv", "targets.csv", "weld.ls")
_RUN = "from calibtool.__main__ import main; main()"
_CLOCK = """
import time
now = [4e9]
def backwards():
    now[0] -= 3600
    return now[0]
time.time, time.time_ns = backwards, lambda: int(backwards() * 1e9)
"""
_LOCALE = "import locale; assert locale.setlocale(locale.LC_ALL, '') and f'{1.5:n}' == '1,5'\n"


@dataclass(frozen=True)
class Surroundings:
    """What is taken from the environment, what is added, the folder's name, and Python that runs
    before calibtool.
    """

    added: dict[str, str] = field(default_factory=dict)
    taken: tuple[str, ...] = ()
    folder: str = "plain"
    before: str = ""
    closed: tuple[int, ...] = ()


SURROUNDINGS = {
    "no HOME": Surroundings(
        taken=("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "MPLCONFIGDIR", "USER", "LOGNAME")
    ),
    "a HOME that is not there": Surroundings({"HOME": "/proc/none", "MPLCONFIGDIR": "/proc/none"}),
    "C locale": Surroundings(
        {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    ),
    "de_DE locale, decimal comma": Surroundings({"LC_ALL": GERMAN, "LANG": GERMAN}, before=_LOCALE),
    "a clock that runs backwards": Surroundings(before=_CLOCK),
    "a folder with spaces and non-ASCII names": Surroundings(folder="größe ω – 測量 (1) 'x'"),
    "closed stdin, stdout and stderr": Surroundings(closed=(0, 1, 2)),
}


def german_locale(folder: Path) -> bool:
    """Make the locale in `folder`, for LOCPATH; False where the system has no sources for it."""
    if shutil.which("localedef") is None:
        return False
    command = ["localedef", "-i", "de_DE", "-f", "UTF-8", str(folder / GERMAN)]
    return subprocess.run(command, capture_output=True).returncode == 0


@contextmanager
def placed(inputs: Path, where: Path, surroundings: Surroundings) -> Iterator[Path]:
    """The folder of these surroundings below `where`, with copies of the inputs."""
    folder = where / surroundings.folder
    folder.mkdir()
    for name in INPUTS:
        shutil.copy(inputs / name, folder)
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


def run(
    words: list[str], folder: Path, surroundings: Surroundings, locales: Path | None = None
) -> int:
    """Exit code of `calibtool WORDS`; locales: where the German one was made."""
    environment = {key: value for key, value in os.environ.items() if key not in surroundings.taken}
    environment |= surroundings.added | ({"LOCPATH": str(locales)} if locales else {})

    def close() -> None:
        for number in surroundings.closed:
            os.close(number)

    streams = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    command = [sys.executable, "-c", surroundings.before + _RUN, *words]
    return subprocess.call(command, cwd=folder, env=environment, preexec_fn=close, **streams)
