"""A calibration as C99 source: the one-step correction (Eq. 24) for a robot's controller."""

import re
import textwrap
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from calibtool.calibration import Calibration
from calibtool.errors import UsageError
from calibtool.robot.mechanism import GRAM_REGULARISATION, MIN_SINGULARITY_DISTANCE
from calibtool.robot.model import Robot
from calibtool.robot.motion import JointMotion, link_masses
from calibtool.robot.se3 import Array

_LINE = 116  # characters


def calibration_as_c(calibration: Calibration, prefix: str = "calibtool") -> tuple[str, str]:
    """Header and source, to be saved as `<prefix>.h` and `<prefix>.c`: functions `<prefix>_correct`, `<prefix>_network`.

    `<prefix>_correct` is `compensation.solve.one_step` in C99: joint positions q (n,) in rad or m to q_m (Eq. 24). The
    source needs <math.h> only, takes no memory from the heap, and is plain ASCII. Numbers have 17 significant digits; the
    same calibration gives the same text. Raises UsageError when `prefix` is no C identifier.
    """
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", prefix):
        raise UsageError(f"'{prefix}' cannot begin the names of C functions; use letters, digits and _, no digit first")
    environment = Environment(
        loader=PackageLoader("calibtool.export"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters.update(c_number=_c_number, c_array=_c_array, c_poses=_c_poses)
    values = {"prefix": prefix, "PREFIX": prefix.upper(), **_values(calibration)}
    header, source = (environment.get_template(f"compensator.{suffix}.j2").render(values) for suffix in "hc")
    return header, source


def _c_number(value: float) -> str:
    """A C constant of type double that reads back as exactly this one: 17 significant digits."""
    text = f"{value:.17g}"
    return text if "." in text or "e" in text else f"{text}.0"


def _values(calibration: Calibration) -> dict[str, Any]:
    """What the templates name."""
    robot, equivalent, network = calibration.robot, calibration.equivalent, calibration.network
    geometry = calibration.base.geometry
    columns = equivalent.virtual_columns
    kinematic = calibration.base.model != "nominal"
    size = f"{robot.n} inputs, {network.hidden} hidden nodes (tanh), {equivalent.p} outputs" if network else "none"
    return {
        "robot": robot.name,
        "base_model": calibration.base.model,
        "kinematic": kinematic,
        "network": network,
        "network_size": size,
        "joints": _joints(robot),
        "coupling": robot.coupling if robot.coupled else None,
        "uncoupling": np.linalg.inv(robot.coupling),
        "cost": _cost(robot.n, equivalent.p, network.hidden if network else 0, kinematic, calibration.base.motion),
        "n": robot.n,
        "p": equivalent.p,
        "nominal_placements": robot.chain.placements,
        "nominal_twists": robot.chain.twists,
        "base_placements": geometry.placements_of(robot.chain),
        "base_twists": robot.chain.twists + geometry.twists,
        "base_offsets": geometry.offsets,
        "motion": _motion(robot, calibration.base.motion),
        "virtual_joints": ", ".join(equivalent.virtual_joints),
        "virtual_twists": np.eye(6)[columns],
        "characteristic_length": robot.length,
        "min_singularity_distance": MIN_SINGULARITY_DISTANCE,
        "gram_regularisation": GRAM_REGULARISATION,
    }


def _motion(robot: Robot, motion: JointMotion) -> dict[str, Any] | None:
    """The joint-motion functions, None without any."""
    if motion.is_none:
        return None
    masses, centres, gravity = link_masses(robot)
    return {
        "orders": motion.harmonics.shape[1] // 2 if motion.harmonics.any() else 0,
        "harmonics": motion.harmonics,
        "gravity": bool(motion.compliance.any()),
        "compliance": motion.compliance,
        "masses": masses,
        "centres": centres,
        "gravity_vector": gravity,
    }


def _joints(robot: Robot) -> list[str]:
    """One line per joint. A name comes from a URDF: nothing of it may end the comment it stands in."""
    names = [re.sub(r"[^A-Za-z0-9_. -]", "_", name) for name in robot.chain.model.names[1:]]
    return [
        f"{name}, {unit}, {low:.6g} to {high:.6g}"
        for name, unit, low, high in zip(names, robot.joint_units, robot.lower, robot.upper, strict=True)
    ]


def _cost(n: int, p: int, hidden: int, kinematic: bool, motion: JointMotion) -> str:
    """Arithmetic of one correction, counted in the generated code, and its stack under gcc -O2 on a 64-bit machine."""
    flops, calls, doubles = 2 * n, hidden, p + hidden
    if hidden:
        flops += 4 * n * hidden + p * (2 * hidden + 1)
    if kinematic:
        flops += 427 * n + 141 * p + 568
        calls += 6 * n + 9
        doubles += n + 6 * p + 210
        if hidden:
            flops += 12 * p + 148
            calls += 3
    if motion.harmonics.any():
        flops += 2 * n * motion.harmonics.shape[1]
        calls += n * motion.harmonics.shape[1]
    if motion.compliance.any():
        flops += 260 * n + 10 * n * (n + 1)
        calls += 5 * n
        doubles += 10 * n + 30
    return f"about {flops} flops and {calls} calls of <math.h>; about {8 * doubles + 256} bytes of stack"


def _c_array(values: Array) -> str:
    """Initialiser of a double[] or a double[][]."""
    if values.ndim == 1:
        line = _row(values)
        return line if len(line) < _LINE / 2 else f"{{\n{_wrapped(line[1:-1], hanging=0)},\n}}"
    return "{\n" + "".join(f"{_wrapped(_row(row), hanging=1)},\n" for row in values) + "}"


def _c_poses(poses: Array) -> str:
    """Initialiser of a pose[], from (N, 4, 4)."""
    texts = []
    for pose in poses:
        rotation = ",\n      ".join(_row(row) for row in pose[:3, :3])
        texts.append(f"    {{{{{rotation}}},\n     {_row(pose[:3, 3])}}},\n")
    return "{\n" + "".join(texts) + "}"


def _row(values: Array) -> str:
    return "{" + ", ".join(_c_number(value) for value in values) + "}"


def _wrapped(text: str, hanging: int) -> str:
    return textwrap.fill(
        text, _LINE, initial_indent=" " * 4, subsequent_indent=" " * (4 + hanging), break_on_hyphens=False
    )
