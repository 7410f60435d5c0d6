"""--frame: the sample's targets move as little as its arm is off; elsewhere a line says why not."""

import io
import re
from pathlib import Path

import numpy as np
from commandline import Files, answer, refused, rows_of, run

from calibtool.evaluation.view.scene import scene_of
from calibtool.storage import read_any


def largest_mm(stderr: str) -> float:
    """The largest change of a target that `compensate` reports of a program."""
    return float(re.findall(r"targets changed, at most ([0-9.]+) mm", stderr)[0])


def test_taught_programs_move_as_little_as_the_arm_is_off(here: Path) -> None:
    """Evaluation, view, corrections and ± of the sample say the same: about a millimetre."""
    run("demo", "--sample", "-o", "s")
    run(
        "import",
        "s/tracker.csv",
        "--robot",
        "fanuc-m1000ia",
        "--joint-values",
        "controller",
        "-o",
        "m.h5",
    )
    said = run("identify", "m.h5", "-o", "c.h5").stderr
    assert re.search(
        r"^frame taught: .*common part of all errors: base 7\.\d+ mm, 0\.2\d* deg; tool 0\.\d+ mm",
        said,
        re.MULTILINE,
    )
    assert re.search(r"^apart from it the robot is 1\.\d+ mm", said, re.MULTILINE)
    assert largest_mm(run("compensate", "c.h5", "s/seam.ls", "-o", "taught.ls").stderr) <= 1.2
    other = run("compensate", "c.h5", "s/seam.ls", "--frame", "fitted", "-o", "fitted.ls").stderr
    assert largest_mm(other) > 5
    assert re.search(
        r"^frame fitted: every target moves by the common part, too: base 7", other, re.MULTILINE
    )
    rows = rows_of(
        run(
            "compensate", "c.h5", "s/targets.csv", "--joint-values", "serial", "--uncertainty"
        ).stdout
    )
    sd = [float(row["sd_mm"]) for row in rows]
    assert max(sd[1:]) < 0.05
    assert 0.1 < sd[0] < 0.5  # nothing says on which side of its backlash the arm begins
    for file in ("m.h5", "c.h5"):
        sizes = scene_of(read_any(io.BytesIO(Path(file).read_bytes()), file)).error_rms
        assert 1.0 < 1e3 * np.sqrt((sizes**2).mean()) < 1.6, file


def test_the_frame_is_chosen_where_it_is_free_and_nowhere_else(here: Path, files: Files) -> None:
    known = "--frame has nothing to choose: instrument frame and targets are known"
    assert known in run("identify", files.measurements, "--frame", "fitted", "-o", "a.h5").stderr
    assert (
        known in run("evaluate", files.local_poe, "--on", files.fresh, "--frame", "taught").stderr
    )
    assert known not in run("evaluate", files.local_poe, "--on", files.fresh).stderr
    for command, *options in (["compensate"], ["export", "--format", "json"], ["view"]):
        line = refused(2, command, files.local_poe, *options, "--frame", "tought")
        assert "unknown 'tought'; did you mean taught" in line
    assert "unknown 'base'" in refused(2, "identify", files.measurements, "--frame", "base")
    assert "holds measurements" in refused(
        2, "view", files.fresh, "--frame", "taught", "--html", "v.html"
    )
    assert answer("info", files.local_poe)["frame"] is None
