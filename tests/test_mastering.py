"""Lost mastering: zeros that are degrees off, read off by a gauge in which nothing hides them."""

from dataclasses import replace

import numpy as np
import pytest

from calibtool.calibration import identify
from calibtool.calibration.fit import BaseOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.identification.complete import CompleteOptions
from calibtool.identification.mastering import mastering
from calibtool.identification.partial import of_families
from calibtool.measurement.checks import check_measurements
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.registration import register
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import readonly

ARM = load_robot("ur10")
LOST = np.deg2rad([0.0, 4.0, -3.0, 5.0, -2.0, 0.0])


def measured(lost: np.ndarray, instrument: str = "points") -> Measurements:
    """An arm whose joints are by `lost` beyond what its controller says."""
    scales = ErrorScales(length=0.2e-3, angle=0.2e-3)
    simulation = Simulation(
        5,
        60,
        scales=scales,
        unregistered=instrument == "points",
        instrument=instrument,
    )
    seen = simulate(ARM, simulation)
    shown = replace(seen, q=readonly(seen.q - lost), truth=None)
    return replace(shown, setup=register(shown))


@pytest.mark.parametrize("instrument", ["points", "board", "corners"])
def test_zeros_of_degrees_converge_and_are_read_off(instrument: str) -> None:
    """By the complete model too, where turns of the placements would hide them."""
    seen = measured(LOST, instrument)
    alone = BaseOptions("complete", of_families(CompleteOptions(), only="q"))
    for options in (alone, "complete"):
        found = mastering(identify(seen, options).base)
        assert [offset.joint for offset in found] == [1, 2, 3, 4, 5, 6]
        for offset, expected in zip(found[1:5], LOST[1:5], strict=True):
            assert offset.observable
            assert offset.value == pytest.approx(expected, abs=np.deg2rad(0.1))
    assert not found[0].observable  # a turn of the unknown base


def test_the_gauge_is_within_its_deviation() -> None:
    """Actual offset and turn about the axis together, over robots of their tolerances."""
    ratios = []
    for seed in range(6):
        seen = simulate(ARM, Simulation(seed, 60, unregistered=True))
        assert seen.truth is not None
        errors = seen.truth.actual.errors
        turns = (errors["placements"][:6] * ARM.chain.twists).sum(axis=-1)
        true = errors["offsets"] + turns
        found = mastering(identify(seen).base)
        ratios += [(found[j].value - true[j]) / found[j].std for j in (1, 2, 3, 4)]
    assert np.sqrt(np.mean(np.square(ratios))) < 1.6


def test_a_single_wrong_zero_is_named_by_its_joint() -> None:
    for joint, degrees in ((2, 3.0), (4, -5.0)):
        lost = np.zeros(6)
        lost[joint] = np.deg2rad(degrees)
        findings = check_measurements(measured(lost))
        named = [f for f in findings if f.severity == "warning"]
        assert len(named) == 1
        assert f"joint {joint + 1}" in named[0].message
