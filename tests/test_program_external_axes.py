"""External axes that are joints of the chain: an arm on a track, whose programs write the track as
an external axis.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from program_reading import reader
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify
from calibtool.errors import InputError, NoSolutionError
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.programs.compensate import compensate_program
from calibtool.programs.configurations import posture
from calibtool.programs.correction import ProgramOptions
from calibtool.programs.frames import poses
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, inverse, log3
from calibtool.robot.source import parse_source, source_from_urdf

JOINTS = [
    ("0 1 0", "0 0 0", "prismatic", 1.0),  # the track, along y
    ("0 0 1", "0 0 0.675", "revolute", 2.9),
    ("0 1 0", "0.26 0 0", "revolute", 1.5),
    ("0 1 0", "0 0 0.68", "revolute", 2.5),
    ("1 0 0", "0.4 0 -0.035", "revolute", 3.1),
    ("0 1 0", "0.27 0 0", "revolute", 2.0),
    ("1 0 0", "0.158 0 0", "revolute", 6.0),
]
TRACK = '[external]\ne1 = "j1"\n'


@cache
def robot(external: str = TRACK) -> Robot:
    """Six joints as an ABB's on a track."""
    parts = ['<robot name="t"><link name="l0"/>']
    for k, (axis, origin, kind, limit) in enumerate(JOINTS):
        parts.append(
            f'<link name="l{k + 1}"/><joint name="a{k + 1}" type="{kind}"><parent link="l{k}"/>'
            f'<child link="l{k + 1}"/><origin xyz="{origin}"/><axis xyz="{axis}"/>'
            f'<limit lower="{-limit}" upper="{limit}" effort="0" velocity="0"/></joint>'
        )
    source = source_from_urdf("".join([*parts, "</robot>"]), "track")
    return Robot.from_source(parse_source(source.toml_text + external, source.urdf_text, "track"))


@cache
def calibration() -> Calibration:
    return identify(
        simulate(robot(), Simulation(seed=1, configurations=40, workspace="full")), "local-poe"
    )


def configurations(count: int) -> Array:
    rng = np.random.default_rng(2)
    q = rng.uniform(0.6 * robot().lower, 0.6 * robot().upper, (200, 7))
    q = q[robot().singularity_distance(q) > 0.06][:count]
    return np.hstack([np.round(q[:, :1], 4), np.deg2rad(np.round(np.rad2deg(q[:, 1:]), 3))])


def rapid(q: Array) -> str:
    """A jointtarget and a robtarget of each row, on the branch of its quadrants and cfx."""
    lines = ["MODULE A", "PROC main()"]
    for row, T in zip(q, robot().mechanism.forward(q), strict=True):
        beside = f"[{row[0] * 1e3:.1f},9E9,9E9,9E9,9E9,9E9]"
        degrees = np.rad2deg(row[1:])
        lines.append(
            f"MoveAbsJ [[{','.join(f'{v:.3f}' for v in degrees)}],{beside}],v1,fine,tool0;"
        )
        here, zero = (posture(robot(), x, x) for x in (row, np.zeros(7)))
        cfx = (not here.front) << 2 | (here.bent != zero.bent) << 1 | (not here.flexed)
        quadrants = ",".join(str(int(np.floor(degrees[j] / 90))) for j in (0, 3, 5))
        turn = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)
        place = ",".join(f"{v * 1e3:.6f}" for v in T[:3, 3])
        numbers = ",".join(f"{v:.9f}" for v in turn)
        lines.append(f"MoveL [[{place}],[{numbers}],[{quadrants},{cfx}],{beside}],v1,fine,tool0;")
    return "\n".join([*lines, "ENDPROC", "ENDMODULE", ""])


def krl(q: Array) -> str:
    lines = ["DEF a()", "$TOOL=$NULLFRAME", "$BASE=$NULLFRAME"]
    for row, T in zip(q, robot().mechanism.forward(q), strict=True):
        axes = ", ".join(f"A{k + 1} {v:.3f}" for k, v in enumerate(np.rad2deg(row[1:])))
        lines.append(f"PTP {{{axes}, E1 {row[0] * 1e3:.1f}}}")
        turn = Rotation.from_matrix(T[:3, :3]).as_euler("ZYX", degrees=True)
        numbers = [*T[:3, 3] * 1e3, *turn]
        pose = ", ".join(f"{a} {v:.6f}" for a, v in zip("XYZABC", numbers, strict=True))
        lines.append(f"LIN {{{pose}, E1 {row[0] * 1e3:.1f}}}")
    return "\n".join([*lines, "END", ""])


