"""Few rows of the public real sets: the default beside registration alone and local POE.

Run: python benchmarks/few_rows.py FOLDER [--sets ur5,ur10,ur10-cubes,wam] [--rows 8,12,16,20,30]
[--draws 10] [--first 0]. Random rows; UR5 and WAM are judged on the 20 random poses, the others on
300 other rows. Mean position error in mm, median of the draws; where a model cannot be fitted, -.
`worse` counts draws in which the default leaves over 2 % more than the better of the other two.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from real import FILES, ROOT, load

from calibtool.errors import NoSolutionError
from calibtool.identification.comparison import registered
from calibtool.identification.complete import identify_complete
from calibtool.identification.identification import Identification
from calibtool.identification.local_poe import identify_local_poe
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import residuals

MODELS: tuple[Callable[[Measurements], Identification], ...] = (
    registered,
    identify_local_poe,
    identify_complete,
)
JUDGED = 300


def position_error(fit: Callable[[Measurements], Identification], *rows: Measurements) -> float:
    """Mean distance (mm) of the points of the second rows from those of a fit to the first."""
    fitted, judged = rows
    try:
        state = fit(fitted).state
    except NoSolutionError:
        return np.inf
    tool = state.frames(judged.q, judged.conditions).tool
    lengths = judged.setup.kind.lengths(judged.setup)
    off = residuals(judged, state.setup, tool)[:, lengths].reshape(len(judged), -1, 3)
    return 1e3 * float(np.linalg.norm(off, axis=-1).mean())


def draw(tables: list[Measurements], count: int, seed: int) -> tuple[Measurements, Measurements]:
    """Rows to fit and rows to judge."""
    order = np.random.default_rng(seed).permutation(len(tables[0]))
    fitted = tables[0].rows(np.sort(order[:count]))
    if len(tables) > 1:
        return fitted, tables[1]
    return fitted, tables[0].rows(np.sort(order[count : count + JUDGED]))


def main() -> None:
    parser = argparse.ArgumentParser(description="Few rows of public sets")
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT.parent / "shared" / "real")
    parser.add_argument("--sets", default=",".join(FILES))
    parser.add_argument("--rows", default="8,12,16,20,30")
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    print("| set | rows | registration | local POE | default | worse | most |")
    print("|---|---|---|---|---|---|---|")
    for name in options.sets.split(","):
        tables = load(options.folder, name)
        for count in map(int, options.rows.split(",")):
            seeds = range(options.first, options.first + options.draws)
            drawn = [draw(tables, count, seed) for seed in seeds]
            errors = np.array([[position_error(fit, *rows) for fit in MODELS] for rows in drawn])
            ratio = errors[:, 2] / errors[:, :2].min(axis=1)
            cells = [f"{m:.3f}" if np.isfinite(m) else "-" for m in np.median(errors, axis=0)]
            worse = f"{int((ratio > 1.02).sum())} of {len(ratio)} | × {ratio.max():.2f}"
            print(f"| {name} | {count} | {' | '.join(cells)} | {worse} |", flush=True)


if __name__ == "__main__":
    main()
