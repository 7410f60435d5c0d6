"""Groups that both kinds of HDF5 file have: robot, errors, conditions, set-up."""

import h5py
import numpy as np

from calibtool.errormodel.families import FAMILIES
from calibtool.errormodel.operating_conditions import Conditions
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.measurement.kinds import KINDS
from calibtool.measurement.setup import Setup
from calibtool.robot.robot import Robot
from calibtool.robot.source import parse_source
from calibtool.storage.stored_numbers import (
    LARGEST_ERROR,
    get,
    get_frames,
    put,
)
from calibtool.storage.texts import choice, put_string, put_text, string, text, texts


def write_robot(file: h5py.File, robot: Robot) -> None:
    """The description and URDF texts."""
    group = file.create_group("robot")
    put_string(group, "name", robot.name)
    put_text(group, "description", robot.source.toml_text, "text of robot.toml")
    put_text(group, "urdf", robot.source.urdf_text, "text of the URDF")


def read_robot(file: h5py.File) -> Robot:
    """The robot, built from its texts again."""
    group = file["robot"]
    return Robot.from_source(parse_source(text(group, "description"), text(group, "urdf"), "robot"))


def write_setup(group: h5py.Group, setup: Setup) -> None:
    """A set-up."""
    group.attrs["frame_known"] = setup.frame_known
    group.attrs["targets_known"] = setup.targets_known
    frame, words = setup.T_instrument_base, "pose of the robot base"
    put(group, "T_instrument_base", frame, "m", words, "instrument", "row", "column")
    put(group, "targets", setup.targets, "m", "target points on the tool", "tool", "target", "axis")
    put_string(group, "kind", setup.kind.id)
    for name, (_, unit, words) in setup.kind.arrays.items():
        labels = ("place", "row", "column")[-setup.arrays[name].ndim :]
        put(group, name, setup.arrays[name], unit, words, "tool", *labels)
    if setup.places:
        put_text(group, "places", setup.places, "labels of the places")
    if setup.further_frames is not None:
        words = "poses of the robot base in further places of the instrument"
        labels = ("place", "row", "column")
        put(group, "further_frames", setup.further_frames, "m", words, "instrument", *labels)


def read_setup(group: h5py.Group) -> Setup:
    """Read a set-up."""
    return Setup(
        T_instrument_base=get_frames(group, "T_instrument_base", 4, 4),
        targets=get(group, "targets", -1, 3),
        **{
            name: (get_frames if shape[-2:] in ((3, 3), (4, 4)) else get)(group, name, *shape)
            for name, (shape, _, _) in KINDS[choice(group, "kind", KINDS)].arrays.items()
        },
        places=texts(group, "places") if "places" in group else (),
        further_frames=get_frames(group, "further_frames", -1, 4, 4)
        if "further_frames" in group
        else None,
        frame_known=bool(group.attrs["frame_known"]),
        targets_known=bool(group.attrs["targets_known"]),
    )


def write_errors(group: h5py.Group, errors: RobotErrors) -> None:
    """The errors of a robot, a dataset for each family."""
    for family in FAMILIES:
        value = errors[family.id]
        labels, words = ("joint", "term")[: value.ndim], f"{family.words}: {family.meaning}"
        put(group, family.id, value, family.unit, words, "joint", *labels)


def read_errors(group: h5py.Group, robot: Robot) -> RobotErrors:
    """Read the errors of a robot. KeyError or ValueError for a damaged file."""
    shapes = {f.id: [-1] * len(f.shape(f.joints(robot))) for f in FAMILIES}
    return RobotErrors.of(
        robot,
        **{name: get(group, name, *shape, below=LARGEST_ERROR) for name, shape in shapes.items()},
    )


def write_conditions(group: h5py.Group, conditions: Conditions) -> None:
    """Known conditions of the rows."""
    if conditions.direction is not None:
        signs, words = conditions.direction.astype(np.int8), "sign of each joint's last motion"
        put(group, "direction", signs, "1", words, "joint", "configuration", "joint")
    for name, unit, words in (
        ("payload_kg", "kg", "mass at the tool"),
        ("temperature_c", "°C", "of the links"),
    ):
        values = getattr(conditions, name)
        if values is not None:
            put(group, name, values, unit, words, "", *["configuration"][: np.ndim(values)])


def read_conditions(group: h5py.Group, n: int) -> Conditions:
    """Read the known conditions of the rows, for n joints."""
    known = {
        name: get(group, name, *[-1] * group[name].ndim)
        for name in ("payload_kg", "temperature_c")
        if name in group
    }
    return Conditions(
        direction=get(group, "direction", -1, n) if "direction" in group else None, **known
    )


def read_provenance(file: h5py.File) -> dict[str, str]:
    """Texts by name."""
    group = file["provenance"]
    return {name: string(group, name) for name in group.attrs}
