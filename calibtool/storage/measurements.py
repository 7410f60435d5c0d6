"""Measurements as HDF5 groups."""

import h5py
import numpy as np

from calibtool.measurement.measurements import Measurements, Truth
from calibtool.robot.actual import ActualRobot
from calibtool.storage.parts import (
    get,
    get_with_gaps,
    put,
    read_geometry,
    read_number,
    read_provenance,
    read_robot,
    read_setup,
    write_geometry,
    write_setup,
)
from calibtool.storage.texts import put_string


def write_measurements(file: h5py.File, measurements: Measurements) -> None:
    """Groups of measurements, in a fixed order."""
    robot = measurements.robot
    group = file.create_group("measurements")
    put_string(group, "kind", measurements.kind)
    group.attrs["noise_position_m"] = measurements.noise_position
    group.attrs["noise_orientation_rad"] = measurements.noise_orientation
    units = ", ".join(robot.joint_units)
    put(group, "joint_positions", measurements.q, units, "commanded joint positions", "joint", "configuration", "joint")
    if measurements.direction is not None:
        long_name = "sign of each joint's last motion"
        put(
            group,
            "directions",
            measurements.direction.astype(np.int8),
            "1",
            long_name,
            "joint",
            "configuration",
            "joint",
        )
    if measurements.commanded is not None:
        labels = ("configuration", "row", "column")
        long_name = "tool poses asked for, where the joints are corrected for them"
        put(group, "commanded_poses", measurements.commanded, "m", long_name, "base", *labels)
    labels = ("configuration", "target", "axis")
    put(group, "points", measurements.points, "m", "measured target points", "instrument", *labels)
    if measurements.rotations is not None:
        labels = ("configuration", "row", "column")
        put(group, "rotations", measurements.rotations, "1", "measured sensor orientations", "instrument", *labels)
    write_setup(file.create_group("registration"), measurements.setup)
    if measurements.truth is not None:
        actual = measurements.truth.actual
        truth = file.create_group("truth")
        write_geometry(truth, actual.geometry)
        put(
            truth,
            "gear",
            actual.gear,
            "rad",
            "sin q, cos q, sin 2q, cos 2q on the joint motion",
            "joint",
            "joint",
            "term",
        )
        put(truth, "compliance", actual.compliance, "rad/(N m)", "wind-up per gravity torque", "joint", "joint")
        put(truth, "backlash", actual.backlash, "rad or m", "half width", "joint", "joint")
        truth.attrs["expansion"] = actual.expansion
        write_setup(truth.create_group("registration"), measurements.truth.setup)


def build_measurements(file: h5py.File) -> Measurements:
    """The measurements of an open file. KeyError or ValueError for a damaged one."""
    robot = read_robot(file)
    group = file["measurements"]
    rotations = get(group, "rotations", -1, 3, 3) if "rotations" in group else None
    truth = None
    if "truth" in file:
        stored = file["truth"]
        actual = ActualRobot(
            robot=robot,
            geometry=read_geometry(stored, robot.n),
            gear=get(stored, "gear", robot.n, 4),
            compliance=get(stored, "compliance", robot.n),
            backlash=get(stored, "backlash", robot.n),
            expansion=read_number(stored, "expansion"),
        )
        truth = Truth(actual, read_setup(stored["registration"]))
    return Measurements(
        robot=robot,
        q=get(group, "joint_positions", -1, robot.n),
        points=get_with_gaps(group, "points", -1, -1, 3),  # NaN: a target that was not seen
        rotations=rotations,
        setup=read_setup(file["registration"]),
        noise_position=read_number(group, "noise_position_m"),
        noise_orientation=read_number(group, "noise_orientation_rad"),
        truth=truth,
        direction=get(group, "directions", -1, robot.n) if "directions" in group else None,
        provenance=read_provenance(file),
        commanded=get(group, "commanded_poses", -1, 4, 4) if "commanded_poses" in group else None,
    )
