"""Measurements as HDF5 groups."""

import h5py

from calibtool.errormodel.actual import ActualRobot
from calibtool.measurement.measurements import Measurements, Truth
from calibtool.storage.shared_groups import (
    read_conditions,
    read_errors,
    read_provenance,
    read_robot,
    read_setup,
    write_conditions,
    write_errors,
    write_setup,
)
from calibtool.storage.stored_numbers import (
    get,
    get_frames,
    get_indices,
    get_with_gaps,
    put,
    read_number,
)
from calibtool.storage.texts import put_string, put_text, texts


def write_measurements(file: h5py.File, measurements: Measurements) -> None:
    """Groups of measurements, in a fixed order."""
    robot = measurements.robot
    group = file.create_group("measurements")
    put_string(group, "kind", measurements.kind)
    group.attrs["noise_position_m"] = measurements.noise_position
    group.attrs["noise_orientation_rad"] = measurements.noise_orientation
    units, words = ", ".join(robot.joint_units), "commanded joint positions"
    put(group, "joint_positions", measurements.q, units, words, "joint", "configuration", "joint")
    write_conditions(group, measurements.conditions)
    if measurements.commanded is not None:
        words = "tool poses asked for, where the joints are corrected for them"
        poses = measurements.commanded
        put(group, "commanded_poses", poses, "m", words, "base", "configuration", "row", "column")
    deviations = "standard deviations along the instrument's axes"
    for name, unit, words, *labels in (
        ("points", "m", "measured target points", "target", "axis"),
        ("rotations", "1", "measured sensor orientations", "row", "column"),
        ("deviations", "m, rad", deviations, "coordinate"),
        ("values", measurements.setup.kind.unit, "measured values", "value"),
    ):
        values = getattr(measurements, name)
        if values is not None:
            put(group, name, values, unit, words, "instrument", "configuration", *labels)
    if measurements.place is not None:
        words = "labelled place of each row, from 0"
        put(group, "place", measurements.place, "1", words, "", "configuration")
    if measurements.findings:
        put_text(group, "findings", measurements.findings, "what was wrong when they were made")
    write_setup(file.create_group("registration"), measurements.setup)
    if measurements.truth is not None:
        actual = measurements.truth.actual
        truth = file.create_group("truth")
        write_errors(truth.create_group("errors"), actual.errors)
        truth.attrs["temperature_c"] = actual.temperature_c
        write_setup(truth.create_group("registration"), measurements.truth.setup)


def build_measurements(file: h5py.File) -> Measurements:
    """The measurements of an open file. KeyError or ValueError for a damaged one."""
    robot = read_robot(file)
    group = file["measurements"]
    rotations = get_frames(group, "rotations", -1, 3, 3) if "rotations" in group else None
    truth = None
    if "truth" in file:
        stored = file["truth"]
        actual = ActualRobot(
            read_errors(stored["errors"], robot),
            read_number(stored, "temperature_c", -273.15),
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
        conditions=read_conditions(group, robot.n),
        values=get_with_gaps(group, "values", -1, -1) if "values" in group else None,
        place=get_indices(group, "place") if "place" in group else None,
        findings=texts(group, "findings") if "findings" in group else (),
        deviations=get(group, "deviations", -1, -1) if "deviations" in group else None,
        provenance=read_provenance(file),
        commanded=get(group, "commanded_poses", -1, 4, 4) if "commanded_poses" in group else None,
    )
