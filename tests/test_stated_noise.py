"""Measurements without noise, and noise that is stated far too small: an answer that is right, or a
sentence that is true.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibtool.calibration import identify
from calibtool.calibration.fit_summary import fit_lines
from calibtool.errors import NoSolutionError
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot


@cache
def measured(robot: str, noise: float) -> Measurements:
    return simulate(load_robot(robot), Simulation(configurations=40, noise=noise))


@pytest.mark.parametrize("robot", ["ur5", "planar-3r", "scara"])
@pytest.mark.parametrize("noise", [0.0, 5e-5])
@pytest.mark.parametrize("stated", [1e-6, 1e-9, 1e-12, 2e-15])
def test_the_answer_or_the_sentence_is_true(robot: str, noise: float, stated: float) -> None:
    data = replace(measured(robot, noise), noise_position=stated)
    assert data.truth is not None
    found, said = None, ""
    try:
        found = identify(data, "complete")
    except NoSolutionError as error:
        said = str(error)
    if found is None:
        assert "stated noise" in said  # not units, not the order of joints
        assert (stated <= 1e-9, noise) == (True, 0.0)
        return
    true = data.truth.actual.errors.forward(data.q)
    error = np.abs(found.forward(data.q) - true)[:, :3, 3].max()
    assert error < (3 * noise if noise else 1e-7)
    lines = [line for line in fit_lines(found) if "are stated: " in line]
    blamed = [line for line in lines if "does not describe" in line]
    assert bool(blamed) == (noise > 2 * stated)
