"""Small programs with right answers that were computed apart from calibtool's solver and
readers, see `RIGHT`.
"""

import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calibtool.calibration import Calibration, identify
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.programs.compensate import compensate_program
from calibtool.programs.formats import detected
from calibtool.programs.program_summary import CompensatedProgram
from calibtool.robot.catalogue import load_robot

FOLDER = Path(__file__).parent / "programs" / "cases"
NUMBER = re.compile(r"-?\d+\.\d+")

JOINTS = (12.007, 14.056, -5.875, 7.961, -66.182, 14.965)
HOME = (0.086828, -1.400321, 1.751188, -1.921143, -1.573112, 0.179126)
# File → line → numbers after correction, or why the line is left. Computed with Pinocchio from the
# nominal URDF and the one of `export --format urdf`: each literal solved on its branch in its
# frame and tool, the calibrated arm brought to the same pose, and the nominal pose there stated:
# x, y, z or the joints.
RIGHT: dict[str, dict[int, Sequence[float] | str]] = {
    "plain.mod": {3: (2301.123, 439.518, 608.298)},
    "arc_end.mod": {
        3: (2301.123, 439.518, 608.298),
        5: (2300.400, 707.454, 458.716),
        6: (2047.065, 891.278, 480.529),
    },
    "sync_tool.mod": {4: (1715.462, 323.137, 659.887)},
    "do_tool.mod": {4: (1715.462, 323.137, 659.887)},
    "comma_wobj.mod": {4: (1715.462, 323.137, 659.887)},
    "unknown_move.mod": {
        3: (2301.123, 439.518, 608.298),
        4: (2300.400, 707.454, 458.716),
        5: (2047.065, 891.278, 480.529),
    },
    "search_stop.mod": {4: (2301.123, 439.518, 608.298)},
    "reassign.mod": {2: (2301.123, 439.518, 608.298), 5: (2300.400, 707.454, 458.716)},
    "component.mod": {2: r"a component of it is assigned \(line 4\)"},
    "wobj_changed.mod": {4: r"several frames \(lines 6, 8; set in line 7\)"},
    "wobj_component.mod": {4: (1715.106, 323.061, 659.799)},
    "track_only.mod": {
        2: "external axes alone",
        5: (10.008, 20.072, -9.863, 4.959, -60.179, 19.978),
    },
    "untaught_element.mod": {3: (2301.123, 439.518, 608.298), 4: "not taught"},
    "part_variable.mod": {4: r"expression \(corner\)", 5: (2300.400, 707.454, 458.716)},
    "held_workpiece.mod": {4: "the robot holds the work piece"},
    "declared_order.mod": {
        2: (2301.487, 704.841, 458.732),
        3: (11.946, 13.985, -5.962, 188.064, 65.897, -165.191),
    },
    "plain.ls": {10: (2301.123, 439.518, 608.298), 11: ()},
    "cr_only.ls": {10: (2301.123, 439.518, 608.298), 11: ()},
    "shift_jis_name.ls": {
        11: (2301.123, 439.518, 608.298),
        12: (),
        17: (2300.400, 707.454, 458.716),
        18: (),
    },
    "inc_in_names.ls": {
        11: (2301.123, 439.518, 608.298),
        12: (),
        17: (2300.400, 707.454, 458.716),
        18: (),
    },
    "inc_index.ls": {
        6: r"relative motion .*register tells \(P\[R\[1\]\]\)",
        12: (2301.123, 439.518, 608.298),
        13: (),
        18: "may be used by a relative motion .* in line 6",
    },
    "konfig.ls": {10: (2301.123, 439.518, 608.298), 11: ()},
    "werkzeug_offset.ls": {10: (2301.123, 439.518, 608.298), 11: ()},
    "remote_tcp.ls": {10: "the robot holds the work piece"},
    "plain.script": {3: HOME, 4: (-0.523596, -0.154949, 0.290828)},
    "polyscope.script": {3: (-0.523596, -0.154949, 0.290828)},
    "named_arguments.script": {3: HOME, 4: (-0.480681, -0.220857, 0.361791)},
    "other_moves.script": {
        3: HOME,
        4: (-0.523596, -0.154949, 0.290828),
        5: (-0.480681, -0.220857, 0.361791),
        6: (-0.523596, -0.154949, 0.290828),
    },
    "ik_tcp.script": {3: (-0.523558, -0.154667, 0.170828)},
    "ik_qnear_variable.script": {3: HOME, 5: (-0.527946, -0.155022, 0.289387)},
    "declared_order.script": {3: (-0.527946, -0.155022, 0.289387), 4: ()},
    "block_comment.yaml": dict(enumerate(((value,) for value in HOME), start=4)),
    "plain.src": {5: JOINTS, 6: (2301.123, 439.518, 608.298)},
    "array_points.src": {
        7: (2301.123, 439.518, 608.298),
        8: (2300.400, 707.454, 458.716),
        9: JOINTS,
    },
    "array_axes.dat": {4: JOINTS},
    "circle_named.src": {
        7: (2300.400, 707.454, 458.716),
        8: (2047.065, 891.278, 480.529),
        9: JOINTS,
    },
    "component.src": {6: r"a component of it is assigned \(line 7\)", 8: JOINTS},
    "base_twice.src": {
        7: JOINTS,
        8: (1701.123, 339.518, 808.298),
        11: (2300.400, 857.454, 758.716),
    },
    "base_component.src": {6: JOINTS, 7: (1701.123, 439.518, 908.298)},
    "base_product.src": {6: JOINTS, 7: (1734.236, -11.037, 688.298)},
    "base_null_product.src": {6: JOINTS, 7: (1734.236, 38.963, 808.298)},
    "base_switch.src": {6: JOINTS, 13: "several frames"},
    "offset_point.src": {
        6: (2301.123, 439.518, 608.298),
        7: JOINTS,
        9: "relative to XP1",
    },
    "lin_status.src": {5: JOINTS, 6: (2300.400, 707.454, 458.716)},
    "untaught.dat": {3: "not taught", 5: (2301.123, 439.518, 608.298)},
    "declared_order.src": {6: (2301.487, 704.841, 458.732), 7: ()},
    "fixed_tool.src": {
        6: JOINTS,
        7: r"the robot holds the work piece.*\(\$IPO_MODE=#TCP, line 5\)",
    },
}


