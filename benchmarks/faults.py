"""What commands leave when they are ended, starved or run twice at once, in whatever surroundings.

Run: python benchmarks/faults.py [--tries 100] [--command NAME]... [--kills] [--json]

On another file system, for example a FAT image mounted at FOLDER:
TMPDIR=FOLDER python benchmarks/faults.py --kills

TRIES kills of every writing command at random moments, half as many at random steps of the
writing, a quarter of the other faults that chance decides, the rest once. A row per fault and
command goes to stdout.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "faults"))

import ended
from ended import WRITERS, Writer, available, broken, everything, finished, parts, snapshot, start
from surroundings import SURROUNDINGS, german_locale, placed, run

PAGE = 4096  # a tmpfs gives room in these
GENERAL = "several processes"  # what is not about one command


@dataclass(frozen=True)
class Row:
    """One fault on one command: tries, how often the law held, what was seen, and what broke it."""

    fault: str
    command: str
    tries: int
    held: int
    seen: str
    broken: tuple[str, ...]

    @classmethod
    def of(cls, fault: str, command: str, outcomes: list[str], seen: str) -> "Row":
        """outcomes: '' where the law held, else what broke it."""
        bad = [outcome for outcome in outcomes if outcome]
        return cls(
            fault, command, len(outcomes), len(outcomes) - len(bad), seen, tuple(sorted(set(bad)))
        )


class Bench:
    """A working folder with the inputs, and what every command makes there."""

    def __init__(self, folder: Path, tries: int, kills: bool) -> None:
        self.tries, self.kills, self.random = tries, kills, random.Random(0)
        self.inputs, self.folder, self.locales = (
            folder / "inputs",
            folder / "work",
            folder / "locales",
        )
        for made in (self.inputs, self.folder, self.locales):
            made.mkdir()
        ended.make_inputs(self.inputs)
        ended.make_inputs(self.folder)
        self.others = everything(self.folder)
        self.german = german_locale(self.locales)

    def command(self, name: str) -> Iterator[Row]:
        """All faults of one writing command."""
        writer = WRITERS[name]
        began = time.perf_counter()
        assert finished(start(writer.words, self.folder)) == 0
        duration, new = time.perf_counter() - began, snapshot(self.folder, writer)
        ended.remove_outputs(self.folder, writer)  # a finished study would not write again
        steps = ended.count_steps(writer.words, self.folder)
        for fault in ("kill -9 at a random moment", "kill -9 at a random step of the writing"):
            yield self.killed(fault, name, new, duration, steps)
        if self.kills:
            return ended.remove_outputs(self.folder, writer)
        yield from self.asked_to_end(name, new, steps)
        if name != "demo":  # of sixteen files, some are written before the disk is full
            yield self.large_file(name, new)
            with small_disk() as disk:
                if disk is not None:
                    yield self.full_disk(name, disk)
        yield self.read_only(name)
        ended.remove_outputs(self.folder, writer)
        yield from self.surroundings(name, new)

    def killed(
        self, fault: str, name: str, new: dict[str, bytes], duration: float, steps: int
    ) -> Row:
        writer, outcomes, seen = WRITERS[name], [], Counter[str]()
        for i in range(self.tries if "moment" in fault else max(self.tries // 2, 1)):
            old = self.prepare(writer, i % 2 == 1)
            if "moment" in fault:
                process = start(writer.words, self.folder)
                ended.signal_after(process, self.random.uniform(0, duration), signal.SIGKILL)
            else:
                step = self.random.randint(1, steps)
                finished(
                    start(writer.words, self.folder, ended.signal_at_step(step, signal.SIGKILL))
                )
            outcomes.append(broken(self.folder, writer, old, new, self.others))
            seen.update(self.state(writer, old, new))
        left = len(parts(self.folder))
        finished(start(writer.words, self.folder))
        if snapshot(self.folder, writer) != new or parts(self.folder):
            outcomes.append("the next run did not put it in order")
        counts = ", ".join(f"{number} {state}" for state, number in sorted(seen.items()))
        return Row.of(
            fault, name, outcomes, f"{counts}; {left} temporary files, gone after the next run"
        )

    def asked_to_end(self, name: str, new: dict[str, bytes], steps: int) -> Iterator[Row]:
        """SIGINT and SIGTERM at a random step: as above, nothing is left over, and the
        exit code says so.
        """
        writer = WRITERS[name]
        for number, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
            outcomes, codes = [], Counter[int]()
            for i in range(max(self.tries // 4, 1)):
                old = self.prepare(writer, i % 2 == 1)
                step = self.random.randint(1, steps)
                found = finished(
                    start(writer.words, self.folder, ended.signal_at_step(step, number))
                )
                codes[found] += 1
                problem = broken(self.folder, writer, old, new, self.others)
                mixed = len(set(self.state(writer, old, new))) > 1 and name != "demo"
                wrong = (
                    f"exit code {found}"
                    if found not in (0, code)
                    else "old and new mixed"
                    if mixed
                    else ""
                )
                outcomes.append(problem or wrong or ", ".join(parts(self.folder)))
            seen = ", ".join(
                f"exit code {code}: {number}" for code, number in sorted(codes.items())
            )
            yield Row.of(
                f"{signal.Signals(number).name} at a random step of the writing",
                name,
                outcomes,
                seen,
            )

    def large_file(self, name: str, new: dict[str, bytes]) -> Row:
        """Files cannot become larger than a part of the output."""
        writer, outcomes = WRITERS[name], []
        for i in range(max(self.tries // 4, 1)):
            old = self.prepare(writer, i % 2 == 1)
            size = self.random.randrange(max(map(len, new.values())))
            code = finished(start(writer.words, self.folder, ended.limit_file_size(size)))
            problem = broken(self.folder, writer, old, new, self.others) or ", ".join(
                parts(self.folder)
            )
            kept = "" if snapshot(self.folder, writer) == old else "not as before"
            outcomes.append(problem or kept or ("" if code == 2 else f"exit code {code}"))
        return Row.of("no room for the whole file", name, outcomes, "as before, exit code 2")

    def full_disk(self, name: str, disk: Path) -> Row:
        """The output stands on a file system of 1 MiB, of which a part of the output is free."""
        words, outcomes = WRITERS[name].arguments, []
        for output in WRITERS[name].outputs:
            words = re.sub(rf"(?<= ){re.escape(output)}\b", str(disk / output), words)
        writer = replace(WRITERS[name], arguments=words)
        assert finished(start(writer.words, self.folder)) == 0
        pages = -(-max(map(len, snapshot(disk, writer).values())) // PAGE)
        for i in range(max(self.tries // 4, 1)):
            for path in disk.iterdir():
                path.unlink()
            if i % 2 == 1:
                for output in writer.outputs:
                    (disk / output).write_bytes(b"old")
            old = snapshot(disk, writer)
            fill(disk / "filler", self.random.randrange(pages))
            code = finished(start(writer.words, self.folder))
            kept = "" if snapshot(disk, writer) == old else "not as before"
            more = everything(disk) - {"filler", *writer.outputs, *writer.kept}
            outcomes.append(kept or ", ".join(more) or ("" if code == 2 else f"exit code {code}"))
        return Row.of("a full disk (tmpfs)", name, outcomes, "as before, exit code 2")

    def read_only(self, name: str) -> Row:
        """A folder in which nothing can be written: exit code 2, and nothing changes."""
        writer, outcomes = WRITERS[name], []
        for existing in (False, True):
            old = self.prepare(writer, existing)
            before, modes = everything(self.folder), {}
            for folder in (self.folder, self.folder / "demo"):
                if folder.is_dir():
                    modes[folder] = folder.stat().st_mode
                    folder.chmod(0o555)
            try:
                code = finished(start(writer.words, self.folder, becoming_nobody))
            finally:
                for folder, mode in modes.items():
                    folder.chmod(mode)
            same = snapshot(self.folder, writer) == old and everything(self.folder) == before
            outcomes.append(
                "something changed" if not same else "" if code == 2 else f"exit code {code}"
            )
        return Row.of("a read-only folder", name, outcomes, "as before, exit code 2")

    def surroundings(self, name: str, new: dict[str, bytes]) -> Iterator[Row]:
        """The bytes are those of a plain process; what also has an answer for a closed stdout
        writes nothing and says so.
        """
        writer = WRITERS[name]
        for fault, chosen in SURROUNDINGS.items():
            german = "de_DE" in fault
            if german and not self.german:
                continue
            with placed(self.inputs, self.folder.parent, chosen) as folder:
                code = run(writer.words, folder, chosen, self.locales if german else None)
                found = snapshot(folder, writer)
            if "closed" in fault and code == 2 and not found:
                yield Row.of(fault, name, [""], "exit code 2, nothing written")
                continue
            same = "" if found == new else "other bytes"
            yield Row.of(
                fault, name, [same or ("" if code == 0 else f"exit code {code}")], "the same bytes"
            )

    def prepare(self, writer: Writer, existing: bool) -> dict[str, bytes]:
        """Old outputs, or none; returns them. Temporary files stay where they are."""
        for name in (*writer.outputs, *writer.kept):
            (self.folder / name).unlink(missing_ok=True)
        for name in writer.outputs if existing else ():
            (self.folder / name).write_bytes(b"old " * 20_000)
        return snapshot(self.folder, writer)

    def state(self, writer: Writer, old: dict[str, bytes], new: dict[str, bytes]) -> list[str]:
        """Of every output: absent, old or new."""
        now = snapshot(self.folder, writer)
        return [
            "absent"
            if name not in now
            else "new"
            if now[name] == new[name]
            else "old"
            if name in old
            else "HALF"
            for name in writer.outputs
        ]

    def two_at_once(self) -> Iterator[Row]:
        """Two processes write one file: it is one of theirs, and without --force only one may."""
        seeds = [f"simulate planar-3r -n 20 --seed {seed} -o out.h5".split() for seed in (1, 2)]
        made = []
        for words in seeds:
            assert finished(start([*words, "--force"], self.folder)) == 0
            made.append((self.folder / "out.h5").read_bytes())
        for force, expected in ([], [[0, 2]]), (["--force"], [[0, 0]]):
            outcomes = []
            for _ in range(self.tries):
                (self.folder / "out.h5").unlink(missing_ok=True)
                running = [start([*words, *force], self.folder) for words in seeds]
                codes = sorted(finished(process) for process in running)
                whole = (self.folder / "out.h5").read_bytes() in made and not parts(self.folder)
                outcomes.append(
                    "" if whole and codes in expected else f"whole {whole}, exit codes {codes}"
                )
            how = (
                "both write, the last one stays" if force else "one writes, the other: exit code 2"
            )
            yield Row.of("two processes, one output", " ".join(["simulate", *force]), outcomes, how)
        (self.folder / "out.h5").unlink()

    def stdout_that_takes_nothing(self) -> Iterator[Row]:
        """Closed, full, or with a reader that goes away: an exit code, and no traceback."""
        commands = (
            "simulate planar-3r -n 20 -o -",
            "compensate c.h5 targets.csv",
            "export c.h5 --format json -o -",
        )
        for name, shell in (
            ("closed", ">&-"),
            ("full", "> /dev/full"),
            ("its reader gone", "| head -c 10 > /dev/null"),
        ):
            for words in commands:
                line = f"{sys.executable} -m calibtool {words} {shell}; exit ${{PIPESTATUS[0]}}"
                done = subprocess.run(
                    ["bash", "-c", line], cwd=self.folder, capture_output=True, text=True
                )
                said = done.stderr.splitlines()
                expected = (0, 1) if "reader" in name else (2,)  # 0: it came too late to be noticed
                wrong = "" if done.returncode in expected else f"exit code {done.returncode}"
                noisy = "a traceback" if "Traceback" in done.stderr else ""
                quiet = f"exit code {done.returncode}, {len(said)} lines on stderr"
                yield Row.of(f"stdout: {name}", words.split()[0], [noisy or wrong], quiet)

    def interrupted_at_the_start(self) -> Iterator[Row]:
        """Ctrl-C while a real process starts.

        The first moments belong to the interpreter itself.
        """
        command = [
            sys.executable,
            "-m",
            "calibtool",
            "simulate",
            "planar-3r",
            "-n",
            "20",
            "-o",
            "out.h5",
            "--force",
        ]
        for span in (0.1, 2.0):
            outcomes, codes = [], Counter[str]()
            for _ in range(self.tries):
                process = subprocess.Popen(
                    command, cwd=self.folder, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL
                )
                time.sleep(self.random.uniform(0, span))
                process.send_signal(signal.SIGINT)
                said = process.communicate()[1].decode()
                own = "calibtool/" in said
                codes[
                    f"{process.returncode}{' with a traceback of the interpreter' if said else ''}"
                ] += 1
                outcomes.append(said.splitlines()[-1] if own else ", ".join(parts(self.folder)))
            seen = ", ".join(
                f"exit code {code}: {number}" for code, number in sorted(codes.items())
            )
            yield Row.of(f"SIGINT in the first {span} s of a process", "simulate", outcomes, seen)

    def general(self) -> Iterator[Row]:
        yield from self.two_at_once()
        yield from self.stdout_that_takes_nothing()
        yield from self.interrupted_at_the_start()


def becoming_nobody() -> None:
    """Root may write everywhere."""
    if os.geteuid() == 0:
        # Nobody may not even read where root's Python stands: what is imported late
        # is imported now.
        version("calibtool")
        os.setresuid(65534, 65534, 65534)


@contextmanager
def small_disk() -> Iterator[Path | None]:
    """A file system of 1 MiB; None without the right to mount one."""
    with tempfile.TemporaryDirectory() as folder:
        if (
            os.geteuid() != 0
            or subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "none", folder]).returncode
        ):
            yield None
            return
        try:
            yield Path(folder)
        finally:
            subprocess.run(["umount", folder], check=True)


def fill(path: Path, pages: int) -> None:
    """Leave so many pages free."""
    with open(path, "wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(PAGE))
        except OSError:
            pass
        file.truncate(max(0, file.tell() - pages * PAGE))


def main() -> None:
    parser = argparse.ArgumentParser(
        description="Commands ended, starved, run twice at once, in strange surroundings."
    )
    names = [*filter(available, WRITERS), GENERAL]
    parser.add_argument("--tries", type=int, default=100)
    parser.add_argument("--command", choices=names, action="append")
    parser.add_argument("--kills", action="store_true", help="Nothing but kill -9.")
    parser.add_argument("--json", action="store_true", help="One object per row.")
    options = parser.parse_args()
    if not options.json:
        print("| fault | command | tries | law held | seen |\n|---|---|---|---|---|")
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # a run in the background may have been told to ignore it
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        with suppress(OSError):  # a file system without permissions
            Path(folder).chmod(0o755)
        bench = Bench(Path(folder), options.tries, options.kills)
        for name in options.command or (names[:-1] if options.kills else names):
            for row in bench.general() if name == GENERAL else bench.command(name):
                cells = (row.fault, row.command, row.tries, row.held, row.seen)
                print(
                    json.dumps(asdict(row))
                    if options.json
                    else f"| {' | '.join(map(str, cells))} |",
                    flush=True,
                )
                for line in row.broken:
                    print(f"{row.fault}, {row.command}: {line}", file=sys.stderr, flush=True)
                wrong += len(row.broken)
    sys.exit(1 if wrong and not options.json else 0)


if __name__ == "__main__":
    main()
