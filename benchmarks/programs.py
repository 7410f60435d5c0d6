"""Programs of 50,000 targets in every language: time, memory, and what is left of the
error, computed apart.

Run: python benchmarks/programs.py [TARGETS]

The command line corrects each program in a process of its own. What it wrote is read back with a
regular expression, and Pinocchio drives the calibrated arm there, a URDF from `export`: to the
joints of joint targets, and for poses to those that its own Newton iterations with the nominal URDF
find. The rows that are looked at are drawn with a seed.
"""

import contextlib
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify
from calibtool.export.as_urdf import calibration_as_urdf
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.programs.branches import Controller, solve
from calibtool.programs.configurations import posture
from calibtool.programs.formats import PROGRAM_FORMATS, coupling_of, read_program
from calibtool.programs.frames import pose
from calibtool.programs.motions import Move, ProgramText
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.storage import to_bytes

ROBOTS = {"fanuc-ls": "fanuc-m1000ia", "kuka-krl": "fanuc-m1000ia", "abb-rapid": "fanuc-m1000ia"}
OTHER_ROBOT = "ur5"


def configurations(robot: Robot, count: int) -> Array:
    """Joint positions of a program, rounded as a program writes them, away from singularities."""
    q = sample_configurations(robot, robot.workspace(), 2 * count, np.random.default_rng(1))
    return np.deg2rad(np.round(np.rad2deg(q[robot.singularity_distance(q) > 0.05][:count]), 3))


