"""Programs of 1,000 targets in every format: what an identity changes, what comes back, how long it takes.

Run: python benchmarks/programs.py [TARGETS]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
import time
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify
from calibtool.compensation.solve import compensate_joints
from calibtool.compensation.stream import compensate_text
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.programs.branches import Controller, solve_pose
from calibtool.programs.compensate import ProgramOptions, compensate_program
from calibtool.programs.configurations import posture
from calibtool.programs.formats import PROGRAM_FORMATS, coupling_of, reader
from calibtool.programs.frames import pose
from calibtool.programs.motions import Move
from calibtool.robot.catalogue import load_robot
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array

ROBOTS = {"fanuc-ls": "fanuc-m1000ia", "kuka-krl": "fanuc-m1000ia", "abb-rapid": "fanuc-m1000ia"}
OTHER_ROBOT = "ur5"


def configurations(robot: Robot, count: int) -> Array:
    """Joint positions of a program, rounded as a program writes them, away from singularities."""
    q = sample_configurations(robot, robot.workspace(None)[1], 2 * count, np.random.default_rng(1))
    return np.deg2rad(np.round(np.rad2deg(q[robot.singularity_distance(q) > 0.05][:count]), 3))


def fanuc_ls(robot: Robot, q: Array) -> str:
    """A FANUC program: joints and poses in turn, J3 against the horizontal."""
    T = robot.mechanism.forward(q)
    moves = "".join(f"{k + 1:4d}:{'JL'[k % 2]} P[{k + 1}] 100mm/sec CNT50    ;\r\n" for k in range(len(q)))
    positions = []
    for k, degrees in enumerate(np.rad2deg(q @ np.linalg.inv(coupling_of(robot, "fanuc-ls", "controller")).T)):
        if k % 2 == 0:
            parts = [f"J{j + 1}= {value:9.3f} deg" for j, value in enumerate(degrees)]
            body = f"\tUF : 0, UT : 0,\t\r\n\t{f',{chr(9)}'.join(parts[:3])},\r\n\t{f',{chr(9)}'.join(parts[3:])}\r\n"
        else:
            now = posture(robot, q[k], np.deg2rad(degrees))
            zero = posture(robot, np.zeros(6), np.zeros(6))
            letters = (
                f"{'F' if now.flexed else 'N'} {'U' if now.bent == zero.bent else 'D'} {'T' if now.front else 'B'}"
            )
            angles = Rotation.from_matrix(T[k, :3, :3]).as_euler("xyz", degrees=True)
            body = f"\tUF : 0, UT : 0,\t\tCONFIG : '{letters}, 0, 0, 0',\r\n"
            place = [f"{a} = {v * 1e3:9.3f}  mm" for a, v in zip("XYZ", T[k, :3, 3], strict=True)]
            turn = [f"{a} = {v:9.3f} deg" for a, v in zip("WPR", angles, strict=True)]
            body += f"\t{f',{chr(9)}'.join(place)},\r\n\t{f',{chr(9)}'.join(turn)}\r\n"
        positions.append(f"P[{k + 1}]{{\r\n   GP1:\r\n{body}}};\r\n")
    return f"/PROG  BENCH\r\n/ATTR\r\n/MN\r\n{moves}/POS\r\n{''.join(positions)}/END\r\n"


def kuka_krl(robot: Robot, q: Array) -> str:
    """A KRL program with inline axes and poses, tool and base zero."""
    T = robot.mechanism.forward(q)
    lines = ["DEF bench( )", "$TOOL = $NULLFRAME", "$BASE = $NULLFRAME"]
    for k, degrees in enumerate(np.rad2deg(q)):
        if k % 2 == 0:
            lines.append(f"PTP {{{', '.join(f'A{j + 1} {v:.3f}' for j, v in enumerate(degrees))}}} C_PTP ; point {k}")
            continue
        now = posture(robot, q[k], q[k])
        status = (not now.front) | now.bent << 1 | (not now.flexed) << 2
        turn = sum(1 << j for j, v in enumerate(degrees) if v < 0)
        angles = Rotation.from_matrix(T[k, :3, :3]).as_euler("ZYX", degrees=True)
        values = [*T[k, :3, 3] * 1e3, *angles]
        parts = ", ".join(f"{a} {v:.3f}" for a, v in zip("XYZABC", values, strict=True))
        lines.append(f"LIN {{E6POS: {parts}, S {status}, T {turn}}} C_DIS ; point {k}")
    return "\n".join([*lines, "END", ""])


def abb_rapid(robot: Robot, q: Array) -> str:
    """A RAPID module with inline targets, tool0 and wobj0."""
    T = robot.mechanism.forward(q)
    unused = "[9E9,9E9,9E9,9E9,9E9,9E9]"
    lines = ["MODULE Bench", "  PROC main()"]
    for k, degrees in enumerate(np.rad2deg(q)):
        if k % 2 == 0:
            joints = ",".join(f"{v:.3f}" for v in degrees)
            lines.append(f"    MoveAbsJ [[{joints}],{unused}],v100,z10,tool0; ! point {k}")
            continue
        place = ",".join(f"{v * 1e3:.3f}" for v in T[k, :3, 3])
        turn = ",".join(f"{v:.6f}" for v in Rotation.from_matrix(T[k, :3, :3]).as_quat(scalar_first=True))
        quadrants = ",".join(str(int(np.floor(degrees[j] / 90))) for j in (0, 3, 5))
        now, zero = posture(robot, q[k], q[k]), posture(robot, np.zeros(6), np.zeros(6))
        cfx = (not now.front) << 2 | (now.bent != zero.bent) << 1 | (not now.flexed)
        lines.append(f"    MoveL [[{place}],[{turn}],[{quadrants},{cfx}],{unused}],v100,z10,tool0; ! point {k}")
    return "\n".join([*lines, "  ENDPROC", "ENDMODULE", ""])


def ur_script(robot: Robot, q: Array) -> str:
    """A URScript program, poses beside their joints."""
    T = robot.mechanism.forward(q)
    lines = ["def bench():", "  set_tcp(p[0, 0, 0, 0, 0, 0])"]
    for k, joints in enumerate(q):
        values = ", ".join(f"{v:.6f}" for v in joints)
        if k % 2 == 0:
            lines.append(f"  movej([{values}], a=1.4, v=1.05)  # point {k}")
            continue
        parts = ", ".join(f"{v:.6f}" for v in [*T[k, :3, 3], *Rotation.from_matrix(T[k, :3, :3]).as_rotvec()])
        lines.append(f"  movej(get_inverse_kin(p[{parts}], qnear=[{values}]), a=1.2)  # point {k}")
    return "\n".join([*lines, "end", ""])


def ros2_trajectory(robot: Robot, q: Array) -> str:
    """A JointTrajectory as YAML, joints in alphabetical order."""
    names = [str(name) for name in robot.chain.model.names[1:]]
    order = sorted(range(robot.n), key=lambda j: names[j])
    points = "".join(
        f"- positions: [{', '.join(f'{joints[j]:.6f}' for j in order)}]  # {k}\n  time_from_start: {{sec: {k}}}\n"
        for k, joints in enumerate(q)
    )
    return f"joint_names: [{', '.join(names[j] for j in order)}]\npoints:\n{points}"


WRITERS: dict[str, Callable[[Robot, Array], str]] = {
    "fanuc-ls": fanuc_ls,
    "kuka-krl": kuka_krl,
    "abb-rapid": abb_rapid,
    "ur-script": ur_script,
    "ros2-trajectory": ros2_trajectory,
}


def read_joints(robot: Robot, text: str, program_format: str, near: Array) -> Array:
    """Nominal joint positions of a program's targets, poses solved on their branch from `near` (N, n)."""
    controller = Controller(robot, coupling_of(robot, program_format, None))
    rows = []
    program = reader(program_format)(text, robot)
    steps = [step for routine in program.routines for step in routine.body]
    aims = [aim.value for step in steps if isinstance(step, Move) for aim in step.aims]
    for number, start in zip([value for value in aims if isinstance(value, int)], near, strict=True):
        target = program.literals[number]
        if target.kind == "joint":
            rows.append(controller.to_serial(np.array(target.values)))
            continue
        solved = solve_pose(controller, pose(target.values, target.orientation), target.configuration, start)
        assert not isinstance(solved, str), solved
        rows.append(solved)
    return np.array(rows)


