"""Commands that are ended at any moment, and the law of what they may leave; for the tests and for
benchmarks/faults.py.

A command runs in a fork of this process: what is timed is its work, not the imports before it.
"""

import contextlib
import importlib.util
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import h5py
import numpy as np

import calibtool.demo

# All that the commands need is imported once, before the forks.
import calibtool.planning.plan  # noqa: F401
from calibtool.atomic_output import SUFFIX, PartialFile, staged
from calibtool.cli import files, main

SAMPLES = Path(__file__).resolve().parent.parent / "programs"
WATCHED = (
    "files.py",
    "atomic_output.py",
    "interrupts.py",
    "unfinished_files.py",
)  # modules of the command line and the package in which an output comes to be


@dataclass(frozen=True)
class Writer:
    """A command that writes: its arguments, its outputs, and what it may keep when it is ended, in
    the working folder.
    """

    arguments: str
    outputs: tuple[str, ...]
    kept: tuple[str, ...] = ()

    @property
    def words(self) -> list[str]:
        return [*self.arguments.split(), "--force"]


DEMO = tuple(
    f"demo/{name}"
    for name in (
        *(f"{stem}.h5" for stem in ("measurements", "fresh", "paper", "local-poe", "complete")),
        *(f"{stem}.{image}" for stem in ("training", "errors") for image in ("png", "svg")),
        *(
            "evaluation.csv",
            "line.csv",
            "corrected.csv",
            "compensator.json",
            "compensator.h",
            "compensator.c",
        ),
        "report.html",
    )
)
STUDY = "study planar-3r --runs 2 --fresh 10 --methods local-poe --workers 1"
WRITERS = {
    "simulate": Writer("simulate planar-3r -n 20 -o out.h5", ("out.h5",)),
    "import": Writer("import t.csv --robot planar-3r -o out.h5", ("out.h5",)),
    "import, two files": Writer(
        "import t.csv --robot planar-3r --sample 10 -o out.h5 --rest rest.h5", ("out.h5", "rest.h5")
    ),
    "identify": Writer("identify m.h5 -o out.h5", ("out.h5",)),
    "train": Writer("train m.h5 --base nominal --restarts 1 -o out.h5", ("out.h5",)),
    "evaluate": Writer("evaluate c.h5 --on m.h5 -o out.csv", ("out.csv",)),
    "compensate, rows": Writer("compensate c.h5 targets.csv -o out.csv", ("out.csv",)),
    "compensate, program": Writer("compensate six.h5 weld.ls --partial -o out.ls", ("out.ls",)),
    "export, JSON": Writer("export c.h5 --format json -o out.json", ("out.json",)),
    "export, C": Writer("export c.h5 --format c -o out.c", ("out.h", "out.c")),
    "export, Structured Text": Writer("export c.h5 --format st -o out.st", ("out.st",)),
    "export, ONNX": Writer("export c.h5 --format onnx -o out.onnx", ("out.onnx",)),
    "export, URDF": Writer("export c.h5 --format urdf -o out.urdf", ("out.urdf",)),
    "report": Writer("report c.h5 --on m.h5 -o out.html", ("out.html",)),
    "view": Writer("view m.h5 --html out.html", ("out.html",)),
    "robots": Writer("robots planar-3r --picture out.svg", ("out.svg",)),
    "study, CSV": Writer(f"{STUDY} -o out.csv", ("out.csv",), ("out.csv.journal",)),
    "study, HDF5": Writer(f"{STUDY} -o out.h5", ("out.h5",), ("out.h5.journal",)),
    "plot": Writer("plot training c.h5 -o out.svg", ("out.svg",)),
    "plan": Writer("plan planar-3r -n 5 --candidates 100 -o out.csv", ("out.csv",)),
    "demo": Writer("demo -o demo", DEMO),
}


def available(name: str) -> bool:
    """Whether this machine has what the command needs: ONNX is an extra."""
    return name != "export, ONNX" or importlib.util.find_spec("onnx") is not None


