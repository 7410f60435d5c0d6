"""Rendering of the templates: the same numbers for C and for Structured Text."""

import re
import textwrap
from collections.abc import Callable
from typing import Any, Literal, get_args

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from calibtool.calibration import Calibration
from calibtool.compensation.one_step import default_bounds
from calibtool.compensation.step import DAMPED_BELOW
from calibtool.errormodel.backlash import backlash_text
from calibtool.errormodel.bending import directions
from calibtool.errormodel.family import Rows
from calibtool.errormodel.operating_conditions import REFERENCE_C
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import check_choice, printable
from calibtool.export.layers import layers
from calibtool.robot.coupling import JointValues, check_joint_values, coupling_text
from calibtool.robot.gravity_torque import link_masses
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.singularity import GRAM_REGULARISATION

Precision = Literal["double", "single"]

LINE = 116  # characters

LARGEST_POSITION = 1e6  # rad or m; beyond it a position is nonsense, and sin stops some controllers

# Single precision: how near it comes to double precision at 99.9 % of the configurations and at
# all that were tried (two million; a decision that falls the other way costs more than rounding),
# and at which singularity distance that ends. Tests hold all three.
SINGLE_ACCURACY, SINGLE_LARGEST, SINGLE_DISTANCE = 1e-6, 2e-5, 0.04


class Code(str):
    """Text that is code, made by a template: `render` does not escape it."""

    __slots__ = ()


def in_code(text: str) -> str:
    """A text of a file for comments of C and Structured Text: ASCII, without characters that end
    the comment, join lines or begin a trigraph.
    """
    return re.sub(r"[^ -~]|[*\\?]", "_", text)


def in_xml_comment(text: str) -> str:
    """A text of a file for comments of XML, in which two hyphens must not follow each other."""
    return re.sub("-(?=-)", "- ", printable(text))