@cache
def calibration(name: str) -> Calibration:
    """As `simulate NAME -n 60 --seed 7` and `identify --model local-poe` make it."""
    robot = load_robot(name)
    simulation = Simulation(seed=7, configurations=60)
    return identify(simulate(robot, simulation), "local-poe")


def corrected(name: str) -> tuple[list[str], list[str], CompensatedProgram]:
    data = (FOLDER / name).read_bytes()
    robot = "ur5" if Path(name).suffix in (".script", ".yaml") else "fanuc-m1000ia"
    program_format = detected(data.decode("latin-1"), name)
    assert program_format is not None
    result = compensate_program(calibration(robot), data, name, program_format)
    before, after = (text.decode("latin-1").splitlines() for text in (data, result.data))
    return before, after, result


@pytest.mark.parametrize("name", RIGHT)
def test_right(name: str) -> None:
    before, after, result = corrected(name)
    assert len(before) == len(after)
    left = {remark.line: remark.why for remark in result.left_alone}
    for line, right in RIGHT[name].items():
        if isinstance(right, str):
            assert after[line - 1] == before[line - 1]
            assert re.search(right, left[line])
        else:
            old, new = (NUMBER.findall(text[line - 1]) for text in (before, after))
            assert old != new
            tolerance = 0.03 if max(map(abs, right), default=0) > 5 else 3e-5
            np.testing.assert_allclose([float(x) for x in new[: len(right)]], right, atol=tolerance)
            assert line not in left
    changed = {k for k, (a, b) in enumerate(zip(before, after, strict=True), start=1) if a != b}
    assert changed <= set(RIGHT[name])
    assert not result.inconsistent
