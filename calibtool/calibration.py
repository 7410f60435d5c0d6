"""Calibration: an identified base model, a network on top of it, and what the two predict."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from calibtool.equivalent.joints import EquivalentRobot, equivalent_robot
from calibtool.equivalent.network import Network
from calibtool.equivalent.training import TrainingOptions, TrainingReport, split_rows, train_network
from calibtool.errors import InputError
from calibtool.identification.local_poe import Identification, identify_local_poe, nominal_model
from calibtool.measurement.measurements import Measurements, Setup
from calibtool.measurement.observation import observation_matrix, residuals, weights
from calibtool.robot.geometry import mechanism
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array, exp6

IDENTIFIED_MODELS = ("local-poe",)
BASE_MODELS = ("nominal", *IDENTIFIED_MODELS)


@dataclass(frozen=True, eq=False)
class Calibration:
    """T_calibrated(q) = exp6(J_ρ(q) N(q)) · T_base-model(q), N = 0 without a network.

    base            identified base model, with the set-up fitted in it
    network         None when a base model stands alone or the network did not help
    training        how the network came about; None when a base model stands alone
    nominal_setup   the set-up as it was known, or registered with the nominal robot
    noise_position, noise_orientation   stated noise of the measurements used, m and rad
    configurations  how many were used
    """

    robot: Robot
    base: Identification
    equivalent: EquivalentRobot
    network: Network | None
    training: TrainingReport | None
    nominal_setup: Setup
    noise_position: float
    noise_orientation: float
    configurations: int
    provenance: dict[str, str] = field(default_factory=dict)

    @cached_property
    def base_mechanism(self) -> Mechanism:
        """Pinocchio mechanism of the base model."""
        return mechanism(self.robot.chain, self.base.geometry)

    def forward(self, q: Array) -> Array:
        """Calibrated T_base_tool for joint positions q (N, n): (N, 4, 4) in K_0."""
        if self.network is None:
            return self.base_mechanism.forward(q)
        return self.forward_and_jacobian(q)[0]

    def forward_and_jacobian(self, q: Array) -> tuple[Array, Array]:
        """Calibrated T_base_tool (N, 4, 4) and the base model's J_ρ (N, 6, p).

        ∂N/∂q, about a thousandth of J_ρ, is left out: Newton's method converges by as much at every step all the same.
        """
        pose, jacobian = self.equivalent.forward_and_jacobian(self.base_mechanism, q)
        if self.network is not None:
            pose = exp6((jacobian @ self.network(q)[..., None])[..., 0]) @ pose
        return pose, jacobian


def identify(measurements: Measurements, model: str) -> Calibration:
    """A calibration that is a base model alone, `nominal` or `local-poe`."""
    base = identify_local_poe(measurements) if model == "local-poe" else nominal_model(measurements)
    return _calibration(measurements, base)


def train(measurements: Measurements, base: Calibration | str, options: TrainingOptions) -> Calibration:
    """Train the network on what `base` leaves over: a model's name, or an identified calibration used as it is.

    The base model is identified from all configurations; the validation part only decides when the training stops,
    which restart is kept, and whether the network is used at all.
    """
    if isinstance(base, str):
        base = identify(measurements, base)
    else:
        check_same_robot(base.robot, measurements.robot, "the base calibration", "the measurements")
    q = measurements.q
    setup = fitting_setup(base, measurements)
    pose, jacobian = base.equivalent.forward_and_jacobian(base.base_mechanism, q)
    weight = weights(measurements)
    G = observation_matrix(setup, pose) @ jacobian * weight[:, None]
    y = residuals(measurements, setup, pose) * weight
    rng = np.random.default_rng(options.seed)
    rows = split_rows(len(q), options.validation, rng)
    network, report = train_network(q, G, y, *rows, options, rng)
    return _calibration(measurements, base.base, base.equivalent, network, report)


def fitting_setup(calibration: Calibration, measurements: Measurements) -> Setup:
    """The set-up in which a calibration predicts these measurements: theirs if known, else the calibration's own.

    Raises InputError when the calibration's targets cannot be those of the measurements.
    """
    if measurements.setup.known:
        return measurements.setup
    setup, other = calibration.base.setup, measurements.setup
    if len(setup.targets) != len(other.targets) or (setup.R_tool_sensor is None) != (other.R_tool_sensor is None):
        raise InputError(
            "the calibration was made with other targets than these measurements; evaluate with --refit-setup"
        )
    return setup


def check_same_robot(a: Robot, b: Robot, place_a: str, place_b: str) -> None:
    """InputError unless two descriptions have the same kinematics."""
    same = (
        a.n == b.n
        and np.allclose(a.chain.placements, b.chain.placements, atol=1e-9)
        and np.allclose(a.chain.twists, b.chain.twists, atol=1e-9)
    )
    if not same:
        raise InputError(f"{place_a} is for '{a.name}', but {place_b} for '{b.name}': the kinematics differ")


def _calibration(
    measurements: Measurements,
    base: Identification,
    equivalent: EquivalentRobot | None = None,
    network: Network | None = None,
    report: TrainingReport | None = None,
) -> Calibration:
    return Calibration(
        robot=measurements.robot,
        base=base,
        equivalent=equivalent_robot(measurements.robot) if equivalent is None else equivalent,
        network=network,
        training=report,
        nominal_setup=measurements.setup,
        noise_position=measurements.noise_position,
        noise_orientation=measurements.noise_orientation,
        configurations=len(measurements),
    )
