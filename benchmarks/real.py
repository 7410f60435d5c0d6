"""The public real sets in ../shared/real (see data/README.md): errors on rows that no fit has seen.

Run: python benchmarks/real.py [FOLDER]. UR5: trained on random grid rows, judged on the 20 random
poses, 10 draws. UR10: trained on 1,000 random rows, judged on the other 495, 5 draws; and with
repeated configurations on one side of it.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage

from calibtool.calibration import identify, train
from calibtool.equivalent.training import TrainingOptions
from calibtool.evaluation.compare import evaluate
from calibtool.measurement.importing import import_table, parse_column_map
from calibtool.measurement.measurements import Measurements
from calibtool.robot.catalogue import load_robot

ROOT = Path(__file__).resolve().parent.parent


def load(folder: Path, robot: str, table: str) -> Measurements:
    columns = parse_column_map(
        (ROOT / "data" / robot / "columns.toml").read_text(encoding="utf-8"), "columns.toml"
    )
    text = (folder / robot / table).read_text(encoding="utf-8")
    return import_table(text, table, load_robot(robot), columns)[0]


def report(title: str, rows: dict[str, list[list[float]]]) -> None:
    print(f"\n{title}\n\n| method | mean mm | rms mm | max mm |\n|---|---|---|---|")
    for name, values in rows.items():
        median, worst = np.median(values, axis=0), np.max(values, axis=0)
        cells = " | ".join(f"{m:.3f} ({w:.3f})" for m, w in zip(median, worst, strict=True))
        print(f"| {name} | {cells} |")


def judge(
    train_on: Measurements, judge_on: Measurements, seed: int, rows: dict[str, list[list[float]]]
) -> None:
    calibrations = [
        ("local POE", identify(train_on, "local-poe")),
        ("complete", identify(train_on, "complete")),
        (
            "train (default)",
            train(train_on, "complete", TrainingOptions(regularisation="bayes", seed=seed)),
        ),
        ("network on nominal", train(train_on, "nominal", TrainingOptions(seed=seed))),
    ]
    entries = evaluate(calibrations, judge_on).as_json()["methods"]
    assert isinstance(entries, list)
    for entry in entries:
        rows.setdefault(entry["name"], []).append(
            [entry["position_mm"][s] for s in ("mean", "rms", "max")]
        )


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT.parent / "shared" / "real"
    if not folder.is_dir():
        sys.exit(f"{folder}: no such folder; data/README.md says where the sets come from")
    print("Median over draws (worst draw in brackets)")
    grid, random_poses = load(folder, "ur5", "grid.csv"), load(folder, "ur5", "random.csv")
    for count in (20, 100, 300):
        rows: dict[str, list[list[float]]] = {}
        for seed in range(10):
            chosen = np.sort(np.random.default_rng(seed).permutation(len(grid))[:count])
            judge(grid.rows(chosen), random_poses, seed, rows)
        report(f"ur5, {count} grid rows, judged on the 20 random poses", rows)
    ur10 = load(folder, "ur10", "joint_configurations.csv")
    rows = {}
    for seed in range(5):
        order = np.random.default_rng(seed).permutation(len(ur10))
        judge(ur10.rows(np.sort(order[:1000])), ur10.rows(np.sort(order[1000:])), seed, rows)
    report("ur10, 1,000 rows, judged on the other 495", rows)
    configuration = fcluster(
        linkage(ur10.q, "single"), 0.02, "distance"
    )  # repeated ones lie within 0.1 mrad
    rows = {}
    for seed in range(5):
        order = np.random.default_rng(seed).permutation(configuration.max()) + 1
        held = np.isin(configuration, order[: len(order) // 4])
        judge(ur10.rows(np.flatnonzero(~held)), ur10.rows(np.flatnonzero(held)), seed, rows)
    report("ur10, three quarters of the different configurations, judged on the others", rows)


if __name__ == "__main__":
    main()