def fanuc_ls(robot: Robot, q: Array) -> str:
    """A FANUC program: joints and poses in turn, J3 against the horizontal."""
    T = robot.mechanism.forward(q)
    moves = "".join(
        f"{k + 1:4d}:{'JL'[k % 2]} P[{k + 1}] 100mm/sec CNT50    ;\r\n" for k in range(len(q))
    )
    positions = []
    for k, degrees in enumerate(
        np.rad2deg(q @ np.linalg.inv(coupling_of(robot, "fanuc-ls", "controller")).T)
    ):
        if k % 2 == 0:
            parts = [f"J{j + 1}= {value:9.3f} deg" for j, value in enumerate(degrees)]
            body = (
                f"\tUF : 0, UT : 0,\t\r\n\t{f',{chr(9)}'.join(parts[:3])},\r\n"
                f"\t{f',{chr(9)}'.join(parts[3:])}\r\n"
            )
        else:
            now = posture(robot, q[k], np.deg2rad(degrees))
            zero = posture(robot, np.zeros(6), np.zeros(6))
            letters = (
                f"{'F' if now.flexed else 'N'} {'U' if now.bent == zero.bent else 'D'} "
                f"{'T' if now.front else 'B'}"
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
            lines.append(
                f"PTP {{{', '.join(f'A{j + 1} {v:.3f}' for j, v in enumerate(degrees))}}} "
                f"C_PTP ; point {k}"
            )
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
        turn = ",".join(
            f"{v:.6f}" for v in Rotation.from_matrix(T[k, :3, :3]).as_quat(scalar_first=True)
        )
        quadrants = ",".join(str(int(np.floor(degrees[j] / 90))) for j in (0, 3, 5))
        now, zero = posture(robot, q[k], q[k]), posture(robot, np.zeros(6), np.zeros(6))
        cfx = (not now.front) << 2 | (now.bent != zero.bent) << 1 | (not now.flexed)
        lines.append(
            "    MoveL "
            f"[[{place}],[{turn}],[{quadrants},{cfx}],{unused}],v100,z10,tool0; ! point {k}"
        )
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
        parts = ", ".join(
            f"{v:.6f}" for v in [*T[k, :3, 3], *Rotation.from_matrix(T[k, :3, :3]).as_rotvec()]
        )
        lines.append(f"  movej(get_inverse_kin(p[{parts}], qnear=[{values}]), a=1.2)  # point {k}")
    return "\n".join([*lines, "end", ""])


def ros2_trajectory(robot: Robot, q: Array) -> str:
    """A JointTrajectory as YAML, joints in alphabetical order."""
    names = [str(name) for name in robot.chain.model.names[1:]]
    order = sorted(range(robot.n), key=lambda j: names[j])
    points = "".join(
        f"- positions: [{', '.join(f'{joints[j]:.6f}' for j in order)}]  # {k}\n"
        f"  time_from_start: {{sec: {k}}}\n"
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
    """Nominal joint positions of a program's targets, poses solved on their branch
    from `near` (N, n).
    """
    controller = Controller(robot, coupling_of(robot, program_format, None))
    rows = []
    program = read_program(program_format, [ProgramText("program", text)], robot)
    steps = [step for routine in program.routines for step in routine.body]
    aims = [aim.value for step in steps if isinstance(step, Move) for aim in step.aims]
    for number, start in zip(
        [value for value in aims if isinstance(value, int)], near, strict=True
    ):
        target = program.literals[number]
        if target.kind == "joint":
            rows.append(controller.to_serial(np.array(target.values)))
            continue
        T = pose(target.values, target.orientation)[None]
        near = controller.home if start is None else start
        solved = solve(controller, T, near[None], [target.configuration], np.ones(1, dtype=bool))
        assert not solved.why[0], solved.why
        rows.append(solved.q[0])
    return np.array(rows)


def calibrations(robot: Robot) -> tuple[Calibration, Calibration]:
    """The identity, and one of a robot with errors."""
    measurements = simulate(robot, Simulation(seed=1, configurations=40))
    return identify(measurements, "nominal"), identify(measurements, "local-poe")


# --- an independent look at the result ------------------------------------------------------------


def _line(*parts: str) -> str:
    return "|".join(part.replace("#", r"\s*(-?\d+\.\d+)") for part in parts)


# The numbers of a target in the programs above; joints in the first six groups, a pose behind.
WRITTEN = {
    "fanuc-ls": re.compile(
        _line(
            *(
                r"[^}]*?".join(f"{name} ?=#" for name in names.split())
                for names in ("J1 J2 J3 J4 J5 J6", "X Y Z W P R")
            )
        )
    ),
    "kuka-krl": re.compile(_line("A1#, A2#, A3#, A4#, A5#, A6#", "X#, Y#, Z#, A#, B#, C#")),
    "abb-rapid": re.compile(_line(r"AbsJ \[\[#,#,#,#,#,#", r"MoveL \[\[#,#,#\],\[#,#,#,#\]")),
    "ur-script": re.compile(_line(r"movej\(\[#,#,#,#,#,#", r"p\[#,#,#,#,#,#\]")),
    "ros2-trajectory": re.compile(_line(r"positions: \[#,#,#,#,#,#")),
}
TURNS: dict[str, Callable[[Array], Rotation]] = {
    "fanuc-ls": lambda turn: Rotation.from_euler("xyz", turn, degrees=True),
    "kuka-krl": lambda turn: Rotation.from_euler("ZYX", turn, degrees=True),
    "abb-rapid": lambda turn: Rotation.from_quat(turn, scalar_first=True),
    "ur-script": Rotation.from_rotvec,
}
LOOKED_AT = 500


def written(text: str, program_format: str, robot: Robot) -> list[Array]:
    """Joints of the chain (n,) in rad, or T_base_tool (4, 4), of every
    target; `set_tcp` is none.
    """
    names = [str(name) for name in robot.chain.model.names[1:]]
    place = np.argsort(np.argsort(names))  # ROS 2 programs list the joints in alphabetical order
    found: list[Array] = []
    for match in WRITTEN[program_format].finditer(text):
        numbers = np.array([float(number) for number in match.groups() if number is not None])
        if match[1] is None:
            T = np.eye(4)
            T[:3, 3] = numbers[:3] * (1.0 if program_format == "ur-script" else 1e-3)
            T[:3, :3] = TURNS[program_format](numbers[3:]).as_matrix()
            found.append(T)
        elif program_format == "ros2-trajectory":
            found.append(numbers[place])
        elif program_format == "ur-script":
            found.append(numbers)
        else:
            found.append(coupling_of(robot, program_format, None) @ np.deg2rad(numbers))
    return found


class Arm:
    """A URDF by Pinocchio alone, between the base and tool frames of a robot's description."""

    def __init__(self, urdf: str, robot: Robot, tool: str | None = None) -> None:
        kinematics = robot.source.description.kinematics
        self.model = pin.buildModelFromXML(urdf)
        self.data = self.model.createData()
        base = kinematics.base_frame or self.model.frames[1].name
        self.frames = [
            self.model.getFrameId(name) for name in (base, tool or kinematics.tool_frame)
        ]
        self.places = [
            self.model.joints[self.model.getJointId(str(name))].idx_q
            for name in robot.chain.model.names[1:]
        ]

    def pose(self, q: Array) -> pin.SE3:
        """T_base_tool at joint positions (n,)."""
        whole = pin.neutral(self.model)
        whole[self.places] = q
        pin.forwardKinematics(self.model, self.data, whole)
        pin.updateFramePlacements(self.model, self.data)
        base, tool = (self.data.oMf[frame] for frame in self.frames)
        return base.actInv(tool)

    def joints(self, T: Array, q: Array) -> Array:
        """Joint positions (n,) of a pose near q: Newton with differences for derivatives."""
        goal = pin.SE3(T)
        for _ in range(20):
            here = self.pose(q)
            error = pin.log6(here.actInv(goal)).vector
            columns = [
                pin.log6(here.actInv(self.pose(q + 1e-6 * unit))).vector / 1e-6
                for unit in np.eye(len(q))
            ]
            step = np.linalg.solve(np.array(columns).T, error)
            q = q + step
            if np.abs(step).max() < 1e-11:
                break
        return q


def largest_error(
    robot: Robot, calibration: Calibration, before: str, after: str, program_format: str
) -> float:
    """Of some changed targets the largest distance in m between where the calibrated arm is and
    where it was to be.
    """
    urdf = calibration_as_urdf(calibration)[0]
    tool = f"{robot.source.description.kinematics.tool_frame}_calibrated"
    nominal = Arm(robot.source.urdf_text, robot)
    calibrated = Arm(urdf, robot, tool if f'name="{tool}"' in urdf else None)
    pairs = list(
        zip(*(written(text, program_format, robot) for text in (before, after)), strict=True)
    )
    q = configurations(robot, len(pairs))  # those that the program was made of
    rows = [(k, *pair) for k, pair in enumerate(pairs) if not np.array_equal(*pair)]
    largest = 0.0
    for row in np.random.default_rng(2).permutation(len(rows))[:LOOKED_AT]:
        k, old, new = rows[row]
        commanded = pin.SE3(old) if old.ndim == 2 else nominal.pose(old)
        joints = nominal.joints(new, q[k]) if new.ndim == 2 else new
        left = calibrated.pose(joints).translation - commanded.translation
        largest = max(largest, float(np.linalg.norm(left)))
    return largest


def corrected(calibration: Path, program: Path, output: Path) -> tuple[float, float, float]:
    """Wall and processor seconds, and MiB, of the command."""
    command = [sys.executable, "-m", "calibtool", "compensate", str(calibration), str(program)]
    start = time.perf_counter()
    process = subprocess.Popen(
        [*command, "--on-error", "skip", "-o", str(output)], stderr=subprocess.DEVNULL
    )
    memory, done = 0.0, 0
    while not done:  # ru_maxrss would be that of this process, from which the command was started
        with contextlib.suppress(OSError, StopIteration):
            lines = Path(f"/proc/{process.pid}/status").read_text(encoding="ascii").splitlines()
            peak = next(line for line in lines if line.startswith("VmHWM"))
            memory = max(memory, int(peak.split()[1]) / 1024)
        time.sleep(0.02)
        done, status, usage = os.wait4(process.pid, os.WNOHANG)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    return time.perf_counter() - start, usage.ru_utime + usage.ru_stime, memory


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 50_000
    print(
        "| language | targets | changed | seconds | processor seconds | MiB | largest "
        "error left, µm |"
    )
    print("|---|---|---|---|---|---|---|")
    for program_format in PROGRAM_FORMATS:
        robot = load_robot(ROBOTS.get(program_format, OTHER_ROBOT))
        calibration = calibrations(robot)[1]
        text = WRITERS[program_format](robot, configurations(robot, count))
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder) / name for name in ("c.h5", "program", "corrected")]
            paths[0].write_bytes(to_bytes(calibration))
            paths[1].write_text(text, encoding="utf-8", newline="")
            seconds, cpu, mib = corrected(*paths)
            after = paths[2].read_bytes().decode()
        pairs = zip(
            written(text, program_format, robot), written(after, program_format, robot), strict=True
        )
        changed = sum(not np.array_equal(one, other) for one, other in pairs)
        error = largest_error(robot, calibration, text, after, program_format)
        print(
            f"| {program_format} | {count} | {changed} | {seconds:.1f} | {cpu:.1f} | {mib:.0f} | "
            f"{error * 1e6:.2f} |"
        )


if __name__ == "__main__":
    main()
