"""A calibration as HDF5 groups."""

from dataclasses import replace
from typing import cast, get_args

import h5py
import numpy as np

from calibtool.calibration.calibration import Calibration, CrossValidation
from calibtool.calibration.fit import BASE_MODELS
from calibtool.calibration.frame import FRAMES, ChosenFrame
from calibtool.equivalent.joints import ELEMENTARY, EquivalentRobot
from calibtool.equivalent.optimisers import History, Optimiser
from calibtool.equivalent.regressor import Regressor
from calibtool.equivalent.regressors import REGRESSORS
from calibtool.equivalent.training import LossName, Regularisation, TrainingReport
from calibtool.errormodel.families import FAMILIES
from calibtool.identification.identification import Flagged, Identification, Posterior
from calibtool.identification.parameters import Parameters, Part
from calibtool.measurement.measurements import SMALLEST_NOISE
from calibtool.measurement.setup import Setup
from calibtool.robot.description import VirtualJoint
from calibtool.robot.robot import Robot
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
    get_covariance,
    get_frames,
    get_indices,
    get_positive,
    get_with_gaps,
    put,
    read_count,
    read_number,
)
from calibtool.storage.texts import choice, put_string, put_text, string, texts

# Inputs are divided by the first, outputs multiplied by the second
_SCALES = ("input_scale", "output_scale")

_HELD_OUT = "held_out_rms_"  # followed by the name of a model


def write_calibration(file: h5py.File, calibration: Calibration) -> None:
    """Groups of a calibration, in a fixed order."""
    robot, base = calibration.robot, calibration.base
    model = file.create_group("model")
    put_string(model, "name", base.model)
    model.attrs["simulated"] = calibration.simulated
    model.attrs["noise_position_m"] = calibration.noise_position
    model.attrs["noise_orientation_rad"] = calibration.noise_orientation
    model.attrs["rank"] = base.rank
    model.attrs["observable_rank"] = base.observable_rank
    model.attrs["iterations"] = base.iterations
    model.attrs["residual_rms_position_m"] = base.residual_rms[0]
    if base.residual_rms[1] is not None:
        model.attrs["residual_rms_orientation_rad"] = base.residual_rms[1]
    for name, value in base.held_out.items():
        model.attrs[f"{_HELD_OUT}{name}"] = value
    put_text(
        model,
        "unobservable",
        list(base.unobservable),
        "parameters or directions that were not determined",
    )
    units, labels = ", ".join(robot.joint_units), ("configuration", "joint")
    put(model, "joint_positions", calibration.q, units, "configurations used", "joint", *labels)
    write_errors(model.create_group("errors"), base.errors)
    write_conditions(model.create_group("conditions"), calibration.conditions)
    words = "of the weighted identification matrix"
    put(model, "singular_values", base.singular_values, "1/m, 1/rad", words, "", "index")
    if base.posterior is not None:
        _write_posterior(model.create_group("posterior"), base.posterior)
    if base.flagged is not None:
        _write_flagged(model.create_group("flagged"), base.flagged)
    write_setup(file.create_group("registration"), base.setup)
    write_setup(file.create_group("registration_nominal"), calibration.nominal_setup)
    if calibration.frame is not None:
        _write_frame(file.create_group("frame"), calibration.frame)
    equivalent = file.create_group("equivalent")
    virtual = list(calibration.equivalent.virtual_joints)
    put_text(equivalent, "virtual_joints", virtual, "elementary twists of the tool frame")
    for i, network in enumerate(calibration.networks):
        _write_network(file.create_group(f"networks/{i}"), network, units)
    if calibration.training is not None:
        _write_training(file.create_group("training"), calibration.training)
    if calibration.validation is not None:
        group = file.create_group("cross_validation")
        for name in ("folds", "gain", "standard_error"):
            group.attrs[name] = getattr(calibration.validation, name)


def _write_frame(group: h5py.Group, frame: ChosenFrame) -> None:
    put_string(group, "name", frame.name)
    for name, words, seen_from in (
        ("T_taught_fitted", "base of the fit", "taught base"),
        ("T_tool_taught", "taught tool frame", "tool of the fit"),
    ):
        put(group, name, getattr(frame, name), "m", words, seen_from, "row", "column")


