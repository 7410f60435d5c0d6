"""Fine structure of the joint motions: never from a handful of readings."""

import pytest

from calibtool.calibration import identify
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot


@pytest.mark.parametrize(("name", "count"), [("ur5", 40), ("fanuc-m1000ia", 25)])
@pytest.mark.parametrize("seed", [0, 2, 3])
def test_few_distances_of_one_wire_give_no_fine_structure(name: str, count: int, seed: int) -> None:
    """The robots have geometric errors only; a row holds one number."""
    robot = load_robot(name)
    simulation = Simulation(
        seed=seed, configurations=count, instrument="distance", places=1, unregistered=True
    )
    posterior = identify(simulate(robot, simulation)).base.posterior
    assert posterior is not None
    assert not posterior.parameters.fine_structure.any()
