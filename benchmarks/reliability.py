"""All attempts to break calibtool, and the pages about them: docs/reliability.md, docs/numerics.md.

Run: python benchmarks/reliability.py [--workers N] [--resume] [--peers PYTHON]
         takes hours of one CPU; goes on with --resume
     python benchmarks/reliability.py --inputs 5000 --tries 10
         less of everything; --resume makes it more
     python benchmarks/reliability.py --quick
         takes minutes; the pages go to stdout
     python benchmarks/reliability.py --page
         the pages again, nothing is run

Coverage-guided fuzzing needs atheris (pip install atheris) and is left as it was without it.
Every part (a reader, a writing command, the laws, the numerics) is a process of its own; its
figures are kept in benchmarks/pages/figures.json as soon as it ends. The side-by-side tables are
those of docs/peers.md, measured again with --peers PYTHON (see benchmarks/peers/README.md).
"""

import argparse
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import jinja2

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
FIGURES = HERE / "pages" / "figures.json"
PEERS = ROOT / "docs" / "peers.md"
PAGES = {
    ROOT / "docs" / f"{name}.md": HERE / "pages" / f"{name}.md.jinja"
    for name in ("reliability", "numerics")
}
PACKAGES = ("calibtool", "numpy", "scipy", "pin", "h5py", "hypothesis")

Figures = dict[
    str, Any
]  # by the name of a part: {"amount": how much was tried, "rows": what its program printed}


@dataclass(frozen=True)
class Part:
    """A process of its own: its command, and how much it tries, to know whether it
    was done already.
    """

    command: list[str]
    amount: int


def parts(inputs: int, tries: int, seconds: int, thorough: bool) -> dict[str, Part]:
    """Every part, the longest first."""
    sys.path[:0] = [str(ROOT / "tests" / "fuzz"), str(ROOT / "tests" / "faults")]
    from ended import WRITERS, available
    from guided import GUIDED
    from readers import READERS

    found = {"laws": Part(["laws.py"], 20) if thorough else Part(["laws.py", "--quick"], 1)}
    for name in reversed([*filter(available, WRITERS), "several processes"]):
        found[f"faults {name}"] = Part(
            ["faults.py", "--tries", str(tries), "--command", name], tries
        )
    for name in READERS:
        found[f"fuzz {name}"] = Part(["fuzz.py", "--inputs", str(inputs), "--reader", name], inputs)
    for name in GUIDED:
        found[f"guided {name}"] = Part(
            ["guided.py", "--seconds", str(seconds), "--reader", name], seconds
        )
    found["numerics"] = Part(["numerics.py"], 1)
    found["promise"] = Part(["promise.py"], 1)
    return found


def performed(part: Part) -> dict[str, Any]:
    """The figures of a part.

    CalledProcessError if it failed by itself, which findings do not make it do.
    """
    words = [sys.executable, str(HERE / part.command[0]), *part.command[1:], "--json"]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True, env=environment)
    return {"amount": part.amount, "rows": [json.loads(line) for line in done.stdout.splitlines()]}


def setting() -> list[str]:
    """What it was run with."""
    return [
        f"Python {platform.python_version()}",
        *(f"{name} {version(name)}" for name in PACKAGES),
        platform.machine(),
    ]


