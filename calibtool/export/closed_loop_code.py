"""Closed loops as C99 and Structured Text: a trained network, and its accuracy."""

from collections.abc import Callable
from typing import Any

from calibtool.calibration import Calibration
from calibtool.errors import UsageError
from calibtool.export.closed_loop_network import Taught
from calibtool.export.layers import layers
from calibtool.export.rendering import LARGEST_POSITION, Precision, joint_lines, left_out, render
from calibtool.export.taught_region import LEAST_DISTANCE


def taught_values(calibration: Calibration, precision: Precision) -> dict[str, Any]:
    """The values of the templates of trained networks; Taught.of may raise NoSolutionError.

    Raises UsageError for a robot whose controller shows other joint values than the joints'.
    """
    robot = calibration.robot
    if robot.coupled:
        raise UsageError(
            f"{robot.name}: code for closed loops with coupled joint values is not written; "
            "export json"
        )
    taught = Taught.of(calibration)
    return {
        "robot": robot.name,
        "base_model": calibration.base.model,
        "left_out": left_out(calibration),
        "joints": joint_lines(robot),
        "n": robot.n,
        "network": layers(taught.network),
        "region": taught.region,
        "distance": layers(taught.region.distance),
        "least_distance": LEAST_DISTANCE,
        "taught": taught,
        "virtual_joints": ", ".join(calibration.equivalent.virtual_joints),
        "largest": LARGEST_POSITION,
        "single": precision == "single",
    }


def taught_c(values: dict[str, Any], filters: dict[str, Callable[..., str]]) -> tuple[str, str]:
    """Header and source; values with `prefix`, `real` and `f` as for the code of serial chains."""
    header, source = (render(f"taught.{suffix}.j2", values, **filters) for suffix in "hc")
    return header, source