def render(
    template: str,
    values: dict[str, Any],
    escape: Callable[[str], str] = in_code,
    **filters: Callable[..., str],
) -> str:
    """A template of this package as text. An undefined name is an error.

    Every text in `values` except `Code` passes through `escape`. This is the only place where texts
    of files get into code.
    """
    environment = Environment(
        loader=PackageLoader("calibtool.export"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters.update(filters)
    return environment.get_template(template).render(_escaped(values, escape))


def _escaped(value: Any, escape: Callable[[str], str]) -> Any:
    if isinstance(value, str):
        return value if isinstance(value, Code) else escape(value)
    if isinstance(value, dict):
        return {_escaped(key, escape): _escaped(one, escape) for key, one in value.items()}
    return [_escaped(one, escape) for one in value] if isinstance(value, list) else value


def check_words(joint_values: str, precision: str = "double") -> None:
    """UsageError for a kind of joint values or a precision that does not exist."""
    check_joint_values(joint_values)
    check_choice(precision, get_args(Precision), "precision")


def digits(value: float, precision: Precision) -> str:
    """A decimal constant that reads back as this number (17 digits) or in single (9)."""
    text = f"{value:.17g}" if precision == "double" else f"{float(np.float32(value)):.9g}"
    if "." in text:
        return text
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}.0{e}{exponent}"


def wrapped(text: str, indent: int = 4, hanging: int = 0) -> str:
    """Text in lines of at most LINE characters."""
    return textwrap.fill(
        text,
        LINE,
        initial_indent=" " * indent,
        subsequent_indent=" " * (indent + hanging),
        break_on_hyphens=False,
    )


def compensator_values(
    calibration: Calibration, precision: Precision, joint_values: JointValues
) -> dict[str, Any]:
    """The numbers of a calibration, by their names in the templates; units as in `as_json`.

    joint_values: the kind of joint values that the code reads and returns.
    """
    robot, equivalent, network = (
        calibration.robot,
        calibration.equivalent,
        layers(calibration.network),
    )
    errors, bounds, turns = calibration.errors, default_bounds(calibration), _turns(calibration)
    motion, standing = _motion(errors), errors.standing(calibration.conditions)
    converted = joint_values == "controller" and robot.coupled
    return {
        "robot": robot.name,
        "base_model": calibration.base.model,
        "kinematic": calibration.base.model != "nominal",
        "corrects": network is not None or calibration.base.model != "nominal",
        "single": precision == "single",
        "single_accuracy": f"{SINGLE_ACCURACY:g}",
        "single_largest": f"{SINGLE_LARGEST:g}",
        "single_distance": f"{SINGLE_DISTANCE:g}",
        "network": network,
        "network_size": "none" if network is None else network.words,
        "left_out": left_out(calibration),
        "joints": joint_lines(robot),
        "coupling": robot.coupling if robot.coupled else None,
        "uncoupling": np.linalg.inv(robot.coupling),
        "converted": converted,  # the code takes and gives the controller's joint values …
        "q": "serial"
        if converted
        else "q",  # … and this is what it calls those of the serial chain
        "coupled_joints": coupling_text(robot.coupling),
        "n": robot.n,
        "p": equivalent.p,
        "rank": min(robot.n, 6),
        "parts": 2 if equivalent.virtual_joints else 1,
        "nominal_placements": robot.chain.placements,
        "axes": np.where(
            np.array(robot.prismatic)[:, None], robot.chain.twists[:, :3], robot.chain.twists[:, 3:]
        ),
        "slides": any(robot.prismatic),
        "slide_flags": [int(slide) for slide in robot.prismatic],
        "base_placements": standing.placements,
        "placement_changes": standing.placements - robot.chain.placements,
        "base_twists": errors.twists,
        "screws": _screws(robot, errors["twists"]),
        "base_offsets": errors["offsets"],
        "motion": motion,
        "varying": _varying(motion, turns),
        "conditions": _conditions(calibration),
        "turns": turns,
        "virtual_joints": ", ".join(equivalent.virtual_joints),
        "virtual_twists": np.eye(6)[equivalent.virtual_columns],
        "characteristic_length": robot.length,
        "damped_below": DAMPED_BELOW,
        "gram_regularisation": GRAM_REGULARISATION,
        "largest": LARGEST_POSITION,
        "lower": robot.lower,
        "upper": robot.upper,
        "largest_change": bounds.of_joints(robot),
        "usual": np.array(bounds.usual[::-1] if equivalent.virtual_joints else bounds.usual[:1]),
        "task_flags": [int(k not in equivalent.virtual_columns) for k in range(6)],
        # In single precision smaller pivots are rounding, and powers of their inverse
        # must stay finite.
        "smallest_pivot": 1e-30 if precision == "double" else 1e-8,
        "cost": _cost(calibration, motion, turns, converted),
    }


def _screws(robot: Robot, errors: Array) -> dict[str, Array]:
    """The motions exp6((ξ_j + δξ_j) x) of joints that turn, δξ (n, 6); zeros for slides.

    The axis turns by (1 + gains) x. The origin moves by leads x + swings sin θ +
    crossings (1 − cos θ), m.
    """
    turning = ~np.array(robot.prismatic)[:, None]
    axes = robot.chain.twists[:, 3:] + errors[:, 3:]
    rates = np.where(turning, np.linalg.norm(axes, axis=-1, keepdims=True), 1.0)
    axes = axes / rates
    across = np.cross(axes, errors[:, :3])  # for slides this is never used
    along = (errors[:, :3] * axes).sum(axis=-1, keepdims=True) * axes
    screws = {
        "axes": axes,
        "axis_changes": axes - robot.chain.twists[:, 3:],
        "leads": along,
        "swings": (errors[:, :3] - along) / rates,
        "crossings": across / rates,
    }
    return {
        "gains": (rates - 1.0)[:, 0],
        **{name: np.where(turning, x, 0.0) for name, x in screws.items()},
    }


def left_out(calibration: Calibration) -> str:
    """The parts that a function of the joint positions cannot hold, in words; empty without any."""
    backlash = calibration.base.errors["backlash"]
    if not backlash.any():
        return ""
    return (
        f"backlash ({backlash_text(calibration.robot, backlash)}): it needs the direction of motion"
    )


def _cost(
    calibration: Calibration,
    motion: dict[str, Any],
    turns: dict[str, Any] | None,
    converted: bool,
) -> str:
    """Number of operations of one correction in the generated C code, for an undamped step."""
    n, p, network = calibration.robot.n, calibration.equivalent.p, layers(calibration.network)
    if network is None and calibration.base.model == "nominal":
        return "none: nothing is corrected"
    kinematic = calibration.base.model != "nominal"
    varying = _varying(motion, turns)
    steps = 1 if n >= 6 else 2  # of the task components, and of all
    flops = (1241 if kinematic else 537) * n + 560 + (steps - 1) * 157 * n
    flops += 4 * n * n * converted
    calls = 2 * n * (1 if kinematic and not varying else 2) + steps * (min(n, 6) + 1) + 4
    if network is not None:
        runs = 2 if kinematic else 3
        flops += runs * (2 * n + 2 * n * network.hidden + p * (2 * network.hidden + 1)) + 2 * (
            12 * p + 186
        )
        calls += runs * network.hidden
    if varying:
        flops += n * (172 + 20 * motion["orders"] + 124 * motion["gravity"])
        flops += 4 * n * (n - 1) * (n + 1) if motion["pairs"] is not None else 0
    if turns:
        payload, bends, wobbles = (
            turns[part] is not None for part in ("payload", "bending", "wobble")
        )
        across = 42 * (bends or wobbles)
        flops += 2 * n * (165 + 43 * payload + 54 * bends + 8 * wobbles + across)
    return (
        f"about {flops} flops and {calls} calls of functions such as sin and sqrt; at "
        "worst twice that"
    )


def _motion(errors: RobotErrors) -> dict[str, Any]:
    """Joint-motion functions: number of harmonics, pairs, gravity, and their numbers."""
    masses, centres, gravity = link_masses(errors.robot)
    return {
        "orders": errors["harmonics"].shape[1] // 2 if errors["harmonics"].any() else 0,
        "harmonics": errors["harmonics"],
        "pairs": errors["pairs"] if errors["pairs"].any() else None,
        "gravity": bool(errors["gravity"].any()),
        "weights": bool(errors["gravity"].any() or errors["bending"].any()),
        "compliance": errors["gravity"],
        "masses": masses,
        "centres": centres,
        "gravity_vector": gravity,
    }


def _varying(motion: dict[str, Any], turns: dict[str, Any] | None) -> bool:
    """Whether the joint motion errors or the placements change with the joint positions."""
    return bool(motion["orders"] or motion["pairs"] is not None or motion["gravity"] or turns)


def _conditions(calibration: Calibration) -> str:
    """The payload and temperature for which it is, in words; empty without such errors."""
    rows = Rows(calibration.robot, np.zeros((1, calibration.robot.n)), calibration.conditions)
    words = {
        "payload": f"{float(rows.payload):g} kg at the tool",
        "temperature": f"links at {REFERENCE_C + float(rows.warmth):g} C",
    }
    return ", ".join(
        text for family, text in words.items() if calibration.base.errors[family].any()
    )


def _turns(calibration: Calibration) -> dict[str, Any] | None:
    """The rotations of the joint frames from row to row, and the origins about which they turn;
    None without any.

    payload: the mass at the tool and its effect on each joint; bending, wobble: about `across`.
    None where absent.
    """
    errors, robot = calibration.errors, calibration.robot
    mass = float(Rows(robot, np.zeros((1, robot.n)), calibration.conditions).payload)
    payload = errors["payload"].any() and mass
    bending, wobble = (errors[f] if errors[f].any() else None for f in ("bending", "wobble"))
    if not payload and bending is None and wobble is None:
        return None
    grown = errors.without("placements").standing(calibration.conditions).placements
    return {
        "payload": {
            "mass": mass,
            "wind": errors["payload"][:, 0],
            "bend": errors["payload"][:, 1],
            "weight": mass * np.array(robot.chain.model.gravity.linear),
        }
        if payload
        else None,
        "bending": bending,
        "wobble": wobble,
        "across": np.swapaxes(directions(robot), 1, 2).reshape(-1, 3),  # u_1, v_1, u_2, …
        "origins": grown[:-1, :3, 3],
    }


def joint_lines(robot: Robot) -> list[str]:
    """One line per joint."""
    names = robot.chain.bodies.joints[: robot.n]
    return [
        f"{name}, {unit}, {low:.6g} to {high:.6g}"
        for name, unit, low, high in zip(
            names, robot.joint_units, robot.lower, robot.upper, strict=True
        )
    ]
