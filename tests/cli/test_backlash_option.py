"""Backlash at the command line: identified where rows tell directions, taken up along rows,
refused otherwise.
"""

from pathlib import Path

import h5py
import numpy as np
from commandline import answer, refused, rows_of, run, write_table

JOINTS = ["j1_deg", "j2_deg", "j3_deg"]


def test_half_widths_are_shown_and_taken_up_along_the_rows() -> None:
    run(
        "simulate",
        "planar-3r",
        "-n",
        40,
        "--errors",
        "geometric,backlash",
        "--backlash-mrad",
        0.3,
        "-o",
        "m.h5",
    )
    assert "mrad half width" in run("identify", "m.h5", "-o", "c.h5").stderr
    assert answer("identify", "m.h5")["base"]["families"]["backlash"] == 1
    assert "backlash" not in answer("identify", "m.h5", "--no-backlash")["base"]["families"]
    write_table("t.csv", JOINTS, [[10, 20, 30], [15, 20, 10], [-5, 10, 10]])
    path, plain = (
        run("compensate", "c.h5", "t.csv"),
        run("compensate", "c.h5", "t.csv", "--no-backlash"),
    )
    assert "in their order" in path.stderr
    assert "in their order" not in plain.stderr
    joints = [
        np.array([[float(row[name]) for name in JOINTS] for row in rows_of(r.stdout)])
        for r in (path, plain)
    ]
    moved, sides = np.deg2rad(joints[0] - joints[1]) * 1e3, np.sign(np.diff(joints[1], axis=0))
    np.testing.assert_array_equal(sides[[0, 0, 1], [0, 2, 0]], [1, -1, -1])
    assert sides.all()  # corrections move the joints that stand, too
    np.testing.assert_allclose(moved, 0.3 * np.vstack([np.zeros(3), sides]), atol=0.05)


def test_backlash_is_refused_where_the_directions_are_unknown() -> None:
    run("simulate", "planar-3r", "-n", 20, "-o", "m.h5")
    assert answer("info", "m.h5")["directions"] == "known"
    with h5py.File("m.h5", "r+") as file:
        del file["measurements/direction"]
    assert answer("info", "m.h5")["directions"] == "unknown"
    assert "from which side the joints came" in refused(
        3, "identify", "m.h5", "--backlash", "-o", "c.h5"
    )
    assert "backlash" in refused(
        2, "identify", "m.h5", "--model", "local-poe", "--backlash", "-o", "c.h5"
    )
    assert not Path("c.h5").exists()