def kept(figures: Figures) -> None:
    """Write the figures, whole or not at all."""
    order = [
        "setting",
        "missing",
        "laws",
        "numerics",
        "promise",
        *sorted(name for name in figures if " " in name),
    ]
    figures = {name: figures[name] for name in order if name in figures}
    part = FIGURES.with_suffix(".part")
    part.write_text(json.dumps(figures, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    part.replace(FIGURES)


def table(header: Iterable[object], rows: Iterable[Iterable[object]]) -> str:
    """A Markdown table."""
    lines = [list(header), *map(list, rows)]
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join(f"| {' | '.join(str(cell) for cell in line)} |" for line in lines)


def fewer(figures: Figures) -> list[str]:
    """Parts of which less was tried than of others of their kind, with their amounts."""
    kinds = {name: name.split()[0] for name in figures if " " in name}
    most = {
        kind: max(figures[name]["amount"] for name in kinds if kinds[name] == kind)
        for kind in kinds.values()
    }
    few = sorted(name for name, kind in kinds.items() if figures[name]["amount"] < most[kind])
    return [
        f"{name} ({figures[name]['amount']:,} instead of {most[kinds[name]]:,})" for name in few
    ]


def by_fault(figures: Figures) -> list[dict[str, Any]]:
    """The faults of all commands together, in the order in which they were first met."""
    found: dict[str, dict[str, Any]] = {}
    for name in sorted(figures, key=lambda name: (name == "faults several processes", name)):
        for row in figures[name]["rows"] if name.startswith("faults ") else ():
            new = {"fault": row["fault"], "commands": set(), "tries": 0, "held": 0, "broken": []}
            total = found.setdefault(row["fault"], new)
            total["commands"].add(row["command"])
            total["tries"] += row["tries"]
            total["held"] += row["held"]
            total["broken"] += [f"{row['command']}: {text}" for text in row["broken"]]
    return list(found.values())


def by_base(rows: list[list[str]]) -> list[list[str]]:
    """The rows of every robot as one per base and method: arms, worse, leaves too much, share of
    `ok` and largest change, of which the lowest and the highest."""
    groups: dict[tuple[str, str], list[list[str]]] = {}
    for _, base, method, *figures in rows:
        groups.setdefault((base, method), []).append(figures)
    result = []
    for (base, method), found in groups.items():
        worse, much = (sum(int(row[k]) for row in found) for k in (0, 1))
        ok = sorted(float(row[2].removesuffix(" %")) for row in found)
        told = f"{ok[0]:.0f}…{ok[-1]:.0f} %, median {ok[len(ok) // 2]:.0f} %"
        result.append([base, method, str(len(found)), str(worse), str(much), told])
    return result


def pages(figures: Figures) -> dict[Path, str]:
    """The pages, from figures alone."""
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals["table"] = table
    peers = PEERS.read_text(encoding="utf-8").partition("\n")[2].strip()
    fuzz = [
        row for name in sorted(figures) if name.startswith("fuzz ") for row in figures[name]["rows"]
    ]
    guided = [
        row
        for name in sorted(figures)
        if name.startswith("guided ")
        for row in figures[name]["rows"]
    ]
    faults, laws = by_fault(figures), figures["laws"]["rows"][0]
    found = {
        "setting": figures["setting"],
        "numerics": figures["numerics"]["rows"][0],
        "promise": figures["promise"]["rows"][0],
        "promise_rows": by_base(figures["promise"]["rows"][0]["promise"][1:]),
        "laws": laws,
        "law_rows": [
            [subject, row["laws"], f"{row['cases']:,}", row["failures"]]
            for subject, row in laws.items()
        ],
        "missing": figures["missing"],
        "fuzz": fuzz,
        "fuzz_rows": [
            [
                *(row["reader"], f"{row['inputs']:,}", f"{row['valid']:,}"),
                *(f"{row['worst_ms']} ms", f"{row['memory_mib']} MiB", row["findings"]),
            ]
            for row in fuzz
        ],
        "guided_rows": [
            [
                row["reader"],
                f"{row['inputs']:,}",
                row["kept"],
                row["seeds_reach"],
                row["reached"],
                len(row["findings"]),
            ]
            for row in guided
        ],
        "guided": guided,
        "fewer": fewer(figures),
        "faults": faults,
        "fault_rows": [
            [row["fault"], len(row["commands"]), row["tries"], row["held"]] for row in faults
        ],
        "commands": [
            name.removeprefix("faults ") for name in sorted(figures) if name.startswith("faults ")
        ],
        "peers": peers.replace("\n## ", "\n### "),
    }
    return {
        page: environment.from_string(template.read_text(encoding="utf-8")).render(found).rstrip()
        + "\n"
        for page, template in PAGES.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Everything that is tried to break calibtool.")
    parser.add_argument(
        "--quick", action="store_true", help="Few inputs and tries; the pages go to stdout."
    )
    parser.add_argument("--inputs", type=int, default=100_000, help="Mutated files per reader.")
    parser.add_argument("--tries", type=int, default=100, help="Kills per writing command.")
    parser.add_argument(
        "--seconds", type=int, default=60, help="Of coverage-guided fuzzing per reader."
    )
    parser.add_argument(
        "--resume", action="store_true", help="Only the parts of which less was tried before."
    )
    parser.add_argument("--page", action="store_true", help="Only write the pages.")
    parser.add_argument("--workers", type=int, default=1, help="Parts at a time.")
    parser.add_argument(
        "--peers", metavar="PYTHON", help="Measure the peers again, with this interpreter."
    )
    options = parser.parse_args()
    amounts = (1000, 4, 5) if options.quick else (options.inputs, options.tries, options.seconds)
    wanted = parts(*amounts, thorough=options.inputs >= 100_000 and not options.quick)
    old = (
        json.loads(FIGURES.read_text(encoding="utf-8")) if (options.resume or options.page) else {}
    )
    figures: Figures = {
        "setting": old.get("setting") or setting(),
        **{name: old[name] for name in wanted if name in old},
    }

    def missing(name: str) -> bool:
        if name.startswith("guided ") and find_spec("atheris") is None:
            return False
        return name not in figures or figures[name]["amount"] < wanted[name].amount

    if not options.page:
        with ThreadPoolExecutor(options.workers) as pool:
            waiting = {
                pool.submit(performed, wanted[name]): name for name in wanted if missing(name)
            }
            for future in as_completed(waiting):
                figures[waiting[future]] = future.result()
                print(f"{waiting[future]}: done", file=sys.stderr, flush=True)
                if not options.quick:
                    kept(figures)
    if options.peers:
        subprocess.run(
            [options.peers, str(HERE / "peers" / "run.py")], check=True
        )  # writes docs/peers.md
    figures["missing"] = [name for name in wanted if name not in figures]
    if not options.quick:
        kept(figures)
    for page, text in pages(figures).items():
        if options.quick:
            print(text)
        else:
            page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
