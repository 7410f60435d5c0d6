"""Mistakes with readings that are no points are named, and nothing is named where there is none."""

from dataclasses import replace

import numpy as np
import pytest

from calibtool.measurement.checks import check_measurements
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import readonly

ARM = load_robot("ur5")


def measured(instrument: str, places: int) -> Measurements:
    simulation = Simulation(5, 60, "full", instrument=instrument, places=places, unregistered=True)
    return simulate(ARM, simulation)


def names(measurements: Measurements) -> set[str]:
    return {finding.name for finding in check_measurements(measurements)}


@pytest.mark.parametrize("factor", [1 / 25.4, 1e-3])
def test_lengths_of_wires_in_another_unit(factor: float) -> None:
    wires = measured("distance", 2)
    assert wires.values is not None
    wrong = replace(wires, values=readonly(wires.values * factor))
    assert "length_unit" in names(wrong)
    assert "length_unit" not in names(wires)


@pytest.mark.parametrize("instrument", ["camera", "distance"])
@pytest.mark.parametrize("by", [1, -1])
def test_rows_slipped_by_one(instrument: str, by: int) -> None:
    right = measured(instrument, 1)
    rows = np.arange(1, len(right) - 1)
    slipped = replace(right.rows(rows), q=readonly(right.q[rows + by]))
    assert "row_shift" in names(slipped)
    assert "row_shift" not in names(right)


def test_poses_of_a_board_inverted() -> None:
    right = measured("camera", 1)
    assert right.rotations is not None
    turned = np.swapaxes(right.rotations, -1, -2)
    points = -np.einsum("kij,kpj->kpi", turned, right.points)
    wrong = replace(right, rotations=readonly(turned), points=readonly(points))
    assert "inverse_poses" in names(wrong)
    assert "inverse_poses" not in names(right)


def test_poses_of_a_board_in_mirrored_images() -> None:
    right = measured("board", 1)
    assert right.rotations is not None
    mirror = np.diag([-1.0, 1.0, 1.0])
    points, turned = right.points @ mirror, mirror @ right.rotations @ mirror
    wrong = replace(right, rotations=readonly(turned), points=readonly(points))
    assert "left_handed_axes" in names(wrong)
    assert not {"left_handed_axes", "inverse_poses", "row_shift"} & names(right)
