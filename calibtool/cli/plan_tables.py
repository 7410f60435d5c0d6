"""Report of `plan` about the chosen configurations."""

from typing import TYPE_CHECKING

from calibtool.cli.files import message
from calibtool.cli.printing import print_json, print_tables
from calibtool.units import count_of, three_digits

if TYPE_CHECKING:
    from calibtool.planning.iso9283_poses import TestCube
    from calibtool.planning.plan import Plan


def report_plan(made: "Plan", workspace: str) -> None:
    """Predicted uncertainty before and after measuring."""
    count = count_of(len(made.q), "configuration")
    rows = []
    for name, predicted in (
        ("before", made.before),
        (f"with {len(made.q)} random ones", made.random),
        (f"with the {len(made.q)} selected", made.selected),
    ):
        values = predicted.as_json()
        cells = ("effective_parameters", "target_std_mean_mm", "target_std_max_mm")
        rows.append([name, *(three_digits(values[key]) for key in cells)])
    header = ["", "parameters known", "mean error, mm", "max error, mm"]
    print_tables(
        f"{made.knowledge.robot.name}, {workspace}: {count} selected of {len(made.candidates.q)} "
        f"candidates; the model has {count_of(made.knowledge.parameters.count, 'parameter')}",
        [(header, rows)],
    )
    message(
        "errors: expected standard deviation of a target point after compensation, over the "
        "workspace; observability indices: --json"
    )


def report_cube(cube: "TestCube", workspace: str, cycles: int, json: bool) -> None:
    """The cube of an ISO 9283 test, for people or as JSON."""
    from calibtool.planning.iso9283_poses import POSES

    if json:
        print_json(
            {
                "schema": "calibtool/plan",
                "schema_version": 1,
                "robot": cube.robot.name,
                "workspace": workspace,
                "configurations": cycles * len(POSES),
                "iso9283": cube.as_json(cycles),
            }
        )
        return
    message(
        f"{cube.robot.name}, {workspace}: cube of {cube.edge * 1e3:.4g} mm, {len(POSES)} poses × "
        f"{cycles} cycles; measure with full load at full speed, each pose after standstill"
    )
