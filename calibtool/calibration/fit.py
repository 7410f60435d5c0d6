"""From measurements to a calibration: identify a base model, train networks on what it leaves over."""

from dataclasses import dataclass, field, replace

import numpy as np

from calibtool.calibration.cross_validation import cross_validate
from calibtool.calibration.model import Calibration, check_same_robot, fitting_setup
from calibtool.equivalent.joints import equivalent_robot
from calibtool.equivalent.regressor import Regressor
from calibtool.equivalent.training import TrainingOptions, TrainingReport, train_networks
from calibtool.errors import check_choice
from calibtool.identification.complete import CompleteOptions, identify_complete
from calibtool.identification.local_poe import identify_local_poe
from calibtool.identification.model import nominal_model
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import linearised
from calibtool.progress import Progress, silent

IDENTIFIED_MODELS = ("local-poe", "complete")
BASE_MODELS = ("nominal", *IDENTIFIED_MODELS)


@dataclass(frozen=True)
class BaseOptions:
    """Which base model, and how it is identified: `nominal`, `local-poe` or `complete`."""

    model: str = "complete"
    complete: CompleteOptions = field(default_factory=CompleteOptions)

    def __post_init__(self) -> None:
        check_choice(self.model, BASE_MODELS, "base model")


def identify(measurements: Measurements, base: BaseOptions | str = "complete") -> Calibration:
    """A calibration that is a base model alone: `complete`, `local-poe` (Eqs. 8–11) or `nominal`.

    Raises NoSolutionError when the configurations are too few for the model or the iteration does not settle, UsageError
    for an unknown model.
    """
    options = BaseOptions(base) if isinstance(base, str) else base
    if options.model == "complete":
        identification = identify_complete(measurements, options.complete)
    elif options.model == "local-poe":
        identification = identify_local_poe(measurements)
    else:
        identification = nominal_model(measurements)
    return Calibration(
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
    )


def train(
    measurements: Measurements,
    base: Calibration | BaseOptions | str = "complete",
    options: TrainingOptions | None = None,
    progress: Progress = silent,
) -> Calibration:
    """Train networks on what `base` leaves over: a model to identify, or an identified calibration used as it is.

    Without options: early stopping on `nominal` (the paper), Bayesian regularisation on everything else.

    With Bayesian regularisation the networks are kept only if cross-validation, which identifies the base again in every
    fold, says that they help. With early stopping (the paper) the validation part decides; the base model is identified
    from all configurations either way.

    Raises InputError when `base` is a calibration of another robot, NoSolutionError where `identify` does.
    """
    if isinstance(base, Calibration):
        check_same_robot(base.robot, measurements.robot, "the base calibration", "the measurements")
    if options is None:
        options = TrainingOptions(regularisation="early-stopping" if base == "nominal" else "bayes")
    rng = np.random.default_rng(options.seed)
    fitted = on_base(measurements, base, options, rng, progress)
    if options.regularisation != "bayes":
        return fitted
    validation = cross_validate(
        measurements, lambda rows, stream: on_base(rows, base, options, stream), options.folds, rng, progress
    )
    return replace(fitted, validation=validation, networks=fitted.networks if validation.helps else ())


def on_base(
    measurements: Measurements,
    base: Calibration | BaseOptions | str,
    options: TrainingOptions,
    rng: np.random.Generator,
    progress: Progress = silent,
) -> Calibration:
    """Base model and networks from these rows, without a verdict on the networks."""
    calibration = base if isinstance(base, Calibration) else identify(measurements, base)
    networks, report = _networks(measurements, calibration, options, rng, progress)
    return replace(
        calibration,
        networks=networks,
        training=report,
        nominal_setup=measurements.setup,
        noise_position=measurements.noise_position,
        noise_orientation=measurements.noise_orientation,
        q=measurements.q,
    )


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
