"""What a model leaves out: ± of the parameters that it has, and which sections have to be clear."""

import numpy as np
import pytest

from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.families import ERROR_KINDS, FAMILIES
from calibtool.identification.complete import CompleteOptions, identify_complete
from calibtool.identification.evidence import most_probable
from calibtool.identification.identification import Identification
from calibtool.identification.parameters import State
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot

EVERYTHING = {family.id: family.orders[-1] for family in FAMILIES}


def measured(name: str, seed: int) -> Measurements:
    """A robot with every kind of error, at other loads and temperatures in every row."""
    return simulate(
        load_robot(name),
        Simulation(
            seed=seed,
            configurations=100,
            scales=ErrorScales(ERROR_KINDS),
            workspace="full",
            payload_kg=(0.0, 10.0),
            temperature_c=(20.0, 35.0),
        ),
    )


def values(found: Identification) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names, estimates and standard deviations of the parameters."""
    assert found.posterior is not None
    parameters = found.posterior.parameters
    return parameters.names, found.state.vector(parameters), found.posterior.std


@pytest.mark.parametrize("name", ["ur10", "panda"])
def test_deviations_are_those_of_the_robot_with_everything_that_was_offered(name: str) -> None:
    """A fit of all of it is the other computation: Σ'_kk + (θ'_k − θ_k)² for every k that stayed,
    with the same tolerances."""
    data = measured(name, 3)
    small = identify_complete(data, CompleteOptions(estimate_priors=False, compared=False))
    large = identify_complete(data, CompleteOptions(orders=EVERYTHING, estimate_priors=False))
    names, theta, std = values(small)
    others, full, full_std = values(large)
    assert len(others) > len(names)
    place = [others.index(each) for each in names]
    expected = np.sqrt(full_std[place] ** 2 + (full[place] - theta) ** 2)
    assert small.posterior is not None
    within = np.sqrt(np.diag(small.posterior.covariance))
    np.testing.assert_allclose(std, np.maximum(expected, within), rtol=0.1)
    assert (expected / within).max() > 3.0  # some parameters stand for others, too


def test_where_nothing_is_left_out_the_deviations_are_those_of_the_fit() -> None:
    found = identify_complete(measured("ur10", 4), CompleteOptions(orders=EVERYTHING))
    assert found.posterior is not None
    assert not found.posterior.left_out.any()


def test_what_the_user_excludes_does_not_widen() -> None:
    data = simulate(load_robot("ur5"), Simulation(seed=2, configurations=40))
    only_geometry = {family.id: int(family.kind == "geometric") for family in FAMILIES}
    found = identify_complete(data, CompleteOptions(orders=only_geometry))
    assert found.posterior is not None
    assert not found.posterior.left_out.any()


def test_intervals_hold_parameters_that_stand_for_others() -> None:
    """Gravity and bending of joints whose parts rows hardly tell apart, of four robots."""
    inside: list[bool] = []
    for seed in range(4):
        data = measured("panda", 500 + seed)
        found = identify_complete(data)
        assert data.truth is not None
        assert found.posterior is not None
        parameters = found.posterior.parameters
        names, theta, std = values(found)
        truth = State(data.truth.actual.errors, found.setup).vector(parameters)
        chosen = [i for i, each in enumerate(names) if each.startswith(("gravity", "bend"))]
        inside += list((np.abs(theta - truth) < 1.96 * std)[chosen])
    assert len(inside) > 15
    assert np.mean(inside) > 0.88


def test_every_section_has_a_parsimony_of_its_own() -> None:
    """Two independent parameters, ½ (θ²/σ² − ln s²/σ²) = 2 nats each: one stays where less is
    asked for."""
    sizes = np.array([1.0, 1.0])
    covariance = np.diag([0.01, 0.01])
    theta = np.sqrt((2.0 * 2.0 + np.log(100.0)) * 0.01) * np.ones(2)
    sections = [np.array([0]), np.array([1])]
    for least, stays in (([4.0, 4.0], [0, 0]), ([4.0, 0.0], [0, 1]), ([1.0, 1.9], [1, 1])):
        kept = most_probable(theta, covariance, sizes, sections, least)
        np.testing.assert_array_equal(kept, np.array(stays, dtype=bool))
