"""From measurements to a calibration: identify a base model, train networks on its residuals."""

from dataclasses import dataclass, field, replace

import numpy as np

from calibtool.calibration.calibration import Calibration, check_same_robot, fitting_setup
from calibtool.calibration.cross_validation import cross_validate
from calibtool.calibration.frame import FRAMES, FrameName
from calibtool.equivalent.joints import equivalent_robot
from calibtool.equivalent.regressor import Regressor
from calibtool.equivalent.training import TrainingOptions, TrainingReport, train_networks
from calibtool.errors import NoSolutionError, check_choice
from calibtool.identification.complete import CompleteOptions, identify_complete
from calibtool.identification.identification import nominal_model
from calibtool.identification.local_poe import identify_local_poe
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import linearised
from calibtool.progress import Progress, silent

IDENTIFIED_MODELS = ("local-poe", "complete")
BASE_MODELS = ("nominal", *IDENTIFIED_MODELS)


@dataclass(frozen=True)
class BaseOptions:
    """Base model (`nominal`, `local-poe` or `complete`) and the options of its identification."""

    model: str = "complete"
    complete: CompleteOptions = field(default_factory=CompleteOptions)

    def __post_init__(self) -> None:
        check_choice(self.model, BASE_MODELS, "base model")


def identify(
    measurements: Measurements, base: BaseOptions | str = "complete", frame: FrameName = "taught"
) -> Calibration:
    """Identify a base model without networks: `complete`, `local-poe` (Eqs. 8–11) or `nominal`.

    frame: base and tool frame where the set-up is unknown, see `Calibration.in_frame`. Raises
    NoSolutionError when there are too few configurations for the model or the iteration does not
    converge, UsageError for an unknown model or frame.
    """
    check_choice(frame, FRAMES, "frame")
    options = BaseOptions(base) if isinstance(base, str) else base
    if options.model == "complete":
        identification = identify_complete(measurements, options.complete)
    elif options.model == "local-poe":
        identification = identify_local_poe(measurements)
    else:
        identification = nominal_model(measurements)
    fitted = Calibration(
        robot=measurements.robot,
        base=identification,
        equivalent=equivalent_robot(measurements.robot),
        networks=(),
        training=None,
        validation=None,
        nominal_setup=measurements.setup,
        noise_position=measurements.noise_position,
        noise_orientation=measurements.noise_orientation,
        q=measurements.q,
        simulated=measurements.truth is not None,
    )
    return fitted.in_frame(frame)


def train(
    measurements: Measurements,
    base: Calibration | BaseOptions | str = "complete",
    options: TrainingOptions | None = None,
    progress: Progress = silent,
    frame: FrameName | None = None,
) -> Calibration:
    """Train networks on the residuals of a base model.

    base: a model to identify first, or an identified calibration, which is used unchanged. frame:
    as for `identify`; by default that of the base calibration, or `taught`.

    Unless the options say otherwise, the regularisation is early stopping on `nominal` (the
    published method) and Bayesian on every other base. With Bayesian regularisation the networks
    are kept only if cross-validation, in which the base model is identified again in every fold,
    shows that they reduce the error; where the configurations are too few to leave some out, they
    are not used, and `validation` is None. With early stopping the validation part decides. The
    base model is identified from all configurations.

    Raises InputError when `base` is a calibration of another robot, NoSolutionError where
    `identify` does.
    """
    if isinstance(base, Calibration):
        check_same_robot(base.robot, measurements.robot, "the base calibration", "the measurements")
        base = base if frame is None else replace(base, networks=()).in_frame(frame)
    options = options or TrainingOptions()
    chosen: FrameName = frame or "taught"
    check_choice(chosen, FRAMES, "frame")
    rng = np.random.default_rng(options.seed)
    identified = base if isinstance(base, Calibration) else identify(measurements, base, chosen)
    fitted = _candidates(measurements, identified, options, rng, progress)
    if fitted[0].training is None or fitted[0].training.regularisation != "bayes":
        return fitted[0]

    same = base if isinstance(base, Calibration) else _same(identified.base.model, base)

    def again(rows: Measurements, stream: np.random.Generator) -> list[Calibration]:
        own = same if isinstance(same, Calibration) else identify(rows, same, chosen)
        return [on_base(rows, own, each, stream) for each in kinds]

    kinds = [
        replace(options, regressor=each.training.regressor) for each in fitted if each.training
    ]
    try:
        validations = cross_validate(measurements, again, options.folds, rng, progress)
    except NoSolutionError:  # too few rows to leave some out
        return replace(fitted[0], networks=())
    best, validation = max(zip(fitted, validations, strict=True), key=lambda pair: pair[1].gain)
    return replace(best, validation=validation, networks=best.networks if validation.helps else ())


def _candidates(
    measurements: Measurements,
    identified: Calibration,
    options: TrainingOptions,
    rng: np.random.Generator,
    progress: Progress,
) -> list[Calibration]:
    """A calibration with each of the learned models that may be used, the network first.

    One that learned nothing from all rows is no candidate beside another.
    """
    kinds = options.resolved(_requested_model(identified)).candidates
    fitted = [on_base(measurements, identified, each, rng, progress) for each in kinds]
    return [fitted[0], *(each for each in fitted[1:] if each.networks)]


def _same(model: str, base: BaseOptions | str) -> BaseOptions:
    """Options that fit some of the rows by the model that was chosen for all rows."""
    options = BaseOptions(base) if isinstance(base, str) else base
    return replace(options, model=model, complete=replace(options.complete, compared=False))


def on_base(
    measurements: Measurements,
    base: Calibration | BaseOptions | str,
    options: TrainingOptions,
    rng: np.random.Generator,
    progress: Progress = silent,
) -> Calibration:
    """Base model and networks from these rows, without deciding whether the networks are used."""
    calibration = base if isinstance(base, Calibration) else identify(measurements, base)
    resolved = options.resolved(_requested_model(calibration)).candidates[0]
    networks, report = _networks(measurements, calibration, resolved, rng, progress)
    return replace(
        calibration,
        networks=networks,
        training=report,
        nominal_setup=measurements.setup,
        noise_position=measurements.noise_position,
        noise_orientation=measurements.noise_orientation,
        q=measurements.q,
        simulated=measurements.truth is not None,
    )


def _requested_model(base: Calibration) -> str:
    """The base model that was requested."""
    return "complete" if base.base.held_out else base.base.model


def _networks(
    measurements: Measurements,
    base: Calibration,
    options: TrainingOptions,
    rng: np.random.Generator,
    progress: Progress,
) -> tuple[tuple[Regressor, ...], TrainingReport]:
    setup = fitting_setup(base, measurements)
    pose, jacobian = base.base_forward_and_jacobian(measurements.q, measurements.conditions)
    G, y = linearised(measurements, setup, pose, jacobian, targets=False)
    return train_networks(measurements.q, G, y, options, rng, progress)
