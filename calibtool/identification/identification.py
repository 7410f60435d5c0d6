"""Result of an identification: errors of geometry and joint motions, set-up and uncertainty."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.identification.parameters import Parameters, State
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import residuals
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import Array, readonly


@dataclass(frozen=True, eq=False)
class Posterior:
    """Gaussian posterior of the parameters of the complete model.

    parameters    the parameters in their order
    prior_std     (p,) tolerances (SI); estimated ones widened by how uncertain they are (`widened`)
    covariance    (p, p) of the estimate with these tolerances
    noise_factor  estimated noise over the stated one
    effective     effective number of parameters γ that the data determined
    log_evidence  of the data, up to a constant that is the same for every model of the same
                  measurements
    left_out      (p,) variance that sections left out of the model add to that of every parameter
                  (SI), not to that of poses: see `left_out_variance`
    residual_factors  (2,) standard deviation of a coordinate of new rows over the stated noise,
                  lengths and angles apart: the real noise and what the model does not describe,
                  see `held_out_factors`; 1 for a kind of coordinate that was not measured
    """

    parameters: Parameters
    prior_std: Array
    covariance: Array
    noise_factor: float
    effective: float
    log_evidence: float
    left_out: Array
    residual_factors: Array = field(default_factory=lambda: np.ones(2))

    @property
    def discrepancy(self) -> Array:
        """(2,) residuals beyond the stated noise, over it: 0 where the noise explains all."""
        return np.sqrt(np.maximum(self.residual_factors**2 - 1.0, 0.0))

    @property
    def std(self) -> Array:
        """(p,) standard deviation of each parameter, whatever the model leaves out."""
        return np.sqrt(np.diag(self.covariance) + self.left_out)


@dataclass(frozen=True, eq=False)
class Flagged:
    """Rows that do not fit the model.

    rows       (f,) configurations, from 0
    deviation  (f,) residual in standard deviations per coordinate
    position   (f,) residual as RMS over the target points, m
    cluster    one line that names the region and the likely joint, None where the rows are spread
    dropped    whether they were left out of the final fit
    """

    rows: np.ndarray
    deviation: Array
    position: Array
    cluster: str | None
    dropped: bool = False


@dataclass(frozen=True, eq=False)
class Identification:
    """An identified base model.

    model            `nominal`, `local-poe` or `complete`
    errors           identified errors of the robot
    setup            the set-up, its unknown parts fitted together with the errors
    singular_values  (p,) of the weighted identification matrix at the nominal robot, 1/m and 1/rad
                     mixed by 1 m = 1 rad
    rank             number of directions that these measurements determine
    observable_rank  number that any measurements of this kind could determine
    unobservable     what is missing between the two, each direction by its largest elements
    residual_rms     of the measured coordinates after the fit: position (m), orientation (rad, None
                     for target points)
    iterations       Gauss–Newton steps
    posterior        of the complete model, None for the others
    flagged          rows that do not fit, None where nobody looked
    held_out         by model, RMS of held-out coordinates over the stated noise, where the default
                     was in doubt: `model` is the best of these
    """

    model: str
    errors: RobotErrors
    setup: Setup
    singular_values: Array
    rank: int
    observable_rank: int
    unobservable: tuple[str, ...]
    residual_rms: tuple[float, float | None]
    iterations: int
    posterior: Posterior | None = None
    flagged: Flagged | None = None
    held_out: Mapping[str, float] = field(default_factory=dict)

    @property
    def parameters(self) -> int:
        """Number of estimated parameters, including those that stayed at their prior."""
        return len(self.singular_values)

    @property
    def state(self) -> State:
        """The errors and the set-up together."""
        return State(self.errors, self.setup)

    def with_setup(self, setup: Setup) -> Self:
        """The same errors in another set-up."""
        return replace(self, setup=setup)


def split_rms(residual: Array, measurements: Measurements) -> tuple[float, float | None]:
    """RMS per coordinate of residuals (N, d): positions in m, orientation in rad if measured."""
    setup = measurements.setup
    seen = setup.kind.weights(measurements.readings, 1.0, 1.0) > 0
    lengths = setup.kind.lengths(setup)
    position, turn = (
        float(np.sqrt((residual[:, which] ** 2).sum() / max(int(seen[:, which].sum()), 1)))
        for which in (lengths, ~lengths)
    )
    return position, None if lengths.all() else turn


def nominal_model(measurements: Measurements) -> Identification:
    """The nominal robot as a base model, the starting point of the paper.

    No errors; the set-up is known or registered.
    """
    robot, setup = measurements.robot, measurements.setup
    residual = residuals(measurements, setup, robot.mechanism.forward(measurements.q))
    return Identification(
        model="nominal",
        errors=RobotErrors.of(robot),
        setup=setup,
        singular_values=readonly(np.zeros(0)),
        rank=0,
        observable_rank=0,
        unobservable=(),
        residual_rms=split_rms(residual, measurements),
        iterations=0,
    )
