"""A calibration as machine data of a KUKA arm, fitted with the parameters that these have."""

import numpy as np

from calibtool.calibration import Calibration
from calibtool.errors import InputError
from calibtool.export.unrepresented_parts import all_together
from calibtool.export.urdf_geometry import check_without_loops, fit_configurations
from calibtool.robot.kuka_machine import AXES, SIGNS, MachineData
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, inverse, relative_error

_SAME = 1e-5  # m and rad: how exactly the drawing must be an arm of this kind
_OFFSETS = (1, 4)  # axes whose zero no frame of the machine data holds


def calibration_as_kuka_machine(calibration: Calibration) -> tuple[str, list[str]]:
    """Lines for $machine.dat that `read_machine_data` reads, and a list of what they do not hold.

    $TIRORO, $LENGTH_A, $LENGTH_B, $TX3P3, $DH_4, $DH_5, $TFLWP and changes of $MAMES for axes 2 and
    5 are fitted to the calibrated robot at the configurations of `urdf_geometry`. Raises InputError
    for an arm that is no #NR arm with a central wrist whose joints have KUKA's signs and zeros.
    """
    robot, q = calibration.robot, fit_configurations(calibration)
    found = _fitted(robot, calibration.forward(q), q, _drawing(robot))
    held = _forward(found, calibration.q)
    missing = all_together(calibration.forward(calibration.q), held)
    data = _data(found)

    def braces(names: str, values: tuple[float, ...]) -> str:
        pairs = (f"{key} {value!r}" for key, value in zip(names.split(), values, strict=True))
        return "{" + ",".join(pairs) + "}"

    lines = [
        f"; Machine data of {robot.name}, calibrated: lengths in mm, angles in deg.",
        "; Changes of the machine data of an arm: have them checked by its maker.",
        *(f"; not held: {line}" for line in missing),
        *(f"FRAME ${key}={braces('X Y Z A B C', v)}" for key, v in data.frames.items()),
        f"REAL $LENGTH_A={data.lengths[0]!r}",
        f"REAL $LENGTH_B={data.lengths[1]!r}",
        *(
            f"DECL DHART ${key}={braces('DHART_A DHART_D DHART_ALPHA', v)}"
            for key, v in data.dh.items()
        ),
        *(f"; $MAMES[{j + 1}] += {data.mames[j]!r}" for j in _OFFSETS),
    ]
    return "\n".join(lines) + "\n", missing


def _drawing(robot: Robot) -> Array:
    """The parameters of the nominal robot, (28,): m and rad, see `_forward`."""
    check_without_loops(robot, "KUKA's machine data")
    if robot.n != 6 or any(robot.prismatic):
        raise InputError(f"{robot.name}: KUKA's machine data are for six revolute joints")
    frames = robot.mechanism.frames(np.zeros((1, 6)))
    points = frames.before[0, :, :3, 3]
    tool = inverse(frames.before[0, 4]) @ frames.tool[0]
    x = np.zeros(28)
    x[2], x[6], x[7] = points[1, 2], points[1, 0], points[2, 0] - points[1, 0]
    x[8], x[10], x[12] = points[4, 0] - points[2, 0], points[4, 2] - points[2, 2], np.pi / 2
    x[16], x[19] = np.pi / 2, -np.pi / 2
    x[22] = np.linalg.norm(tool[:3, 3])
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 6))
    target = robot.mechanism.forward(q)
    x = _fitted(robot, target, q, x)
    if np.abs(_forward(x, q) - target).max() > _SAME:
        raise InputError(
            f"{robot.name}: no arm of KUKA's machine data: a #NR arm with a central wrist, whose "
            "joints have KUKA's signs and zeros (arm stretched forward at 0), from $ROBROOT to the "
            "flange"
        )
    return x


def _fitted(robot: Robot, target: Array, q: Array, start: Array) -> Array:
    """Gauss–Newton from `start` to the poses (N, 4, 4) at q; redundant parameters move least."""
    x = start
    weights = np.repeat([1.0 / robot.length, 1.0], 3)
    for _ in range(30):
        poses = _forward(x, q)
        error = (_at_tool(target, poses) * weights).ravel()
        columns = []
        for k in range(len(x)):
            step = np.zeros_like(x)
            step[k] = 1e-6
            ends = (_at_tool(_forward(x + sign * step, q), poses) for sign in (1.0, -1.0))
            columns.append(((next(ends) - next(ends)) * weights / 2e-6).ravel())
        step = np.linalg.lstsq(np.array(columns).T, error, rcond=1e-9)[0]
        x = x + step
        if np.abs(step).max() < 1e-12:
            break
    return x


def _at_tool(a: Array, b: Array) -> Array:
    """How poses a differ from b, (N, 6): position, then turn, in K_0."""
    turn = relative_error(a, b)[:, 3:]
    return np.concatenate([a[:, :3, 3] - b[:, :3, 3], turn], axis=1)


def _forward(x: Array, q: Array) -> Array:
    """T of `kuka_machine` (N, 4, 4): x holds $TIRORO (6), $LENGTH_A, $LENGTH_B, $TX3P3 (6), $DH_4
    (A, D, ALPHA), $DH_5, $TFLWP (6) and the zeros of axes 2 and 5, m and rad; q (N, 6).
    """
    tiroro, tx3p3, tflwp = (_frame(x[k : k + 6]) for k in (0, 8, 20))
    before = [tiroro, _shift(x[6]), _shift(x[7]), tx3p3, _dh(x[14:17]), _dh(x[17:20])]
    zeros = np.array([0.0, x[26], 0.0, 0.0, x[27], 0.0])
    pose = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for j, placement in enumerate(before):
        twists = np.zeros((len(q), 6))
        twists[:, 3:] = np.array(AXES[j]) * (SIGNS[j] * (q[:, j] + zeros[j]))[:, None]
        pose = pose @ placement @ exp6(twists)
    return pose @ tflwp


def _frame(values: Array) -> Array:
    """X Y Z A B C in m and rad: a translation, then Rz(A) Ry(B) Rx(C). (4, 4)"""
    pose = np.eye(4)
    for axis, angle in zip((5, 4, 3), values[3:], strict=True):
        pose = pose @ exp6(np.eye(6)[axis] * angle)
    pose[:3, 3] = values[:3]
    return pose


def _shift(length: float) -> Array:
    return exp6(np.eye(6)[0] * length)


def _dh(values: Array) -> Array:
    """A, D, ALPHA: Tz(D) Tx(A) Rx(ALPHA). (4, 4)"""
    pose = exp6(np.eye(6)[3] * values[2])
    pose[:3, 3] = values[0], 0.0, values[1]
    return pose


def _data(x: Array) -> MachineData:
    lengths, angles = x * 1e3 + 0.0, np.rad2deg(x) + 0.0

    def frame(k: int) -> tuple[float, ...]:
        return (*lengths[k : k + 3].tolist(), *angles[k + 3 : k + 6].tolist())

    def dh(k: int) -> tuple[float, ...]:
        return (*lengths[k : k + 2].tolist(), float(angles[k + 2]))

    return MachineData(
        {"TIRORO": frame(0), "TX3P3": frame(8), "TFLWP": frame(20)},
        (float(lengths[6]), float(lengths[7])),
        {"DH_4": dh(14), "DH_5": dh(17)},
        (0.0, float(angles[26]), 0.0, 0.0, float(angles[27]), 0.0),
    )
