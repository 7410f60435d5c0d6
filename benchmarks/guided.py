"""Coverage-guided fuzzing of the readers with atheris: inputs that reach new code are kept and
mutated further.

Run: python benchmarks/guided.py --seconds 60 [--reader csv] [--findings DIR] [--json]

Needs atheris (pip install atheris) and Linux. Inputs are mutated by libFuzzer and, every second
one, by tests/fuzz/mutations.py. An answer or one line of a calibtool error is right; another
exception, 5 s of the processor or 1 GiB more than at the start is a finding, and ends the reader's
run: its input is kept in DIR. Two of the parsers below calibtool, tomllib and csv's Python part,
are guided as well; those in C are not, so that HDF5 files and workbooks are left to
benchmarks/fuzz.py. A Markdown row per reader goes to stdout.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import contextlib
import json
import random
import re
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tests" / "fuzz"))

SECONDS, MIB = 5, 1024
LONGEST = 20_000  # bytes of an input
GUIDED = (
    *(
        "csv",
        "ndjson",
        "import",
        "spatial-analyzer",
        "column-map",
        "study-definition",
        "study-csv",
        "study-journal",
    ),
    *("ur-yaml", "ur-conf", "dh-table"),
    *(
        "robot-toml",
        "urdf",
        "frames-toml",
        "fanuc-ls",
        "kuka-krl",
        "abb-rapid",
        "ur-script",
        "ros2-trajectory",
    ),
)
_STATUS = re.compile(r"^#(\d+)\s+(\w+)\s+cov: (\d+) ft: (\d+)", re.MULTILINE)
_FINAL = re.compile(r"^stat::(\w+):\s+(\d+)", re.MULTILINE)


def explore(name: str, seeds: Path, folder: Path, seconds: int, seed: int) -> None:
    """The process that is ended by libFuzzer: `seconds` of inputs for one
    reader, or one finding.
    """
    import atheris

    with atheris.instrument_imports(include=["calibtool", "tomllib", "csv"]):
        from mutations import TEXT, mutated
        from readers import READERS

        from calibtool.errors import CalibtoolError

    reader, originals = READERS[name], READERS[name].seeds()
    for data in originals:  # caches are filled before the clock starts
        with contextlib.suppress(CalibtoolError):
            reader.read(data)
    warnings.simplefilter("ignore")
    warnings.simplefilter("error", RuntimeWarning)
    for number, data in enumerate(originals):
        (seeds / f"seed-{number}").write_bytes(data)

    def one(data: bytes) -> None:
        started, told = time.process_time(), "an answer"
        try:
            reader.read(data)
        except CalibtoolError as error:
            told = str(error)
        assert told.isprintable(), "a message is one line of printable characters"
        assert time.process_time() - started < SECONDS, "too long"

    def mutate(data: bytes, longest: int, seed: int) -> bytes:
        if seed % 2:
            return bytes(atheris.Mutate(data, longest))
        return mutated(random.Random(seed), [data, *originals], TEXT)[:longest]

    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // MIB + MIB
    limits = [
        f"-max_total_time={seconds}",
        f"-rss_limit_mb={memory}",
        f"-max_len={LONGEST}",
        "-timeout=300",
    ]
    words = [
        *limits,
        f"-seed={seed}",
        "-print_final_stats=1",
        f"-artifact_prefix={folder}/{name}-",
        str(seeds),
    ]
    atheris.Setup([sys.argv[0], *words], one, custom_mutator=mutate)
    atheris.Fuzz()


def guided(name: str, seconds: int, seed: int, folder: Path) -> dict[str, Any]:
    """One reader: inputs, branches of code that the seeds reach and that were reached at
    last, what was found.
    """
    folder.mkdir(parents=True, exist_ok=True)
    before = set(folder.iterdir())
    with tempfile.TemporaryDirectory() as seeds:
        words = [
            sys.executable,
            __file__,
            "--explore",
            name,
            seeds,
            "--seconds",
            str(seconds),
            "--seed",
            str(seed),
        ]
        done = subprocess.run(
            [*words, "--findings", str(folder)], capture_output=True, text=True, errors="replace"
        )
        kept = len(list(Path(seeds).iterdir()))
    states = {state: int(reached) for _, state, reached, _ in _STATUS.findall(done.stderr)}
    final = {key: int(value) for key, value in _FINAL.findall(done.stderr)}
    found = sorted(path.name for path in set(folder.iterdir()) - before)
    if "INITED" not in states or (done.returncode and not found):
        sys.exit(f"{name}: the fuzzer itself failed\n{done.stderr[-3000:]}")
    if found:
        print(done.stderr[-3000:], file=sys.stderr)
    return {
        "reader": name,
        "inputs": final.get("number_of_executed_units", 0),
        "kept": kept,
        "seeds_reach": states["INITED"],
        "reached": max(states.values()),
        "peak_mib": final.get("peak_rss_mb", 0),
        "findings": found,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Coverage-guided fuzzing of the readers.")
    parser.add_argument("--reader", choices=GUIDED, action="append")
    parser.add_argument("--seconds", type=int, default=60, help="Per reader.")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--findings", type=Path, default=Path("findings"))
    parser.add_argument("--json", action="store_true", help="One object per reader.")
    parser.add_argument("--explore", nargs=2, metavar=("READER", "SEEDS"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.explore:
        name, seeds = options.explore
        explore(name, Path(seeds), options.findings, options.seconds, options.seed)
        return
    if not options.json:
        print(
            "| reader | inputs | kept | seeds reach | reached | findings |\n"
            "|---|---|---|---|---|---|"
        )
    for name in options.reader or GUIDED:
        row = guided(name, options.seconds, options.seed, options.findings.resolve())
        cells = [
            name,
            f"{row['inputs']:,}",
            row["kept"],
            row["seeds_reach"],
            row["reached"],
            len(row["findings"]),
        ]
        print(json.dumps(row) if options.json else f"| {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    main()