def calibrations(robot: Robot) -> tuple[Calibration, Calibration]:
    """The identity, and one of a robot with errors."""
    measurements = simulate(robot, Simulation(seed=1, workspace=robot.workspace(None)[1], configurations=40))
    return identify(measurements, "nominal"), identify(measurements, "local-poe")


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    made = {name: (load_robot(name), *calibrations(load_robot(name))) for name in {*ROBOTS.values(), OTHER_ROBOT}}
    print(
        "| format | targets | lines | bytes changed by the identity | changed | at most | comes back within | seconds |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for program_format in PROGRAM_FORMATS:
        robot, identity, calibration = made[ROBOTS.get(program_format, OTHER_ROBOT)]
        q = configurations(robot, count)
        text = WRITERS[program_format](robot, q)
        data = text.encode()
        options = ProgramOptions(controller_model=robot.mechanism)
        same = compensate_program(identity, data, "bench", program_format, options).data
        changed = abs(len(same) - len(data)) + sum(a != b for a, b in zip(same, data, strict=False))
        start = time.perf_counter()
        result = compensate_program(calibration, data, "bench", program_format, options)
        seconds = time.perf_counter() - start
        expected = compensate_joints(calibration, read_joints(robot, text, program_format, q)).q
        again = read_joints(robot, result.data.decode(), program_format, expected)
        back = np.rad2deg(np.abs(again - expected).max())
        print(
            f"| {program_format} | {result.targets} | {text.count(chr(10))} | {changed} | {result.changed} | "
            f"{result.largest_mm:.2f} mm, {result.largest_deg:.3f} deg | {back:.1e} deg | {seconds:.1f} |"
        )
    robot, identity, calibration = made[OTHER_ROBOT]
    q = configurations(robot, count)
    rows = [",".join(f"{v:.3f}" for v in row) for row in np.rad2deg(q)]
    table = "\n".join([",".join(robot.joint_columns), *rows, ""])
    numbers = np.array([row.split(",")[:6] for row in compensate_text(identity, table, "t")[0].split()[1:]], float)
    differ = int((np.abs(numbers - np.rad2deg(q)) > 1e-9).sum())
    start = time.perf_counter()
    compensate_text(calibration, table, "t")
    print(
        f"| csv (a table) | {count} | {count + 1} | {differ} numbers | - | - | - | {time.perf_counter() - start:.1f} |"
    )


if __name__ == "__main__":
    main()
