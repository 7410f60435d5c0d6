"""Inverse kinematics beside roboticstoolbox-python and Pinocchio: `benchmarks/inverse.py` on the
same poses for all.

Run: python benchmarks/peers/kinematics.py [--poses 10000] [--python PACKAGE=PYTHON]. Poses of
uniform joint positions over the whole range, singular ones included. "no seed": any branch (CLIK:
from the robot's home); "near seed": from 0.05 rad beside the answer. calibtool gets the poses in
one call, or 500 in each; the others get them one by one. "solved" is inside the joint limits. The
toolbox stops at its default tolerance, about 1 mm or 1 mrad, and is judged at 1e-2; the others
converge to 1e-6 or better. Time is that of one CPU, a first call included. The toolbox runs in a
process of its own: its libraries and Pinocchio's do not share one.
"""

import argparse
from pathlib import Path

from process import PeerError, add_interpreters, interpreters, output, require

INVERSE = Path(__file__).resolve().parent.parent / "inverse.py"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=10_000)
    add_interpreters(parser)
    options = parser.parse_args()
    arguments, python = [str(INVERSE), "--poses", str(options.poses)], interpreters(options)
    note = ""
    try:
        require("roboticstoolbox", python["roboticstoolbox"])
        arguments += ["--peer", python["roboticstoolbox"]]
    except PeerError as error:
        note = f"\nroboticstoolbox ik_LM: {error}"
    print(output(arguments).rstrip())
    print(note)


if __name__ == "__main__":
    main()
