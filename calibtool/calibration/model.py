"""Calibration: what it predicts."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
import pinocchio as pin

from calibtool.calibration.frame import ChosenFrame, FrameName, taught_frame
from calibtool.equivalent.joints import EquivalentRobot
from calibtool.equivalent.regressor import Regressor
from calibtool.equivalent.training import TrainingReport
from calibtool.errormodel.conditions import Conditions
from calibtool.errormodel.family import Context
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import InputError
from calibtool.identification.model import Identification
from calibtool.measurement.measurements import Measurements, Setup
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array, exp6


@dataclass(frozen=True)
class CrossValidation:
    """What the networks gain on configurations that neither they nor their base have seen.

    folds           parts into which the configurations were split
    gain            reduction of the mean weighted squared error by the networks, in percent of the base alone
    standard_error  of the gain, from the differences of single configurations
    """

    folds: int
    gain: float
    standard_error: float

    @property
    def helps(self) -> bool:
        """The gain is more than chance would give."""
        return self.gain > 2.0 * self.standard_error

    def __str__(self) -> str:
        """Gain and standard error in percent, with one decimal, or two where the error is small."""
        decimals = 2 if 0.005 <= self.standard_error < 0.1 else 1
        return f"{round(self.gain, decimals) + 0.0:+.{decimals}f} ± {self.standard_error:.{decimals}f} %"


@dataclass(frozen=True, eq=False)
class Calibration:
    """T_calibrated(q) = exp6(J_ρ(q) N(q)) · T_base-model(q), N = 0 without a network.

    base            identified base model, with the set-up fitted in it, both in the frames of the fit
    equivalent      the equivalent robot, whose Jacobian is J_ρ
    networks        members whose mean is N; none when a base model stands alone or networks do not help
    training        how the networks came about; None when a base model stands alone
    validation      what they gain in cross-validation; None where that was not asked
    nominal_setup   the set-up as it was known, or registered with the nominal robot
    noise_position, noise_orientation   stated noise of the measurements used, m and rad
    q               (N, n) the configurations used, rad or m
    conditions      under which it predicts where a row does not say otherwise: payload and temperature as numbers
    simulated       the measurements came from a simulation, whose controller has the nominal model
    provenance      command line, seed, input checksums, versions: text by name
    frame           which base and tool frame it speaks in; None where nothing was free to choose

    `errors`, `setup` and every pose are in the chosen frames; only the parameters of `base` are those of the fit.
    """

    robot: Robot
    base: Identification
    equivalent: EquivalentRobot
    networks: tuple[Regressor, ...]
    training: TrainingReport | None
    validation: CrossValidation | None
    nominal_setup: Setup
    noise_position: float
    noise_orientation: float
    q: Array
    conditions: Conditions = field(default_factory=Conditions)
    provenance: dict[str, str] = field(default_factory=dict)
    simulated: bool = False
    frame: ChosenFrame | None = None

    @property
    def configurations(self) -> int:
        """How many configurations were used."""
        return len(self.q)

    @cached_property
    def network(self) -> Regressor | None:
        """The mean of the members as one learned model, None without any."""
        return self.networks[0].averaged(self.networks) if self.networks else None

    def at(self, conditions: Conditions) -> Self:
        """The same calibration for a payload and a temperature: those of its rows unless they say otherwise."""
        return replace(self, conditions=conditions)

    @cached_property
    def errors(self) -> RobotErrors:
        """Errors of the base model, in the chosen frames."""
        fitted = self.base.errors
        return fitted if self.frame is None else self.frame.errors(fitted)

    @cached_property
    def setup(self) -> Setup:
        """The set-up that belongs to `forward`, in the chosen frames."""
        fitted = self.base.setup
        return fitted if self.frame is None else self.frame.setup(fitted)

    @property
    def base_mechanism(self) -> Mechanism:
        """Mechanism of `errors`, without what changes from row to row."""
        return self.errors.mechanism

    @property
    def frame_is_free(self) -> bool:
        """There is a choice: the set-up is unknown, and the base model is not the drawing itself."""
        return not self.base.setup.known and self.base.model != "nominal"

    def in_frame(self, name: FrameName) -> Self:
        """The same calibration in the frames of the fit, or in those that move taught poses least.

        Itself where nothing is free. Raises InputError for networks with virtual joints, which are
        fixed in the tool frame of the training.
        """
        if not self.frame_is_free or (self.frame is not None and self.frame.name == name):
            return self
        if self.networks and self.equivalent.virtual_joints:
            raise InputError(
                f"{self.robot.name}: the network's virtual joints are fixed in the tool frame it "
                f"was trained in; train again with --frame {name}"
            )
        frame = self.frame
        if frame is None:
            frame = taught_frame(
                self.base.errors.forward(self.q),
                self.robot.mechanism.forward(self.q),
                self.base.setup,
                self.noise_position,
                self.noise_orientation,
            )
        return replace(self, frame=replace(frame, name=name))

    @property
    def model(self) -> pin.Model:
        """The identified geometry as a Pinocchio model of its own, limits included; its tool frame is the last frame.

        `base_mechanism.configuration` turns joint positions into its coordinates. `beyond_model` says what it cannot hold.
        """
        return self.base_mechanism.as_model(self.robot.lower, self.robot.upper)

    @property
    def beyond_model(self) -> tuple[str, ...]:
        """The parts of this calibration that `model` does not hold, in words; none when it is all there is."""
        parts = [family.words for family in self.base.errors.beyond_geometry]
        return (*parts, *(["network"] if self.networks else []))

    def base_forward_and_jacobian(
        self, q: Array, conditions: Conditions | None = None
    ) -> tuple[Array, Array]:
        """T_base_tool (N, 4, 4) and J_ρ (N, 6, p) of the base model for q (N, n); conditions as in `forward`.

        The slope of the joint-motion functions, about a thousandth, is left out of J_ρ.
        """
        return self.equivalent.forward_and_jacobian(
            *self.errors.at(q, conditions or self.conditions)
        )

    def closes(self, q: Array) -> np.ndarray:
        """Which rows of q (N, n) the nominal and the calibrated robot can stand at: (N,) bool; all without closed loops."""
        if self.robot.chain.tree is None:
            return np.ones(len(q), dtype=bool)
        closed: np.ndarray = self.robot.mechanism.closes(q) & np.isfinite(self.forward(q)[:, 0, 0])
        return closed

    def base_context(self, q: Array) -> Context:
        """Frames of the base model for joint positions q (N, n), from which error columns are built."""
        return self.errors.context(q, self.conditions)

    def forward(self, q: Array, conditions: Conditions | None = None) -> Array:
        """Calibrated T_base_tool for joint positions q (N, n): (N, 4, 4) in K_0.

        conditions of the rows; without, the calibration's own, and every joint in the middle of its backlash.
        """
        if self.network is None:
            return self.errors.forward(q, conditions or self.conditions)
        return self.forward_and_jacobian(q, conditions)[0]

    def forward_and_jacobian(
        self, q: Array, conditions: Conditions | None = None
    ) -> tuple[Array, Array]:
        """Calibrated T_base_tool (N, 4, 4) and the base model's J_ρ (N, 6, p); conditions as in `forward`.

        ∂N/∂q, about a thousandth of J_ρ, is left out: Newton's method converges by as much at every step all the same.
        """
        pose, jacobian = self.base_forward_and_jacobian(q, conditions)
        if self.network is not None:
            pose = exp6((jacobian @ self.network(q)[..., None])[..., 0]) @ pose
        return pose, jacobian


def fitting_setup(calibration: Calibration, measurements: Measurements) -> Setup:
    """The set-up in which a calibration predicts these measurements: theirs if known, else the calibration's own.

    Raises InputError when the calibration's targets cannot be those of the measurements.
    """
    if measurements.setup.known:
        return measurements.setup
    setup, other = calibration.setup, measurements.setup
    if len(setup.targets) != len(other.targets) or setup.kind is not other.kind:
        raise InputError(
            "the calibration was made with other targets than these measurements; evaluate with --refit-setup"
        )
    return setup


def check_same_robot(a: Robot, b: Robot, place_a: str, place_b: str) -> None:
    """InputError unless two descriptions have the same kinematics."""
    same = (
        a.n == b.n
        and a.chain.placements.shape == b.chain.placements.shape
        and a.chain.placed_on == b.chain.placed_on
        and np.allclose(a.chain.placements, b.chain.placements, rtol=0.0, atol=1e-9)
        and np.allclose(a.chain.twists, b.chain.twists, rtol=0.0, atol=1e-9)
    )
    if not same:
        raise InputError(
            f"{place_a} is for '{a.name}', but {place_b} for '{b.name}': the kinematics differ"
        )