def make_inputs(folder: Path) -> None:
    """What the commands above read."""
    targets = "\n".join(
        ["j1_deg,j2_deg,j3_deg", *(f"{i % 50},{20 + i % 30},{30 - i % 20}" for i in range(2000))]
    )
    (folder / "targets.csv").write_text(targets + "\n")
    (folder / "weld.ls").write_bytes((SAMPLES / "weld.ls").read_bytes())
    header = [f"j{j}_deg" for j in (1, 2, 3)] + [
        f"t{i}_{axis}_mm" for i in (1, 2, 3) for axis in "xyz"
    ]
    for command in (
        "simulate planar-3r -n 30 -o m.h5",
        "train m.h5 --base nominal --restarts 1 -o c.h5",
        "simulate fanuc-m1000ia -n 30 -o six-m.h5",
        "identify six-m.h5 --model local-poe -o six.h5",
    ):
        assert finished(start(command.split(), folder)) == 0, command
    with h5py.File(folder / "m.h5") as file:
        q, points = file["measurements/joint_positions"][()], file["measurements/points"][()]
    rows = np.hstack([np.rad2deg(q), points.reshape(len(q), -1) * 1e3]).tolist()
    (folder / "t.csv").write_text(
        "\n".join(",".join(map(str, row)) for row in [header, *rows]) + "\n"
    )


def start(words: list[str], folder: Path, before: Callable[[], object] = lambda: None) -> int:
    """Run `calibtool WORDS` in a fork, silently, after `before`; returns the process id."""
    process = os.fork()
    if process:
        return process
    code = 99
    try:
        os.chdir(folder)
        null = os.open(os.devnull, os.O_RDWR)
        for number in (0, 1, 2):
            os.dup2(null, number)
        sys.stdin, sys.stdout, sys.stderr = (
            os.fdopen(i, mode) for i, mode in ((0, "r"), (1, "w"), (2, "w"))
        )
        signal.signal(
            signal.SIGINT, signal.default_int_handler
        )  # a process in the background may have been told to ignore it
        sys.argv = ["calibtool", *words]
        before()
        main()
        code = 0
    except SystemExit as leaving:
        code = leaving.code if isinstance(leaving.code, int) else 0
    finally:
        os._exit(code)


def finished(process: int) -> int:
    """Exit code, negative for a signal."""
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def at_step(action: Callable[[int], None]) -> Callable[[], None]:
    """Call `action` with its number at every call and return of the writing, from before the
    temporary file is made.
    """
    step = 0

    def count(frame: FrameType, event: str, argument: object) -> None:
        nonlocal step
        folder, name = os.path.split(frame.f_code.co_filename)
        if name in WATCHED and os.path.basename(folder) in ("calibtool", "cli"):
            step += 1
            action(step)

    @contextlib.contextmanager
    def watched(target: Path) -> Iterator[PartialFile]:
        sys.setprofile(count)
        try:
            with staged(target) as part:
                yield part
        finally:
            sys.setprofile(None)

    return lambda: setattr(files, "staged", watched)


def signal_at_step(step: int, number: int) -> Callable[[], None]:
    """Send a signal to the own process at that step of the writing."""
    return at_step(lambda now: os.kill(os.getpid(), number) if now == step else None)


def count_steps(words: list[str], folder: Path) -> int:
    """How many steps the whole command has."""
    read, write = os.pipe()
    process = start(words, folder, at_step(lambda step: os.write(write, b".") and None))
    os.close(write)
    with os.fdopen(read, "rb") as stream:
        steps = len(stream.read())
    assert finished(process) == 0
    return steps


def signal_after(process: int, seconds: float, number: int) -> int:
    """Send a signal after a while; returns the exit code."""
    time.sleep(seconds)
    os.kill(process, number)
    return finished(process)


def limit_file_size(size: int) -> Callable[[], None]:
    """No file can become larger: the write fails as on a full disk."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))


def snapshot(folder: Path, writer: Writer) -> dict[str, bytes]:
    """The outputs that are there."""
    return {
        name: (folder / name).read_bytes() for name in writer.outputs if (folder / name).exists()
    }


def parts(folder: Path) -> list[str]:
    """Temporary files that were left."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob(f"*{SUFFIX}"))


def remove_outputs(folder: Path, writer: Writer) -> None:
    for name in (*writer.outputs, *writer.kept):
        (folder / name).unlink(missing_ok=True)
    for name in parts(folder):
        (folder / name).unlink()


def broken(
    folder: Path, writer: Writer, old: dict[str, bytes], new: dict[str, bytes], others: set[str]
) -> str:
    """What breaks the law, '' for nothing: every output is the old one, the new one or (if there
    was none) absent.
    """
    now = snapshot(folder, writer)
    for name in writer.outputs:
        if now.get(name) not in (old.get(name), new[name]):
            return f"{name} is neither old nor new"
    strange = everything(folder) - others - {*writer.outputs, *writer.kept, *parts(folder)}
    return f"left behind: {', '.join(sorted(strange))}" if strange else ""


def everything(folder: Path) -> set[str]:
    """Every file below a folder."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
