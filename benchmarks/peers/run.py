"""Peers side by side in one run: writes the whole of docs/peers.md.

Run: python benchmarks/peers/run.py [--seeds N] [--output docs/peers.md] [--only
geometry|training|kinematics].
"""

import argparse
import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from process import REQUIREMENTS, PeerError, output

HERE = Path(__file__).resolve().parent
DOCUMENT = HERE.parent.parent / "docs" / "peers.md"
PACKAGES = (
    "calibtool",
    "pin",
    "figaroh",
    "pybotics",
    "scikit-learn",
    "torch",
    "roboticstoolbox-python",
    "numpy",
    "scipy",
)
COMPARISONS = {
    "geometry": "Geometric identification: figaroh, pybotics",
    "training": "Training the network: scikit-learn, PyTorch",
    "kinematics": "Inverse kinematics: roboticstoolbox-python, Pinocchio",
}


def versions() -> str:
    """One line; what is not installed is named as such."""
    found = []
    for package in PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            found.append(f"{package} not installed")
    return f"Python {platform.python_version()}, " + ", ".join(found)


def introduction(name: str) -> str:
    """How a comparison is made: the text of its script after the first line, without the line that
    says how to run it.
    """
    text = (HERE / f"{name}.py").read_text(encoding="utf-8").split('"""')[1]
    return " ".join(text.split("].", 1)[1].split())


def section(name: str, seeds: int | None) -> str:
    """A comparison with its table, or with the reason why there is none. seeds: None for
    its own default.
    """
    given = [] if name == "kinematics" or seeds is None else ["--seeds", str(seeds)]
    arguments = [str(HERE / f"{name}.py"), *given]
    try:
        table = output(arguments).strip()
    except PeerError as error:
        table = f"No table: {error}"
    return f"## {COMPARISONS[name]}\n{introduction(name)}\n\n{table}\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--seeds", type=int, help="Actual robots of geometry (20) and data sets of training (5)."
    )
    parser.add_argument("--output", type=Path, default=DOCUMENT)
    parser.add_argument("--only", choices=COMPARISONS)
    arguments = parser.parse_args()
    command = "python benchmarks/peers/run.py" + (
        f" --seeds {arguments.seeds}" if arguments.seeds else ""
    )
    parts = [
        f"# Peers, side by side\nMade by `{command}` (see benchmarks/peers/README.md) with\n"
        f"{versions()};\n"
        f"{platform.machine()}, {os.cpu_count()} CPUs, one thread each. Versions are pinned in "
        f"{REQUIREMENTS}.\n"
    ]
    for name in [arguments.only] if arguments.only else COMPARISONS:
        print(f"{name} …", file=sys.stderr, flush=True)
        parts.append(section(name, arguments.seeds))
    arguments.output.write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
