"""The only module that knows HDF5: measurements and calibrations to bytes and back. Formats: docs/file-formats.md.

The same contents give the same bytes: no time stamps, no pickles, groups and datasets in a fixed order.
"""

import io
from collections.abc import Callable
from typing import Any, BinaryIO, TypeVar

import h5py
import numpy as np

from calibtool import __version__
from calibtool.calibration import Calibration
from calibtool.equivalent.joints import ELEMENTARY, EquivalentRobot
from calibtool.equivalent.network import Network
from calibtool.equivalent.optimisers import History
from calibtool.equivalent.training import TrainingReport
from calibtool.errors import CalibtoolError, InputError
from calibtool.identification.local_poe import Identification
from calibtool.measurement.measurements import Measurements, Setup, Truth
from calibtool.robot.actual import ActualRobot
from calibtool.robot.description import parse_source
from calibtool.robot.geometry import GeometricErrors
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array, readonly

MEASUREMENTS, CALIBRATION = "calibtool/measurements", "calibtool/calibration"
SCHEMA_VERSION = 1

T = TypeVar("T")


def to_bytes(contents: Measurements | Calibration) -> bytes:
    """The HDF5 file of measurements or of a calibration."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", libver=("v110", "v110")) as file:  # its metadata carry checksums
        file.attrs["schema"] = MEASUREMENTS if isinstance(contents, Measurements) else CALIBRATION
        file.attrs["schema_version"] = SCHEMA_VERSION
        file.attrs["creator"] = "calibtool"
        file.attrs["creator_version"] = __version__
        _write_robot(file, contents.robot)
        if isinstance(contents, Measurements):
            _write_measurements(file, contents)
        else:
            _write_calibration(file, contents)
        provenance = file.create_group("provenance")
        for name, text in sorted(contents.provenance.items()):
            provenance.attrs[name] = text
    return buffer.getvalue()


def read_measurements(stream: BinaryIO, name: str) -> Measurements:
    """Measurements from a binary stream; `name` stands in messages. Raises InputError for anything else."""
    return _read(stream, name, MEASUREMENTS, _measurements)


def read_calibration(stream: BinaryIO, name: str) -> Calibration:
    """A calibration from a binary stream; `name` stands in messages. Raises InputError for anything else."""
    return _read(stream, name, CALIBRATION, _calibration)


def read_any(stream: BinaryIO, name: str) -> Measurements | Calibration:
    """Whichever of the two kinds the stream holds."""
    return _read(
        stream, name, None, lambda file: (_measurements if _schema(file) == MEASUREMENTS else _calibration)(file)
    )


def _read(stream: BinaryIO, name: str, schema: str | None, build: Callable[[h5py.File], T]) -> T:
    data = stream.read()
    if not data:
        raise InputError(f"{name}: empty; expected a calibtool HDF5 file (did the command before fail?)")
    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            found = _schema(file)
            if found not in (MEASUREMENTS, CALIBRATION):
                raise InputError(
                    f"{name}: an HDF5 file, but not one of calibtool (no schema {MEASUREMENTS} or {CALIBRATION})"
                )
            version = int(file.attrs.get("schema_version", 0))
            if version > SCHEMA_VERSION:
                raise InputError(
                    f"{name}: written in format version {version}, this calibtool reads up to {SCHEMA_VERSION}; "
                    "install a newer calibtool"
                )
            if schema is not None and found != schema:
                raise InputError(f"{name}: holds {found}, expected {schema}")
            return build(file)
    except InputError as error:
        raise error if str(error).startswith(name) else InputError(f"{name}: {error}") from None
    except CalibtoolError:
        raise
    except OSError:
        raise InputError(f"{name}: not an HDF5 file, or cut off; expected a file that calibtool wrote") from None
    except (KeyError, ValueError, TypeError, RuntimeError, IndexError, AttributeError, OverflowError) as error:
        raise InputError(f"{name}: damaged: {' '.join(str(error).split())}") from None


def _schema(file: h5py.File) -> str:
    value = file.attrs.get("schema", "")
    return value if isinstance(value, str) else ""


# --- datasets -------------------------------------------------------------------------------------------------------


def _put(group: h5py.Group, name: str, values: Any, units: str, long_name: str, frame: str, *dims: str) -> None:
    """A dataset that describes itself."""
    dataset = group.create_dataset(name, data=np.asarray(values))
    dataset.attrs["units"] = units
    dataset.attrs["long_name"] = long_name
    dataset.attrs["frame"] = frame
    for axis, label in enumerate(dims):
        dataset.dims[axis].label = label


def _put_text(group: h5py.Group, name: str, text: Any, long_name: str) -> None:
    """Text, or a list of texts, that describes itself."""
    dataset = group.create_dataset(name, data=text, dtype=h5py.string_dtype())
    dataset.attrs["units"] = ""
    dataset.attrs["long_name"] = long_name
    dataset.attrs["frame"] = ""
    if dataset.ndim:
        dataset.dims[0].label = "item"


def _read_number(group: h5py.Group, name: str) -> float:
    """A finite attribute. KeyError or ValueError otherwise."""
    value = float(group.attrs[name])
    if not np.isfinite(value):
        raise ValueError(f"{group.name}: {name} is not finite")
    return value


def _get(group: h5py.Group, name: str, *shape: int) -> Array:
    """A finite dataset of the given shape, -1 for any length. KeyError or ValueError otherwise."""
    values = group[name][()]
    array = readonly(values, shape)
    if not np.isfinite(array).all():
        raise ValueError(f"{group.name}/{name} holds a value that is not finite")
    return array


def _text(group: h5py.Group, name: str) -> str:
    return str(group[name].asstr()[()])


# --- robot ----------------------------------------------------------------------------------------------------------


def _write_robot(file: h5py.File, robot: Robot) -> None:
    group = file.create_group("robot")
    group.attrs["name"] = robot.name
    _put_text(group, "description", robot.source.toml_text, "text of robot.toml")
    _put_text(group, "urdf", robot.source.urdf_text, "text of the URDF")


def _robot(file: h5py.File) -> Robot:
    group = file["robot"]
    return Robot.from_source(parse_source(_text(group, "description"), _text(group, "urdf"), "robot"))


# --- set-up and geometry, in both kinds -----------------------------------------------------------------------------


def _write_setup(group: h5py.Group, setup: Setup) -> None:
    group.attrs["frame_known"] = setup.frame_known
    group.attrs["targets_known"] = setup.targets_known
    _put(
        group,
        "T_instrument_base",
        setup.T_instrument_base,
        "m",
        "pose of the robot base",
        "instrument",
        "row",
        "column",
    )
    _put(group, "targets", setup.targets, "m", "target points on the tool", "tool", "target", "axis")
    if setup.R_tool_sensor is not None:
        _put(group, "R_tool_sensor", setup.R_tool_sensor, "1", "orientation of the 6-D sensor", "tool", "row", "column")


def _setup(group: h5py.Group) -> Setup:
    return Setup(
        T_instrument_base=_get(group, "T_instrument_base", 4, 4),
        targets=_get(group, "targets", -1, 3),
        R_tool_sensor=_get(group, "R_tool_sensor", 3, 3) if "R_tool_sensor" in group else None,
        frame_known=bool(group.attrs["frame_known"]),
        targets_known=bool(group.attrs["targets_known"]),
    )


def _write_geometry(group: h5py.Group, geometry: GeometricErrors) -> None:
    _put(group, "placement_errors", geometry.placements, "m, rad", "δζ of M_j exp6(δζ_j)", "joint", "joint", "twist")
    _put(
        group,
        "twist_errors",
        geometry.twists,
        "per rad or m",
        "δξ of exp6((ξ_j + δξ_j) q_j)",
        "joint",
        "joint",
        "twist",
    )
    _put(group, "offset_errors", geometry.offsets, "rad or m", "δq added to the joint position", "joint", "joint")


def _geometry(group: h5py.Group, n: int) -> GeometricErrors:
    return GeometricErrors(
        placements=_get(group, "placement_errors", n + 1, 6),
        twists=_get(group, "twist_errors", n, 6),
        offsets=_get(group, "offset_errors", n),
    )


# --- measurements ---------------------------------------------------------------------------------------------------


def _write_measurements(file: h5py.File, measurements: Measurements) -> None:
    robot = measurements.robot
    group = file.create_group("measurements")
    group.attrs["kind"] = measurements.kind
    group.attrs["noise_position_m"] = measurements.noise_position
    group.attrs["noise_orientation_rad"] = measurements.noise_orientation
    units = ", ".join(robot.joint_units)
    _put(
        group, "joint_positions", measurements.q, units, "commanded joint positions", "joint", "configuration", "joint"
    )
    labels = ("configuration", "target", "axis")
    _put(group, "points", measurements.points, "m", "measured target points", "instrument", *labels)
    if measurements.rotations is not None:
        labels = ("configuration", "row", "column")
        _put(group, "rotations", measurements.rotations, "1", "measured sensor orientations", "instrument", *labels)
    _write_setup(file.create_group("registration"), measurements.setup)
    if measurements.truth is not None:
        actual = measurements.truth.actual
        truth = file.create_group("truth")
        _write_geometry(truth, actual.geometry)
        _put(
            truth,
            "gear",
            actual.gear,
            "rad",
            "sin q, cos q, sin 2q, cos 2q on the joint motion",
            "joint",
            "joint",
            "term",
        )
        _put(truth, "compliance", actual.compliance, "rad/(N m)", "wind-up per gravity torque", "joint", "joint")
        _put(truth, "backlash", actual.backlash, "rad or m", "half width", "joint", "joint")
        truth.attrs["expansion"] = actual.expansion
        _write_setup(truth.create_group("registration"), measurements.truth.setup)


def _measurements(file: h5py.File) -> Measurements:
    robot = _robot(file)
    group = file["measurements"]
    rotations = _get(group, "rotations", -1, 3, 3) if "rotations" in group else None
    truth = None
    if "truth" in file:
        stored = file["truth"]
        actual = ActualRobot(
            robot=robot,
            geometry=_geometry(stored, robot.n),
            gear=_get(stored, "gear", robot.n, 4),
            compliance=_get(stored, "compliance", robot.n),
            backlash=_get(stored, "backlash", robot.n),
            expansion=_read_number(stored, "expansion"),
        )
        truth = Truth(actual, _setup(stored["registration"]))
    return Measurements(
        robot=robot,
        q=_get(group, "joint_positions", -1, robot.n),
        points=_get(group, "points", -1, -1, 3),
        rotations=rotations,
        setup=_setup(file["registration"]),
        noise_position=_read_number(group, "noise_position_m"),
        noise_orientation=_read_number(group, "noise_orientation_rad"),
        truth=truth,
        provenance=_provenance(file),
    )


def _provenance(file: h5py.File) -> dict[str, str]:
    return {name: str(value) for name, value in file["provenance"].attrs.items()}


# --- calibration ----------------------------------------------------------------------------------------------------


def _write_calibration(file: h5py.File, calibration: Calibration) -> None:
    base = calibration.base
    model = file.create_group("model")
    model.attrs["name"] = base.model
    model.attrs["configurations"] = calibration.configurations
    model.attrs["noise_position_m"] = calibration.noise_position
    model.attrs["noise_orientation_rad"] = calibration.noise_orientation
    model.attrs["rank"] = base.rank
    model.attrs["observable_rank"] = base.observable_rank
    model.attrs["iterations"] = base.iterations
    model.attrs["residual_rms_position_m"] = base.residual_rms[0]
    if base.residual_rms[1] is not None:
        model.attrs["residual_rms_orientation_rad"] = base.residual_rms[1]
    _put_text(model, "unobservable", list(base.unobservable), "parameters or directions that were not determined")
    _write_geometry(model, base.geometry)
    _put(
        model,
        "singular_values",
        base.singular_values,
        "1/m, 1/rad",
        "of the weighted identification matrix",
        "",
        "index",
    )
    _write_setup(file.create_group("registration"), base.setup)
    _write_setup(file.create_group("registration_nominal"), calibration.nominal_setup)
    equivalent = file.create_group("equivalent")
    _put_text(
        equivalent, "virtual_joints", list(calibration.equivalent.virtual_joints), "elementary twists of the tool frame"
    )
    if calibration.network is not None:
        _write_network(file.create_group("network"), calibration.network, ", ".join(calibration.robot.joint_units))
    if calibration.training is not None:
        _write_training(file.create_group("training"), calibration.training)


def _write_network(group: h5py.Group, network: Network, units: str) -> None:
    _put(group, "input_centre", network.input_centre, units, "middle of the training range", "joint", "joint")
    _put(group, "input_scale", network.input_scale, units, "half of the training range", "joint", "joint")
    _put(group, "hidden_weights", network.hidden_weights, "1", "W1", "", "hidden", "joint")
    _put(group, "hidden_bias", network.hidden_bias, "1", "b1", "", "hidden")
    _put(group, "output_weights", network.output_weights, "1", "W2", "", "motion", "hidden")
    _put(group, "output_bias", network.output_bias, "1", "b2", "", "motion")
    _put(group, "output_scale", network.output_scale, "rad or m", "unit of each joint motion error", "joint", "motion")


def _write_training(group: h5py.Group, training: TrainingReport) -> None:
    history = training.history
    group.attrs["reason"] = history.reason
    group.attrs["chosen"] = history.chosen
    group.attrs["loss_without"] = training.loss_without
    group.attrs["loss"] = training.loss
    group.attrs["optimiser"] = training.optimiser
    group.attrs["hidden"] = training.hidden
    _put(group, "training_loss", history.training, training.loss_units, "loss on the training rows", "", "iteration")
    _put(
        group,
        "validation_loss",
        history.validation,
        training.loss_units,
        "loss on the validation rows",
        "",
        "iteration",
    )
    _put(
        group,
        "restart_losses",
        training.restart_losses,
        training.loss_units,
        "best loss of each restart",
        "",
        "restart",
    )
    _put(group, "training_rows", training.training_rows, "1", "configurations trained on", "", "row")
    _put(group, "validation_rows", training.validation_rows, "1", "configurations validated on", "", "row")


def _calibration(file: h5py.File) -> Calibration:
    robot = _robot(file)
    model = file["model"]
    orientation = model.attrs.get("residual_rms_orientation_rad")
    base = Identification(
        model=str(model.attrs["name"]),
        geometry=_geometry(model, robot.n),
        setup=_setup(file["registration"]),
        singular_values=_get(model, "singular_values", -1),
        rank=int(model.attrs["rank"]),
        observable_rank=int(model.attrs["observable_rank"]),
        unobservable=tuple(str(text) for text in model["unobservable"].asstr()[()]),
        residual_rms=(
            _read_number(model, "residual_rms_position_m"),
            None if orientation is None else float(orientation),
        ),
        iterations=int(model.attrs["iterations"]),
    )
    virtual = tuple(str(name) for name in file["equivalent"]["virtual_joints"].asstr()[()])
    if len(virtual) != max(6 - robot.n, 0) or not set(virtual) <= set(ELEMENTARY):
        raise ValueError(f"equivalent/virtual_joints {virtual} do not complete {robot.n} joints")
    equivalent = EquivalentRobot(robot.n, virtual)  # type: ignore[arg-type]
    return Calibration(
        robot=robot,
        base=base,
        equivalent=equivalent,
        network=_network(file["network"], robot.n, equivalent.p) if "network" in file else None,
        training=_training(file["training"]) if "training" in file else None,
        nominal_setup=_setup(file["registration_nominal"]),
        noise_position=_read_number(model, "noise_position_m"),
        noise_orientation=_read_number(model, "noise_orientation_rad"),
        configurations=int(model.attrs["configurations"]),
        provenance=_provenance(file),
    )


def _network(group: h5py.Group, n: int, p: int) -> Network:
    hidden = len(group["hidden_bias"])
    return Network(
        input_centre=_get(group, "input_centre", n),
        input_scale=_get(group, "input_scale", n),
        hidden_weights=_get(group, "hidden_weights", hidden, n),
        hidden_bias=_get(group, "hidden_bias", hidden),
        output_weights=_get(group, "output_weights", p, hidden),
        output_bias=_get(group, "output_bias", p),
        output_scale=_get(group, "output_scale", p),
    )


def _training(group: h5py.Group) -> TrainingReport:
    history = History(
        training=_get(group, "training_loss", -1),
        validation=readonly(group["validation_loss"][()], (-1,)),  # NaN without validation rows
        chosen=int(group.attrs["chosen"]),
        reason=str(group.attrs["reason"]),
    )
    return TrainingReport(
        history=history,
        training_rows=group["training_rows"][()],
        validation_rows=group["validation_rows"][()],
        restart_losses=_get(group, "restart_losses", -1),
        loss_without=_read_number(group, "loss_without"),
        loss=str(group.attrs["loss"]),  # type: ignore[arg-type]
        optimiser=str(group.attrs["optimiser"]),  # type: ignore[arg-type]
        hidden=int(group.attrs["hidden"]),
    )
