"""What commands leave when they are ended, starved or run twice at once. Run: python benchmarks/faults.py [TRIES]

Prints the table of docs/reliability-faults.md. TRIES (100) moments of every writing command, drawn at random.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "faults"))

import ended
from ended import WRITERS, Writer, broken, everything, finished, parts, snapshot, start


class Table:
    """Rows of the table, one per fault: tries, how often the law held, and what was worst."""

    def __init__(self) -> None:
        self.wrong: list[str] = []
        print("| fault | command | tries | law held | worst case |\n|---|---|---|---|---|")

    def add(self, fault: str, command: str, outcomes: list[str], worst: str) -> None:
        bad = [outcome for outcome in outcomes if outcome]
        self.wrong += [f"{fault}, {command}: {outcome}" for outcome in bad]
        print(f"| {fault} | {command} | {len(outcomes)} | {len(outcomes) - len(bad)} | {worst} |", flush=True)


class Bench:
    """A working folder with the inputs, and what every command makes there."""

    def __init__(self, folder: Path, tries: int) -> None:
        self.folder, self.tries, self.random, self.table = folder, tries, random.Random(0), Table()
        ended.make_inputs(folder)
        self.others = everything(folder)

    def killed(self, name: str, writer: Writer) -> None:
        """SIGKILL at a random moment of the run, then at a random step of the writing."""
        began = time.perf_counter()
        assert finished(start(writer.words, self.folder)) == 0
        duration = time.perf_counter() - began
        new, steps = snapshot(self.folder, writer), ended.count_steps(writer.words, self.folder)
        for fault in ("SIGKILL at a random moment", "SIGKILL at a random step of the writing"):
            outcomes, seen = [], Counter[str]()
            for i in range(self.tries):
                old = self.prepare(writer, i % 2 == 1)
                if "moment" in fault:
                    process = start(writer.words, self.folder)
                    ended.signal_after(process, self.random.uniform(0, duration), signal.SIGKILL)
                else:
                    step = self.random.randint(1, steps)
                    finished(start(writer.words, self.folder, ended.signal_at_step(step, signal.SIGKILL)))
                outcomes.append(broken(self.folder, writer, old, new, self.others))
                seen.update(self.state(writer, old, new))
            left = len(parts(self.folder))
            finished(start(writer.words, self.folder))
            if snapshot(self.folder, writer) != new or parts(self.folder):
                outcomes.append("the next run did not put it in order")
            worst = ", ".join(f"{number} {state}" for state, number in sorted(seen.items()))
            self.table.add(fault, name, outcomes, f"{worst}; {left} temporary files, gone after the next run")
        self.asked_to_end(name, writer, new, steps)
        if name != "demo":
            self.full_disk(name, writer, new)
        ended.remove_outputs(self.folder, writer)

    def asked_to_end(self, name: str, writer: Writer, new: dict[str, bytes], steps: int) -> None:
        """SIGINT and SIGTERM at a random step: as above, nothing is left over, and the exit code says so."""
        for number, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
            outcomes, codes = [], Counter[int]()
            for i in range(max(self.tries // 4, 1)):
                old = self.prepare(writer, i % 2 == 1)
                step = self.random.randint(1, steps)
                found = finished(start(writer.words, self.folder, ended.signal_at_step(step, number)))
                codes[found] += 1
                problem = broken(self.folder, writer, old, new, self.others)
                mixed = len(set(self.state(writer, old, new))) > 1 and name != "demo"
                wrong = f"exit code {found}" if found not in (0, code) else "old and new mixed" if mixed else ""
                outcomes.append(problem or wrong or ", ".join(parts(self.folder)))
            worst = ", ".join(f"exit code {code}: {number}" for code, number in sorted(codes.items()))
            self.table.add(f"{signal.Signals(number).name} at a random step", name, outcomes, worst)

    def full_disk(self, name: str, writer: Writer, new: dict[str, bytes]) -> None:
        """Files cannot become larger than a part of the output."""
        outcomes = []
        for i in range(max(self.tries // 4, 1)):
            old = self.prepare(writer, i % 2 == 1)
            size = self.random.randrange(max(map(len, new.values())))
            code = finished(start(writer.words, self.folder, ended.limit_file_size(size)))
            problem = broken(self.folder, writer, old, new, self.others) or ", ".join(parts(self.folder))
            kept = "" if snapshot(self.folder, writer) == old else "not as before"
            outcomes.append(problem or kept or ("" if code == 2 else f"exit code {code}"))
        self.table.add("disk full", name, outcomes, "as before, exit code 2")

    def prepare(self, writer: Writer, existing: bool) -> dict[str, bytes]:
        """Old outputs, or none; returns them. Temporary files stay where they are."""
        for name in writer.outputs:
            (self.folder / name).unlink(missing_ok=True)
            if existing:
                (self.folder / name).write_bytes(b"old " * 20_000)
        return snapshot(self.folder, writer)

    def state(self, writer: Writer, old: dict[str, bytes], new: dict[str, bytes]) -> list[str]:
        """Of every output: absent, old or new."""
        now = snapshot(self.folder, writer)
        return [
            "absent" if name not in now else "new" if now[name] == new[name] else "old" if name in old else "HALF"
            for name in writer.outputs
        ]

    def two_at_once(self) -> None:
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
                outcomes.append("" if whole and codes in expected else f"whole {whole}, exit codes {codes}")
            how = "both write, the last one stays" if force else "one writes, the other: exit code 2"
            self.table.add("two processes, one output", "simulate " + " ".join(force), outcomes, how)
        (self.folder / "out.h5").unlink()

    def interrupted_at_the_start(self) -> None:
        """Ctrl-C while a real process starts. The first moments belong to the interpreter itself."""
        command = [sys.executable, "-m", "calibtool", "simulate", "planar-3r", "-n", "20", "-o", "out.h5", "--force"]
        for span in (0.1, 2.0):
            outcomes, codes = [], Counter[str]()
            for _ in range(self.tries):
                process = subprocess.Popen(command, cwd=self.folder, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
                time.sleep(self.random.uniform(0, span))
                process.send_signal(signal.SIGINT)
                said = process.communicate()[1].decode()
                own = "calibtool/" in said
                codes[f"{process.returncode}{' with a traceback of the interpreter' if said else ''}"] += 1
                outcomes.append(said.splitlines()[-1] if own else ", ".join(parts(self.folder)))
            worst = ", ".join(f"exit code {code}: {number}" for code, number in sorted(codes.items()))
            self.table.add(f"SIGINT in the first {span} s", "simulate, a new process", outcomes, worst)


def main() -> None:
    tries = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder), tries)
        for name, writer in WRITERS.items():
            bench.killed(name, writer)
        bench.two_at_once()
        bench.interrupted_at_the_start()
    print("\n".join(bench.table.wrong) or "\nThe law held everywhere.")


if __name__ == "__main__":
    main()