def fanuc(q: Array) -> str:
    moves, positions = [], []
    for k, (row, T) in enumerate(zip(q, robot().mechanism.forward(q), strict=True)):
        joints = row[1:].copy()
        moves += [
            f"   {2 * k + 1}:J P[{2 * k + 1}] 100% FINE ;",
            f"   {2 * k + 2}:L P[{2 * k + 2}] 9mm/sec FINE ;",
        ]
        axes = ", ".join(f"J{j + 1}= {v:.3f} deg" for j, v in enumerate(np.rad2deg(joints)))
        beside = f"E1= {row[0] * 1e3:.1f} mm"
        head = f"P[{2 * k + 1}]{{\n GP1:\n UF : 0, UT : 0,\n"
        positions.append(f"{head} {axes},\n {beside}\n}};")
        here, zero = (posture(robot(), x, x) for x in (row, np.zeros(7)))
        letters = (
            f"{'F' if here.flexed else 'N'} {'U' if here.bent == zero.bent else 'D'} "
            f"{'T' if here.front else 'B'}"
        )
        turns = [int(np.round(v / (2 * np.pi))) for v in joints[[0, 3, 5]]]
        turn = Rotation.from_matrix(T[:3, :3]).as_euler("xyz", degrees=True)
        place = ", ".join(f"{a}= {v * 1e3:.6f} mm" for a, v in zip("XYZ", T[:3, 3], strict=True))
        angles = ", ".join(f"{a}= {v:.6f} deg" for a, v in zip("WPR", turn, strict=True))
        head = (
            f"P[{2 * k + 2}]{{\n GP1:\n UF : 0, UT : 0, CONFIG : '{letters}, {turns[0]}, "
            f"{turns[1]}, {turns[2]}',\n"
        )
        positions.append(f"{head} {place},\n {angles},\n {beside}\n}};")
    return "\n".join(["/PROG A", "/MN", *moves, "/POS", *positions, "/END", ""])


def joints_of_pose(T: Array, q: Array) -> Array:
    """Joints of the nominal arm at a pose, the track where it is: Newton with differences."""
    for _ in range(20):
        here = robot().mechanism.forward(np.vstack([q, q + 1e-7 * np.eye(7)]))
        error = np.concatenate([T[:3, 3] - here[0, :3, 3], log3((T @ inverse(here[0]))[:3, :3])])
        turned = log3(here[1:, :3, :3] @ here[0, :3, :3].T)
        columns = np.hstack([here[1:, :3, 3] - here[0, :3, 3], turned]).T / 1e-7
        q = q + np.concatenate([[0.0], np.linalg.solve(columns[:, 1:], error)])
    return q


WRITERS = {"abb-rapid": rapid, "kuka-krl": krl, "fanuc-ls": fanuc}


@pytest.mark.parametrize("program_format", WRITERS)
def test_the_tool_comes_to_where_it_was_to_be(program_format: str) -> None:
    """With the track where the corrected program says, joints and poses bring the calibrated arm to
    the commanded pose.
    """
    q = configurations(6)
    text = WRITERS[program_format](q)
    options = ProgramOptions(joint_values="serial")
    result = compensate_program(calibration(), text.encode(), "a", program_format, options)
    assert (result.targets, result.changed, result.left_alone) == (12, 12, ())
    literals = reader(program_format)(result.data.decode(), robot()).literals
    before = reader(program_format)(text, robot()).literals
    for k, row in enumerate(q):
        joints, pose = literals[2 * k], literals[2 * k + 1]
        commanded = robot().mechanism.forward(row[None])[0]
        (axis,) = pose.external
        assert axis[0] == 0
        start = row.copy()
        start[0] = axis[1].value
        turned = poses(np.array([pose.values]), pose.orientation)[0]
        for driven in (np.array(joints.values), joints_of_pose(turned, start)):
            reached = calibration().forward(driven[None])[0]
            np.testing.assert_allclose(reached[:3, 3], commanded[:3, 3], atol=3e-7)
            np.testing.assert_allclose(
                log3(reached[:3, :3] @ commanded[:3, :3].T), np.zeros(3), atol=3e-7
            )
        assert before[2 * k].values[0] == pytest.approx(row[0])


def test_an_external_axis_without_a_value_or_beyond_its_limits() -> None:
    text = rapid(configurations(1))
    beside = text.split("],[")[1].split("]]")[0]
    nothing = text.replace(beside, beside.replace(beside.split(",")[0], "9E9"))
    result = compensate_program(calibration(), nothing.encode(), "a", "abb-rapid")
    assert {remark.why for remark in result.left_alone} == {"the external axis e1 has no value"}
    pose = "\n".join(line for line in text.split("\n") if "AbsJ" not in line)
    far = pose.replace(beside, beside.replace(beside.split(",")[0], "5000"))
    with pytest.raises(
        NoSolutionError, match=r"external axis at joint 1 is outside its limits|unreachable"
    ):
        compensate_program(calibration(), far.encode(), "a", "abb-rapid")


def test_the_description_is_checked() -> None:
    assert robot().external == {0: 0}
    assert robot().arm == [1, 2, 3, 4, 5, 6]
    for bad in (
        '[external]\ne1 = "j8"\n',
        '[external]\ne1 = "j1"\ne2 = "j1"\n',
        '[external]\nx = "j1"\n',
    ):
        with pytest.raises(InputError, match="external"):
            robot(bad)


def test_without_that_section_all_joints_are_the_arms() -> None:
    other = robot("")
    assert (other.external, other.arm) == ({}, list(range(7)))
    data = rapid(configurations(1)).encode()
    seven = replace(calibration(), robot=other)
    with pytest.raises(InputError, match="holds 6 joints, but track has 7"):
        compensate_program(seven, data, "a", "abb-rapid")
