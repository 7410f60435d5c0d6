"""Inverse kinematics beside roboticstoolbox-python and Pinocchio: `benchmarks/inverse.py` on the same poses for all.

Run: python benchmarks/peers/kinematics.py [--poses 500]. The toolbox runs in a process of its own: its libraries and
Pinocchio's do not share one.
"""

import argparse
import sys
from pathlib import Path

from process import PeerError, output, require

INVERSE = Path(__file__).resolve().parent.parent / "inverse.py"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=500)
    arguments = [str(INVERSE), "--poses", str(parser.parse_args().poses)]
    note = ""
    try:
        require("roboticstoolbox")
        arguments += ["--peer", sys.executable]
    except PeerError as error:
        note = f"\nroboticstoolbox ik_LM: {error}"
    print(output(arguments).rstrip())
    print(note)


if __name__ == "__main__":
    main()
