"""The public real sets of data/README.md: errors on rows that no fit has seen, and what ± says.

Run: python benchmarks/real.py FOLDER [--sets ur5,ur10,ur10-cubes,wam] [--draws 10] [--first 0]
[--methods local-poe,complete,train,network]. Draws are seeds from `--first` on. UR5: random grid
rows, judged on the 20 random poses. UR10: 1,000 random rows, judged on the other 495, and three
quarters of the different configurations, judged on the others. UR10 cubes: 80 % of the rows,
judged on the others. WAM: all 216 grid rows, judged on the 20 random poses (one draw).

Coverage: part of the held-out coordinates whose error lies within 1.96 predicted deviations.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage

from calibtool.calibration import Calibration, identify, train
from calibtool.equivalent.training import TrainingOptions
from calibtool.evaluation.compare import evaluate
from calibtool.identification.equations import linearised_rows
from calibtool.measurement.importing import import_table, parse_column_map
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import weights
from calibtool.robot.catalogue import load_robot

ROOT = Path(__file__).resolve().parent.parent
FILES = {
    "ur5": ("grid.csv", "random.csv"),
    "ur10": ("joint_configurations.csv",),
    "ur10-cubes": ("iso_cubes.csv",),
    "wam": ("grid.csv", "random.csv"),
}
METHODS: dict[str, Callable[[Measurements, int], Calibration]] = {
    "local-poe": lambda rows, seed: identify(rows, "local-poe"),
    "complete": lambda rows, seed: identify(rows, "complete"),
    "train": lambda rows, seed: train(rows, "complete", TrainingOptions(seed=seed)),
    "network": lambda rows, seed: train(rows, "nominal", TrainingOptions(seed=seed)),
}
Case = tuple[str, Measurements, Measurements]  # title, rows to fit, rows to judge


def load(folder: Path, name: str) -> list[Measurements]:
    """The tables of a set; its robot and map from the catalogue, or beside its tables."""
    own = folder / name / "columns.toml"
    path = own if own.exists() else ROOT / "data" / name.split("-")[0] / "columns.toml"
    columns = parse_column_map(path.read_text(encoding="utf-8"), path.name)
    description = folder / name / "robot.urdf"
    robot = load_robot(str(description) if description.exists() else name.split("-")[0])
    return [
        import_table((folder / name / table).read_text(encoding="utf-8"), table, robot, columns)[0]
        for table in FILES[name]
    ]


def cases(name: str, tables: list[Measurements], seed: int) -> Iterator[Case]:
    """What one draw of a set is fitted to and judged on."""
    rows, rng = tables[0], np.random.default_rng(seed)
    order = rng.permutation(len(rows))
    if name == "ur5":
        for count in (20, 100, 300):
            chosen = rows.rows(np.sort(order[:count]))
            yield f"ur5, {count} grid rows, judged on the 20 random poses", chosen, tables[1]
    elif name == "wam":
        yield "wam, 216 grid rows, judged on the 20 random poses", rows, tables[1]
    elif name == "ur10-cubes":
        cut = round(0.8 * len(rows))
        yield f"ur10-cubes, {cut} rows, judged on the others", *split(rows, order[cut:])
    else:
        yield "ur10, 1,000 rows, judged on the other 495", *split(rows, order[1000:])
        # Repeated configurations lie within 0.1 mrad.
        label = fcluster(linkage(rows.q, "single"), 0.02, "distance")
        held = np.random.default_rng(seed).permutation(label.max()) + 1
        held = np.flatnonzero(np.isin(label, held[: len(held) // 4]))
        yield "ur10, three quarters of the configurations, judged on the others", *split(rows, held)


def split(rows: Measurements, held: np.ndarray) -> tuple[Measurements, Measurements]:
    """The other rows, and those held out."""
    rest = np.setdiff1d(np.arange(len(rows)), held)
    return rows.rows(rest), rows.rows(np.sort(held))


def judged(fitted: list[tuple[str, Calibration]], rows: Measurements) -> dict[str, list[float]]:
    """Mean, rms and maximum of the position error in mm per method, nominal first."""
    entries = evaluate(fitted, rows).as_json()["methods"]
    assert isinstance(entries, list)
    return {e["name"]: [e["position_mm"][s] for s in ("mean", "rms", "max")] for e in entries}


def coverage(calibration: Calibration, rows: Measurements) -> float:
    """Percent of the held-out coordinates within 1.96 predicted deviations."""
    base = calibration.base
    if base.posterior is None or calibration.networks:
        return np.nan
    columns, off = linearised_rows(rows, base.posterior.parameters, base.state)
    variance = ((columns @ base.posterior.covariance) * columns).sum(axis=-1)
    lengths = rows.setup.kind.lengths(rows.setup)
    variance += np.where(lengths, *base.posterior.residual_factors**2)
    seen = weights(rows) > 0
    return 100.0 * float((np.abs(off) < 1.96 * np.sqrt(variance))[seen].mean())


def report(title: str, rows: dict[str, list[list[float]]]) -> None:
    print(f"\n{title}\n\n| method | mean mm | rms mm | max mm | s | held % |")
    print("|---|---|---|---|---|---|")
    for name, values in rows.items():
        median, worst = np.median(values, axis=0), np.max(values, axis=0)
        cells = [f"{m:.3f} ({w:.3f})" for m, w in zip(median, worst, strict=True)]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Errors on held-out rows of public sets")
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT.parent / "shared" / "real")
    parser.add_argument("--sets", default=",".join(FILES))
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    if not options.folder.is_dir():
        parser.error(f"{options.folder}: no such folder; data/README.md says where the sets are")
    print("Median over draws (worst draw in brackets)")
    for name in options.sets.split(","):
        tables, found = load(options.folder, name), dict[str, dict[str, list[list[float]]]]()
        for seed in range(options.first, options.first + (1 if name == "wam" else options.draws)):
            for title, fit_on, judge_on in cases(name, tables, seed):
                fitted, seconds, held = [], {"nominal": 0.0}, {"nominal": np.nan}
                for method in options.methods.split(","):
                    start = perf_counter()
                    fitted.append((method, METHODS[method](fit_on, seed)))
                    seconds[method] = perf_counter() - start
                    held[method] = coverage(fitted[-1][1], judge_on)
                for method, errors in judged(fitted, judge_on).items():
                    rows = found.setdefault(title, {}).setdefault(method, [])
                    rows.append([*errors, seconds[method], held[method]])
        for title, methods in found.items():
            report(title, methods)


if __name__ == "__main__":
    main()
