"""The kinematic model of a controller: read from a file and compared with the nominal robot."""

from dataclasses import dataclass, replace

import numpy as np

from calibtool.controller.joint_offsets import is_offsets, offsets_model
from calibtool.errors import InputError, UsageError
from calibtool.robot.constant_placements import chain_of
from calibtool.robot.denavit_hartenberg import (
    DhConvention,
    DhText,
    dh_text,
    is_dh,
    read_dh,
    steps_of,
)
from calibtool.robot.description import ToleranceTable
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, inverse, pose_distances
from calibtool.robot.universal_robots import SECTION, changes_model, frames_model, is_changes
from calibtool.robot.ur_frames import is_frames

# The calibrations of five real UR arms move the tool by at most 0.33 % of that sum, and 12 mrad.
PLAUSIBLE_PART = 0.01  # of the sum of link lengths
PLAUSIBLE_TURN = 30e-3  # rad
_CONFIGURATIONS = 500
_LARGEST = 100_000  # number of characters that a calibration or table may have


@dataclass(frozen=True, eq=False)
class ControllerModel:
    """The kinematics by which a controller turns poses into joint values.

    mechanism    T_base_tool for joint positions of the serial chain, as the nominal robot's
    position     largest distance of the tool from the nominal robot's over the joint range, m
    orientation  largest turn against it, rad
    """

    mechanism: Mechanism
    position: float
    orientation: float


def read_controller_model(
    text: str, name: str, robot: Robot, dh: DhConvention | None = None
) -> ControllerModel:
    """The model that the text of a file called `name` describes; robot is the nominal one.

    A URDF (with the base and tool frames that the robot's description names), the YAML of the UR
    driver, a UR controller's calibration.conf, joint offsets as `export` writes them, or a table of
    DH parameters with their convention `dh`; its contents tell which. Raises InputError for a file
    that is none of these, or of another arm: another number or kind of joints, or a tool farther
    from the nominal one than a factory calibration moves it (1 % of the sum of link lengths,
    30 mrad).
    UsageError for a robot with closed loops.
    """
    if robot.chain.tree is not None:
        raise UsageError(
            f"{name}: {robot.name} has closed loops; a controller's own model is that of a serial "
            "arm: use --controller nominal"
        )
    text = text.removeprefix("\ufeff")
    kind = _kind(text, name)
    if dh is not None and kind != "dh":
        raise UsageError(f"--dh is for a table of DH parameters, but {name} holds none")
    if kind != "urdf" and len(text) > _LARGEST:
        raise InputError(f"{name}: {len(text)} characters; the calibration of an arm is smaller")
    if kind == "dh":
        return _of_dh(dh_text(text, name), robot, dh)
    read = {
        "urdf": _of_urdf,
        "frames": frames_model,
        "changes": changes_model,
        "offsets": offsets_model,
    }[kind]
    return _plausible(read(text, name, robot), name, robot)


def _kind(text: str, name: str) -> str:
    start = text.lstrip()
    if start.startswith("<"):
        return "urdf"
    if is_offsets(text):
        return "offsets"
    if is_changes(text):
        return "changes"
    if is_dh(text):
        return "dh"
    if is_frames(text) or name.endswith((".yaml", ".yml")):
        return "frames"
    raise InputError(
        f"{name}: no model of a controller; expected a URDF, the YAML of the UR driver "
        f"(kinematics: with six frames), a calibration.conf ([{SECTION}]) or a table of DH "
        "parameters (joint a_mm alpha_deg d_mm theta_deg)"
    )


def _of_urdf(text: str, name: str, robot: Robot) -> Robot:
    """The arm between the base and the tool frame that the nominal robot's description names."""
    description = robot.source.description.model_copy(
        update={
            "limits": {},
            "workspaces": {},
            "tolerances": ToleranceTable(),
            "equivalent": None,
            "coupling": None,
        }
    )
    return Robot.from_source(
        replace(robot.source, description=description, urdf_text=text, place=name)
    )


def _of_dh(table: DhText, robot: Robot, given: DhConvention | None) -> ControllerModel:
    rows, name = read_dh(table), table.name
    convention = given or rows.convention
    if convention is None or rows.convention not in (convention, None):
        raise UsageError(
            f"{name}: the table is {rows.convention}, --dh says {given}"
            if convention
            else f"{name}: DH parameters do not say their convention; give --dh standard (a and "
            "alpha behind the joint) or --dh modified (Craig: before it)"
        )
    _check_joints(len(rows.joints), name, robot)

    def chain(convention: DhConvention) -> Robot:
        return chain_of(steps_of(rows, convention), robot.prismatic, name)

    try:
        return _plausible(chain(convention), name, robot)
    except InputError as error:
        other: DhConvention = "modified" if convention == "standard" else "standard"
        if _small(_compared(chain(other), robot), robot):
            raise InputError(f"{error}; as --dh {other} it fits") from None
        raise


def _check_joints(count: int, name: str, robot: Robot) -> None:
    if count != robot.n:
        raise InputError(f"{name}: a model of {count} joints, but {robot.name} has {robot.n}")


# --- compared with the nominal robot -----------------------------------------------------------


def _plausible(model: Robot, name: str, robot: Robot) -> ControllerModel:
    _check_joints(model.n, name, robot)
    if model.prismatic != robot.prismatic:
        raise InputError(
            f"{name}: a joint slides that turns in {robot.name}, or the other way round"
        )
    found = _compared(model, robot)
    if not _small(found, robot):
        raise InputError(
            f"{name}: no model of this {robot.name}: its tool is up to "
            f"{found.position * 1e3:.1f} mm and {found.orientation * 1e3:.1f} mrad from the "
            f"nominal one, and a factory calibration stays below {_bound(robot) * 1e3:.1f} mm and "
            f"{PLAUSIBLE_TURN * 1e3:g} mrad{_constant(model, robot)}"
        )
    return found


def _bound(robot: Robot) -> float:
    return PLAUSIBLE_PART * 2 * robot.length


def _small(model: ControllerModel, robot: Robot) -> bool:
    return model.position <= _bound(robot) and model.orientation <= PLAUSIBLE_TURN


def _compared(model: Robot, robot: Robot) -> ControllerModel:
    return ControllerModel(model.mechanism, *_largest(*_poses(model, robot)))


def _poses(model: Robot, robot: Robot) -> tuple[Array, Array]:
    """Tool poses of both at configurations of the nominal robot's joint range, (N, 4, 4)."""
    q = robot.anywhere(_CONFIGURATIONS, np.random.default_rng(0))
    return model.mechanism.forward(q), robot.mechanism.forward(q)


def _largest(a: Array, b: Array) -> tuple[float, float]:
    """Largest distance and turn between poses (N, 4, 4), m and rad."""
    position, orientation = pose_distances(a, b)
    return float(position.max()), float(orientation.max())


def _constant(model: Robot, robot: Robot) -> str:
    """The end of the message where only the base or the tool frame is another one."""
    own, nominal = _poses(model, robot)
    at = 0  # the configuration whose difference is taken for all
    for frame, moved in (
        ("base", own[at] @ inverse(nominal[at]) @ nominal),
        ("tool", nominal @ inverse(nominal[at]) @ own[at]),
    ):
        if _small(ControllerModel(model.mechanism, *_largest(own, moved)), robot):
            return f"; only its {frame} frame is another one: name the controller's in robot.toml"
    return ""
