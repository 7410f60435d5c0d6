"""A calibration: identified base model, networks on top of it, and predicted poses."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self, get_args

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from calibtool.calibration.frame import ChosenFrame, FrameName, taught_frame
from calibtool.equivalent.joints import EquivalentRobot
from calibtool.equivalent.regressor import Regressor
from calibtool.equivalent.training import TrainingReport
from calibtool.errormodel.family import Context
from calibtool.errormodel.operating_conditions import Conditions
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import InputError, check_choice
from calibtool.identification.identification import Identification
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.setup import Setup
from calibtool.robot.mechanism import Mechanism, joint_rows
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6


@dataclass(frozen=True)
class CrossValidation:
    """Gain of the networks on configurations that neither they nor their base model were fitted to.

    folds           number of parts into which the configurations were split
    gain            reduction of the mean weighted squared error by the networks, in percent of the
                    error of the base model alone
    standard_error  of the gain, in percent, from the differences of single configurations
    """

    folds: int
    gain: float
    standard_error: float

    @property
    def helps(self) -> bool:
        """Whether the gain is larger than chance explains."""
        return self.gain > 2.0 * self.standard_error

    def __str__(self) -> str:
        """Gain and standard error in percent, with one decimal, or two where the error is small."""
        decimals = 2 if 0.005 <= self.standard_error < 0.1 else 1
        return (
            f"{round(self.gain, decimals) + 0.0:+.{decimals}f} ± "
            f"{self.standard_error:.{decimals}f} %"
        )


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """T_calibrated(q) = exp6(J_ρ(q) N(q)) · T_base-model(q), with N = 0 without networks.

    base            identified base model with the set-up fitted to it, in the frames of the fit
    equivalent      equivalent robot, whose Jacobian is J_ρ
    networks        learned models (networks, or one Gaussian process) whose mean is N; empty when
                    the base model stands alone or they do not reduce the error
    training        report of the training; None when the base model stands alone
    validation      gain of the networks in cross-validation; None where it was not computed
    nominal_setup   set-up as it was known, or registered with the nominal robot
    noise_position, noise_orientation   stated noise of the measurements used, m and rad
    q               (N, n) configurations used, rad or m
    conditions      payload and temperature of predictions where a row does not state its own
    simulated       whether the measurements were simulated; the controller then has
                    the nominal model
    provenance      command line, seed, checksums of inputs and versions: text by name
    frame           chosen base and tool frame; None where the measurements determine both

    `errors`, `setup` and every pose are in the chosen frames; only the parameters of `base` are in
    those of the fit.
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

    def __repr__(self) -> str:
        residual = self.base.residual_rms[0] * 1e3
        network = f", {len(self.networks)} networks" if self.networks else ""
        return (
            f"<Calibration of {self.robot.name}: {self.base.model}{network}, "
            f"{self.configurations} configurations, residual {residual:.3g} mm rms>"
        )

    def summary(self) -> str:
        """Result for people: quality of the fit, and parameters with ± one standard deviation."""
        from calibtool.calibration.fit_summary import fit_summary  # which needs this class

        return fit_summary(self)

    @property
    def configurations(self) -> int:
        """Number of configurations used."""
        return len(self.q)

    @cached_property
    def network(self) -> Regressor | None:
        """Mean of the networks as one learned model; None without networks."""
        return self.networks[0].averaged(self.networks) if self.networks else None

    def at(self, conditions: Conditions) -> Self:
        """The same calibration with other default conditions: payload and temperature."""
        return replace(self, conditions=conditions)

    @cached_property
    def errors(self) -> RobotErrors:
        """Errors of the base model, in the chosen frames."""
        fitted = self.base.errors
        return fitted if self.frame is None else self.frame.errors(fitted)

    @cached_property
    def setup(self) -> Setup:
        """Set-up in which `forward` predicts observations, in the chosen frames."""
        fitted = self.base.setup
        return fitted if self.frame is None else self.frame.setup(fitted)

    @property
    def base_mechanism(self) -> Mechanism:
        """Mechanism with `errors`, without the errors that change from row to row."""
        return self.errors.mechanism

    @property
    def frame_is_free(self) -> bool:
        """Whether base and tool frame can be chosen: unknown set-up, model not nominal."""
        return not self.base.setup.known and self.base.model != "nominal"

    def in_frame(self, name: FrameName) -> Self:
        """The same calibration in the frames of the fit (`fitted`), or in those that move taught
        poses least (`taught`).

        Returns itself where both frames are determined. Raises InputError for networks with virtual
        joints, which are fixed in the tool frame of the training, UsageError for another name.
        """
        check_choice(name, get_args(FrameName), "frame")
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
        """The identified geometry as a new Pinocchio model with joint limits; its last frame is the
        tool.

        `base_mechanism.configuration` turns joint positions into coordinates of the model.
        `beyond_model` names the parts of the calibration that the model cannot represent.
        """
        return self.base_mechanism.as_model(self.robot.lower, self.robot.upper)

    @property
    def beyond_model(self) -> tuple[str, ...]:
        """Descriptions of the parts that `model` cannot represent; empty if none."""
        parts = [family.words for family in self.base.errors.beyond_geometry]
        return (*parts, *(["network"] if self.networks else []))

    def base_forward_and_jacobian(
        self, q: Array, conditions: Conditions | None = None
    ) -> tuple[Array, Array]:
        """T_base_tool (N, 4, 4) and J_ρ (N, 6, p) in K_0 of the base model for q (N, n) in rad or
        m.

        conditions: as in `forward`. J_ρ omits the slope of the joint-motion functions, about a
        thousandth.
        """
        return self.equivalent.forward_and_jacobian(
            *self.errors.at(q, conditions or self.conditions)
        )

    def closes(self, q: Array) -> np.ndarray:
        """At which rows of q (N, n) the loops of nominal and calibrated robot close: (N,) bool."""
        if self.robot.chain.tree is None:
            return np.ones(len(q), dtype=bool)
        return self.robot.mechanism.closes(q) & np.isfinite(self.forward(q)[:, 0, 0])

    def base_context(self, q: Array) -> Context:
        """Frames of the base model at q (N, n), from which the columns of errors are computed."""
        return self.errors.context(q, self.conditions)

    def forward(self, q: ArrayLike, conditions: Conditions | None = None) -> Array:
        """Calibrated pose T_base_tool (N, 4, 4) in K_0 for joint positions q (N, n) in rad or m.

        One configuration (n,) gives one pose (4, 4). conditions: of the rows; if not given, the
        calibration's own with every joint in the middle of its backlash.
        """
        q = np.asarray(q, dtype=float)
        if q.ndim == 1:
            pose: Array = self.forward(q[None], conditions)[0]
            return pose
        q = joint_rows(q, self.robot.n)
        if self.network is None:
            return self.errors.forward(q, conditions or self.conditions)
        return self.forward_and_jacobian(q, conditions)[0]

    def forward_and_jacobian(
        self, q: Array, conditions: Conditions | None = None
    ) -> tuple[Array, Array]:
        """Calibrated T_base_tool (N, 4, 4) and J_ρ (N, 6, p) of the base model, both in K_0.

        conditions: as in `forward`. ∂N/∂q, about a thousandth of J_ρ, is omitted; Newton's method
        then still reduces the error by that factor in every step.
        """
        pose, jacobian = self.base_forward_and_jacobian(q, conditions)
        if self.network is not None:
            pose = exp6((jacobian @ self.network(q)[..., None])[..., 0]) @ pose
        return pose, jacobian


def fitting_setup(calibration: Calibration, measurements: Measurements) -> Setup:
    """Set-up in which a calibration predicts the observations of these measurements.

    It is that of the measurements if known, otherwise that of the calibration, with what every file
    states itself (poses of a second arm). Raises InputError when the calibration was made with
    other targets or places.
    """
    if measurements.setup.known:
        return measurements.setup
    setup, other = calibration.setup, measurements.setup
    if len(setup.targets) != len(other.targets) or setup.kind is not other.kind:
        raise InputError(
            "the calibration was made with other targets than these measurements; --refit-setup "
            "finds theirs in these rows"
        )
    setup = setup.with_read_parts(other)
    shapes = [(setup.arrays[name].shape, other.arrays[name].shape) for name in setup.kind.arrays]
    if setup.places != other.places or any(one != another for one, another in shapes):
        raise InputError(
            "the calibration was made in another set-up (stations, placements, boards, wires) than "
            "these measurements; --refit-setup finds theirs in these rows"
        )
    return setup


def check_same_robot(a: Robot, b: Robot, place_a: str, place_b: str) -> None:
    """Raises InputError unless two descriptions have the same kinematics."""
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