def _write_posterior(group: h5py.Group, posterior: Posterior) -> None:
    parameters = posterior.parameters
    for part in parameters.parts:
        group.attrs[f"order_{part.family.id}"] = part.family.order(part.shape)
        elements = "elements of its value that are parameters, from 0"
        put(group, f"elements_{part.family.id}", part.elements, "1", elements, "", "parameter")
    for name in ("noise_factor", "effective", "log_evidence"):
        group.attrs[name] = getattr(posterior, name)
    words = "standard deviation of residuals over the stated noise: lengths, angles"
    put(group, "residual_factors", posterior.residual_factors, "1", words, "", "kind")
    put_text(group, "names", parameters.names, "parameter names")
    for name, words, *labels in (
        ("left_out", "variance added for what the model leaves out", "parameter"),
        ("prior_std", "tolerance as used", "parameter"),
        ("covariance", "of the estimate", "parameter", "parameter"),
    ):
        put(group, name, getattr(posterior, name), "SI", words, "", *labels)


def _write_flagged(group: h5py.Group, flagged: Flagged) -> None:
    put_string(group, "cluster", flagged.cluster or "")
    group.attrs["dropped"] = flagged.dropped
    put(group, "rows", flagged.rows, "1", "configurations that do not fit, from 0", "", "row")
    words = "residual in standard deviations per coordinate"
    put(group, "size", flagged.deviation, "1", words, "", "row")
    put(group, "position", flagged.position, "m", "residual over the target points", "base", "row")


def _write_network(group: h5py.Group, network: Regressor, units: str) -> None:
    put_string(group, "kind", network.id)
    for name, (unit, words, dimensions) in network.fields.items():
        unit = {"q": units, "rho": "rad or m"}.get(unit, unit)
        frame = "joint" if set(dimensions) <= {"joint", "motion"} else ""
        put(group, name, getattr(network, name), unit, words, frame, *dimensions)


def _write_training(group: h5py.Group, training: TrainingReport) -> None:
    history = training.history
    put_string(group, "reason", history.reason)
    group.attrs["chosen"] = history.chosen
    group.attrs["loss_without"] = training.loss_without
    put_string(group, "regressor", training.regressor)
    put_string(group, "loss", training.loss)
    put_string(group, "optimiser", training.optimiser)
    put_string(group, "regularisation", training.regularisation)
    group.attrs["effective"] = training.effective
    group.attrs["hidden"] = training.hidden
    units = training.loss_units
    for name, values, unit, words, label in (
        ("training_loss", history.training, units, "loss on the training rows", "iteration"),
        ("validation_loss", history.validation, units, "loss on the validation rows", "iteration"),
        ("restart_losses", training.restart_losses, units, "best loss of each restart", "restart"),
        ("training_rows", training.training_rows, "1", "configurations trained on", "row"),
        ("validation_rows", training.validation_rows, "1", "configurations validated on", "row"),
    ):
        put(group, name, values, unit, words, "", label)


def build_calibration(file: h5py.File) -> Calibration:
    """The calibration of an open file. KeyError or ValueError for a damaged one."""
    robot = read_robot(file)
    model = file["model"]
    setup = read_setup(file["registration"])
    q = get(model, "joint_positions", -1, robot.n)
    conditions = read_conditions(model["conditions"], robot.n)
    conditions.check(q.shape, "model/conditions")
    if not len(q):
        raise ValueError("model/joint_positions holds no configuration")
    orientation = "residual_rms_orientation_rad"
    base = Identification(
        model=choice(model, "name", BASE_MODELS),
        errors=read_errors(model["errors"], robot),
        setup=setup,
        singular_values=get(model, "singular_values", -1, below=np.inf),
        rank=read_count(model, "rank"),
        observable_rank=read_count(model, "observable_rank"),
        unobservable=texts(model, "unobservable"),
        residual_rms=(
            read_number(model, "residual_rms_position_m", 0.0),
            read_number(model, orientation, 0.0) if orientation in model.attrs else None,
        ),
        iterations=read_count(model, "iterations"),
        posterior=_posterior(model["posterior"], robot, setup) if "posterior" in model else None,
        flagged=_flagged(model["flagged"], len(q)) if "flagged" in model else None,
        held_out={
            name.removeprefix(_HELD_OUT): read_number(model, name, 0.0, np.inf)
            for name in model.attrs
            if name.startswith(_HELD_OUT)
        },
    )
    virtual = texts(file["equivalent"], "virtual_joints")
    if len(virtual) != max(6 - robot.n, 0) or not set(virtual) <= set(ELEMENTARY):
        raise ValueError(f"equivalent/virtual_joints {virtual} do not complete {robot.n} joints")
    names = cast(tuple[VirtualJoint, ...], virtual)
    equivalent = EquivalentRobot(robot.n, names, robot.chain.tree is not None)
    networks = file.get("networks", {})
    return Calibration(
        robot=robot,
        base=base,
        equivalent=equivalent,
        networks=tuple(
            _network(networks[str(i)], robot.n, equivalent.p) for i in range(len(networks))
        ),
        training=_training(file["training"], len(q)) if "training" in file else None,
        validation=_validation(file["cross_validation"]) if "cross_validation" in file else None,
        nominal_setup=read_setup(file["registration_nominal"]),
        noise_position=read_number(model, "noise_position_m", SMALLEST_NOISE),
        noise_orientation=read_number(model, "noise_orientation_rad", SMALLEST_NOISE),
        q=q,
        conditions=conditions,
        provenance=read_provenance(file),
        simulated=bool(model.attrs.get("simulated", False)),
        frame=_frame(file["frame"]) if "frame" in file else None,
    )


