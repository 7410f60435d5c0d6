"""± of the parameters: 95 % intervals hold about 95 % of the truths, family by family."""

from dataclasses import replace

import numpy as np
import pytest

from calibtool.calibration import identify
from calibtool.calibration.uncertainty import predicted_uncertainty, with_discrepancy
from calibtool.errormodel.actual import ErrorScales
from calibtool.identification.complete import CompleteOptions, identify_complete
from calibtool.identification.parameters import State
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot

ROBOTS = 20


@pytest.mark.parametrize("name", ["ur5", "fanuc-m1000ia"])
def test_intervals_hold_the_truths_of_every_family(name: str) -> None:
    """Of twenty robots with the tolerances re-estimated. Errors of one robot are not independent,
    so that 95 % comes out between 90 and 100 %."""
    robot, inside = load_robot(name), dict[str, list[bool]]()
    for seed in range(ROBOTS):
        data = simulate(robot, Simulation(seed=700 + seed, configurations=40))
        found = identify_complete(data, CompleteOptions(compared=False))
        posterior = found.posterior
        assert posterior is not None
        assert data.truth is not None
        parameters = posterior.parameters
        truth = State(data.truth.actual.errors, found.setup).vector(parameters)
        off = np.abs(State(found.errors, found.setup).vector(parameters) - truth)
        for part in parameters.parts:
            block = parameters.blocks[part.family.id]
            inside.setdefault(part.family.id, []).extend(off[block] < 1.96 * posterior.std[block])
    for family in ("placements", "twists", "offsets"):
        assert 0.9 < np.mean(inside[family]) <= 1.0, family


def test_tolerances_that_were_stated_stay_as_they_are() -> None:
    data = simulate(load_robot("ur5"), Simulation(seed=0, configurations=40))
    options = CompleteOptions(estimate_priors=False)
    posterior = identify_complete(data, options).posterior
    assert posterior is not None
    np.testing.assert_array_equal(posterior.prior_std, posterior.parameters.prior_std())


def test_families_that_are_well_determined_are_hardly_widened() -> None:
    """Many rows determine the scale of the placement errors: ± of what they tell is their noise."""
    scales = ErrorScales(length=0.5e-3, angle=0.5e-3)
    data = simulate(load_robot("ur5"), Simulation(seed=0, configurations=300, scales=scales))
    posterior = identify_complete(data).posterior
    assert posterior is not None
    block = posterior.parameters.blocks["placements"]
    used = posterior.prior_std[block] / posterior.parameters.prior_std()[block]
    assert (used < 0.8).all()


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_what_is_left_beyond_the_stated_noise_is_the_discrepancy(name: str) -> None:
    """Rows three times as noisy as stated: √8 times the stated noise on every axis of a point;
    rows as noisy as stated: next to none."""
    data = simulate(load_robot(name), Simulation(seed=1, configurations=120))
    understated = replace(data, noise_position=data.noise_position / 3)
    for measured, expected in ((understated, 8.0), (data, 0.0)):
        found = identify(measured)
        posterior = found.base.posterior
        assert posterior is not None
        assert posterior.discrepancy[0] ** 2 == pytest.approx(expected, rel=0.1, abs=0.1)
        assert posterior.discrepancy[1] == 0.0  # no angle was measured
        alone = predicted_uncertainty(found, data.q[:3])
        added = with_discrepancy(found, alone).covariance - alone.covariance
        variance = (posterior.discrepancy[0] * found.noise_position) ** 2
        expected_diagonal = np.repeat([variance, 0.0], 3)
        np.testing.assert_allclose(added, np.tile(np.diag(expected_diagonal), (3, 1, 1)))
