"""Fixtures that several test files share: small simulated data, made once."""

import os
from collections.abc import Generator

os.environ.setdefault("OMP_NUM_THREADS", "1")  # tiny matrices: threads only cost
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from arms import LOOPS, ROBOTS
from hypothesis import settings

from calibtool.calibration import Calibration, identify, train
from calibtool.equivalent.training import TrainingOptions
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

# The same cases every time; HYPOTHESIS_PROFILE=thorough draws twenty times as many, new
# ones every time.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.register_profile("thorough", max_examples=2000, deadline=None, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fixed"))


def pytest_sessionstart(session: pytest.Session) -> None:
    """Tests run in random order; `-q` hides the header that would tell which."""
    seed = session.config.getoption("randomly_seed", None)
    reporter = session.config.pluginmanager.getplugin("terminalreporter")
    if isinstance(seed, int) and reporter is not None:
        reporter.write_line(f"random order; --randomly-seed={seed} repeats it")


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call() -> Generator[None, object, object]:
    """Randomness is an argument: nothing draws from numpy's global generator, which
    pytest-randomly seeds.
    """
    before = np.random.get_state()[1:]  # noqa: NPY002
    result = yield
    after = np.random.get_state()[1:]  # noqa: NPY002
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True)), (
        "drew from the global generator"
    )
    return result


@pytest.fixture(params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> Robot:
    """Every built-in robot without closed loops in turn."""
    return load_robot(request.param)


@pytest.fixture(params=LOOPS)
def closed(request: pytest.FixtureRequest) -> Robot:
    """Every built-in robot with closed loops in turn."""
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
    return simulate(fanuc, Simulation(seed=1))


@pytest.fixture(scope="session")
def fanuc_local_poe(fanuc_measurements: Measurements) -> Calibration:
    return identify(fanuc_measurements, "local-poe")


@pytest.fixture(scope="session")
def fanuc_network(fanuc_measurements: Measurements) -> Calibration:
    """Network on the nominal robot, as in the paper."""
    return train(fanuc_measurements, "nominal", TrainingOptions(restarts=2))
