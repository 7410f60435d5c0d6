"""Fixtures that several test files share: small simulated data, made once."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # tiny matrices: threads only cost
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import settings

from calibtool.calibration import Calibration, identify, train
from calibtool.equivalent.training import TrainingOptions
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot, robot_names
from calibtool.robot.model import Robot

# The same cases every time; `pytest tests/laws --hypothesis-profile=thorough` draws twenty times as many, new ones.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.register_profile("thorough", max_examples=2000, deadline=None, print_blob=True)
settings.load_profile("fixed")

ROBOTS = robot_names()


@pytest.fixture(params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> Robot:
    """Every carried robot in turn."""
    return load_robot(request.param)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(12345)


@pytest.fixture(scope="session")
def fanuc() -> Robot:
    return load_robot("fanuc-m1000ia")


@pytest.fixture(scope="session")
def fanuc_measurements(fanuc: Robot) -> Measurements:
    """The paper's experiment: 100 configurations of the machining workspace."""
    return simulate(fanuc, Simulation(seed=1, workspace=fanuc.workspace(None)[1]))


@pytest.fixture(scope="session")
def fanuc_local_poe(fanuc_measurements: Measurements) -> Calibration:
    return identify(fanuc_measurements, "local-poe")


@pytest.fixture(scope="session")
def fanuc_network(fanuc_measurements: Measurements) -> Calibration:
    """Network on the nominal robot, as in the paper."""
    return train(fanuc_measurements, "nominal", TrainingOptions(restarts=2))
