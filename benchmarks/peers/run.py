"""Peers side by side in one run: writes the whole of docs/peers.md.

Run: python benchmarks/peers/run.py [--seeds N] [--output docs/peers.md] [--only
geometry|training|kinematics] [--python PACKAGE=PYTHON]. With --only, the other sections of the page
stay as they are.
"""

import argparse
import os
import platform
import sys
from pathlib import Path

from process import (
    REQUIREMENTS,
    WITH_NUMPY_1,
    Interpreters,
    PeerError,
    add_interpreters,
    interpreters,
    output,
)

HERE = Path(__file__).resolve().parent
DOCUMENT = HERE.parent.parent / "docs" / "peers.md"
COMPARISONS = {
    "geometry": "Geometric identification: figaroh, pybotics, robotkinecal",
    "training": "Training the network: scikit-learn, PyTorch",
    "kinematics": "Inverse kinematics: roboticstoolbox-python, Pinocchio",
}
PACKAGES = {  # by import, what is installed
    "geometry": {
        "calibtool": "calibtool",
        "pin": "pin",
        "figaroh": "figaroh",
        "pybotics": "pybotics",
        "robotkinecal": "robotkinecal",
    },
    "training": {"calibtool": "calibtool", "sklearn": "scikit-learn", "torch": "torch"},
    "kinematics": {
        "calibtool": "calibtool",
        "pin": "pin",
        "roboticstoolbox": "roboticstoolbox-python",
    },
}
_VERSIONS = """
import sys
from importlib.metadata import PackageNotFoundError, version
for package in sys.argv[1:]:
    try:
        print(package, version(package))
    except PackageNotFoundError:
        print(package, "not installed")
"""


def versions(name: str, pythons: Interpreters) -> str:
    """One line: packages of a comparison, and numpy beside those that have another interpreter.

    What is not installed is named as such.
    """
    found = []
    for module, package in {**PACKAGES[name], "numpy": "numpy", "scipy": "scipy"}.items():
        own = [package, "numpy"] if module in pythons else [package]
        try:
            told = output(["-c", _VERSIONS, *own], pythons[module]).splitlines()
        except (PeerError, OSError):
            told = [f"{package} not installed"]
        found.append(told[0] + (f" (with {told[1]})" if len(told) > 1 else ""))
    return f"Python {platform.python_version()}, " + ", ".join(found)


def introduction(name: str) -> str:
    """How a comparison is made: the text of its script after the first line, without the line that
    says how to run it.
    """
    text = (HERE / f"{name}.py").read_text(encoding="utf-8").split('"""')[1]
    return " ".join(text.split("].", 1)[1].split())


def section(name: str, seeds: int | None, pythons: Interpreters) -> str:
    """A comparison with its table, or with the reason why there is none. seeds: None for
    its own default.
    """
    given = [] if name == "kinematics" or seeds is None else ["--seeds", str(seeds)]
    own = [f"--python={package}={python}" for package, python in pythons.items()]
    try:
        table = output([str(HERE / f"{name}.py"), *given, *own]).strip()
    except PeerError as error:
        table = f"No table: {error}"
    return f"{COMPARISONS[name]}\n{introduction(name)}\n\n{versions(name, pythons)}.\n\n{table}\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--seeds", type=int, help="Actual robots of geometry (20) and data sets of training (5)."
    )
    parser.add_argument("--output", type=Path, default=DOCUMENT)
    parser.add_argument("--only", choices=COMPARISONS)
    add_interpreters(parser)
    arguments = parser.parse_args()
    pythons = interpreters(arguments)
    command = "python benchmarks/peers/run.py" + (
        f" --seeds {arguments.seeds}" if arguments.seeds else ""
    )
    sections = {}
    if arguments.only and arguments.output.exists():
        _, *earlier = arguments.output.read_text(encoding="utf-8").split("\n## ")
        sections = {text.partition(":")[0]: text for text in earlier}
    for name in [arguments.only] if arguments.only else COMPARISONS:
        print(f"{name} …", file=sys.stderr, flush=True)
        title = COMPARISONS[name].partition(":")[0]
        sections[title] = section(name, arguments.seeds, pythons)
    title = (
        f"# Peers, side by side\nMade by `{command}` (see benchmarks/peers/README.md) on "
        f"{platform.machine()}, {os.cpu_count()} CPUs, one thread each. Versions are pinned in "
        f"{REQUIREMENTS} and {WITH_NUMPY_1}.\n"
    )
    order = [words.partition(":")[0] for words in COMPARISONS.values()]
    parts = [sections[words].rstrip() + "\n" for words in order if words in sections]
    arguments.output.write_text("\n## ".join([title, *parts]), encoding="utf-8")


if __name__ == "__main__":
    main()
