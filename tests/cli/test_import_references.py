"""calibtool import --use-references and --references: said, stored, refused."""

import numpy as np
import pytest
from commandline import Files, answer, measured_table, refused, remarks, rows_of, run, stored

from calibtool.robot.se3 import Array

POINTS = "measurements/points"
NAMES = [f"ref{k}_{axis}_mm" for k in (1, 2, 3) for axis in "xyz"]


def drifting(files: Files, path: str, drift_mm: float) -> tuple[list[dict[str, str]], Array]:
    """A table of planar-3r whose instrument sinks by `drift_mm` from the first to the last row,
    with three reference points; its rows, and the references in mm (N, 9).
    """
    measured_table(files.measurements, path)
    with open(path, encoding="utf-8") as file:
        rows = rows_of(file.read())
    rng = np.random.default_rng(4)
    fixed = np.array([[400.0, 0, 0], [0, 400.0, 0], [-300.0, -300.0, 100.0]])
    sunk = np.linspace(0, drift_mm, len(rows))[:, None, None] * [0.0, 0.0, 1.0]
    references = (fixed + sunk + rng.normal(size=(len(rows), 3, 3)) * 0.03).reshape(-1, 9)
    for e, row in enumerate(rows):
        for column in row:
            if column.endswith("_z_mm"):
                row[column] = f"{float(row[column]) + sunk[e, 0, 2]:.9f}"
        row |= {name: f"{v:.6f}" for name, v in zip(NAMES, references[e], strict=True)}
    written(path, rows)
    return rows, references


def written(path: str, rows: list[dict[str, str]]) -> None:
    lines = [",".join(rows[0]), *(",".join(row.values()) for row in rows)]
    with open(path, "w", encoding="utf-8") as file:
        file.write("\n".join(lines) + "\n")


def test_a_drift_is_taken_back_said_and_stored(files: Files) -> None:
    drifting(files, "t.csv", 0.8)
    result = run("import", "t.csv", "--robot", "planar-3r", "-o", "plain.h5")
    assert "--use-references brings the rows back" in remarks(result)
    result = run("import", "t.csv", "--robot", "planar-3r", "--use-references", "-o", "back.h5")
    assert "note: the reference points move by up to 0.7" in remarks(result)
    assert "brought back into the frame of the first reading" in remarks(result)
    truth = stored(files.measurements, POINTS)
    before, after = (np.abs(stored(path, POINTS) - truth).max() for path in ("plain.h5", "back.h5"))
    assert before == pytest.approx(0.8e-3, abs=1e-6)
    assert after < 0.1e-3
    (line,) = (
        text for text in answer("info", "back.h5")["found_on_import"] if "brought back" in text
    )
    assert "mm ±" in line
    assert "found_on_import" not in answer("info", files.measurements)


def test_without_a_drift_nothing_changes(files: Files) -> None:
    drifting(files, "t.csv", 0.0)
    result = run("import", "t.csv", "--robot", "planar-3r", "--use-references", "-o", "m.h5")
    assert "do not say more than their noise" in remarks(result)
    np.testing.assert_allclose(
        stored("m.h5", POINTS), stored(files.measurements, POINTS), atol=1e-12
    )
    assert "found_on_import" not in answer("info", "m.h5")


def test_readings_in_a_file_of_their_own(files: Files) -> None:
    rows, references = drifting(files, "t.csv", 0.8)
    written("alone.csv", [{k: v for k, v in row.items() if k not in NAMES} for row in rows])
    read = [0, len(rows) // 3, 2 * len(rows) // 3, len(rows) - 1]
    written(
        "refs.csv",
        [
            {
                "row": str(e),
                **{name: f"{v:.6f}" for name, v in zip(NAMES, references[e], strict=True)},
            }
            for e in read
        ],
    )
    run("import", "alone.csv", "--robot", "planar-3r", "--references", "refs.csv", "-o", "m.h5")
    apart = np.abs(stored("m.h5", POINTS) - stored(files.measurements, POINTS))
    assert apart.max() < 0.15e-3
    command = ["import", "alone.csv", "--robot", "planar-3r", "-o", "x.h5"]
    line = refused(2, *command, "--use-references")
    assert "has no reference points" in line
    line = refused(3, *command, "--references", "t.csv")
    assert "neither a time" in line


def test_readings_that_are_mixed_up_or_in_another_unit_are_refused(files: Files) -> None:
    """Two reference points in exchanged columns from the middle on; mm that are m."""
    rows, _ = drifting(files, "t.csv", 0.0)
    exchanged = [dict(row) for row in rows]
    for row in exchanged[len(rows) // 2 :]:
        for a, b in zip(NAMES[:3], NAMES[3:6], strict=True):
            row[a], row[b] = row[b], row[a]
    written("exchanged.csv", exchanged)
    small = [
        {k: f"{float(v) / 1e3:.9f}" if k in NAMES else v for k, v in row.items()} for row in rows
    ]
    written("small.csv", small)
    how = ("--robot", "planar-3r", "--use-references", "-o", "m.h5")
    assert "check that every point keeps its columns" in refused(3, "import", "exchanged.csv", *how)
    assert "check their unit" in refused(3, "import", "small.csv", *how)


def test_references_that_were_looked_at_are_not_advised_again(files: Files) -> None:
    drifting(files, "t.csv", 0.0)
    result = run("import", "t.csv", "--robot", "planar-3r", "--use-references", "-o", "m.h5")
    assert remarks(result).count("the reference points") == 1