def _frame(group: h5py.Group) -> ChosenFrame:
    name = choice(group, "name", FRAMES)
    base, tool = (get_frames(group, pose, 4, 4) for pose in ("T_taught_fitted", "T_tool_taught"))
    return ChosenFrame(name, base, tool)  # type: ignore[arg-type]


def _posterior(group: h5py.Group, robot: Robot, setup: Setup) -> Posterior:
    parts = []
    for family in FAMILIES:
        if f"order_{family.id}" in group.attrs:
            shape = family.shape(family.joints(robot), int(group.attrs[f"order_{family.id}"]))
            elements = get_indices(group, f"elements_{family.id}")
            if not np.array_equal(np.unique(elements), elements) or not (
                0 <= elements.min() <= elements.max() < np.prod(shape)
            ):
                raise ValueError(
                    f"{group.name}: elements_{family.id} are not those of a value of shape {shape}"
                )
            parts.append(Part(family, shape, elements))
    parameters = replace(Parameters.of(robot, setup), parts=tuple(parts))
    p = parameters.count
    return Posterior(
        parameters=parameters,
        prior_std=get_positive(group, "prior_std", p),
        covariance=get_covariance(group, "covariance", p),
        noise_factor=read_number(group, "noise_factor", 0.0),
        effective=read_number(group, "effective"),
        log_evidence=read_number(group, "log_evidence"),
        residual_factors=get(group, "residual_factors", 2),
        left_out=get(group, "left_out", p),
    )


def _validation(group: h5py.Group) -> CrossValidation:
    return CrossValidation(
        read_count(group, "folds"), read_number(group, "gain"), read_number(group, "standard_error")
    )


def _flagged(group: h5py.Group, count: int) -> Flagged:
    return Flagged(
        rows=get_indices(group, "rows", count),
        deviation=get(group, "size", -1),
        position=get(group, "position", -1),
        cluster=string(group, "cluster") or None,
        dropped=bool(group.attrs["dropped"]),
    )


def _network(group: h5py.Group, n: int, p: int) -> Regressor:
    kind = REGRESSORS[choice(group, "kind", REGRESSORS)]
    sizes = {"joint": n, "motion": p, "hidden": group["output_weights"].shape[1]}
    shapes = {
        name: [sizes[dimension] for dimension in dimensions]
        for name, (_, _, dimensions) in kind.fields.items()
    }
    return kind(
        **{
            name: (get_positive if name in _SCALES else get)(group, name, *shape)
            for name, shape in shapes.items()
        }
    )


def _training(group: h5py.Group, count: int) -> TrainingReport:
    history = History(
        training=get(group, "training_loss", -1),
        validation=get_with_gaps(group, "validation_loss", -1),  # NaN without validation rows
        chosen=read_count(group, "chosen"),
        reason=string(group, "reason"),
    )
    return TrainingReport(
        history=history,
        training_rows=get_indices(group, "training_rows", count),
        validation_rows=get_indices(group, "validation_rows", count),
        restart_losses=get(group, "restart_losses", -1),
        loss_without=read_number(group, "loss_without"),
        regressor=choice(group, "regressor", REGRESSORS),
        loss=choice(group, "loss", get_args(LossName)),  # type: ignore[arg-type]
        optimiser=choice(group, "optimiser", get_args(Optimiser)),  # type: ignore[arg-type]
        regularisation=choice(group, "regularisation", get_args(Regularisation)),  # type: ignore[arg-type]
        effective=read_number(group, "effective"),
        hidden=read_count(group, "hidden"),
    )
