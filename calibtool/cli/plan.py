"""calibtool plan: the most informative configurations to measure."""

from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.files import check_output, message, shown, write_output, wrote
from calibtool.cli.identify import report_target
from calibtool.cli.input_files import load_calibration, load_described
from calibtool.cli.options import (
    AllowOption,
    Force,
    JointValuesOption,
    Json,
    Seed,
    ToolOption,
    choice,
    joint_values_of,
)
from calibtool.cli.printing import print_json, print_tables
from calibtool.cli.progress import counted, working
from calibtool.units import count_of, three_digits

if TYPE_CHECKING:
    from calibtool.planning.constraints import Sight
    from calibtool.planning.information import Knowledge
    from calibtool.planning.iso9283_poses import TestCube
    from calibtool.planning.plan import Plan
    from calibtool.robot.robot import Robot


def plan(
    robot: Annotated[
        str, typer.Argument(metavar="ROBOT", help="A robot of the catalogue, or a path.")
    ],
    output: Annotated[
        str | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE.csv",
            help="Output file; '-' is stdout (default without --json).",
        ),
    ] = None,
    configurations: Annotated[
        int, typer.Option("-n", "--configurations", min=1, help="How many to choose.")
    ] = 20,
    criterion: Annotated[
        str,
        typer.Option(
            metavar="d|i",
            help="Least uncertainty of the parameters (d) or of poses in the workspace (i).",
        ),
    ] = "d",
    source: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="CALIBRATION",
            help="Start from what a calibration knows: what to measure next.",
        ),
    ] = None,
    workspace: Annotated[
        str | None,
        typer.Option(
            help="A named workspace of the robot (default: its first); 'full' is the joint range."
        ),
    ] = None,
    candidates: Annotated[
        int, typer.Option(min=1, help="How many configurations to choose from.")
    ] = 2000,
    refine: Annotated[
        bool,
        typer.Option(
            "--refine/--no-refine",
            help="Move the chosen ones to better places between the candidates.",
        ),
    ] = True,
    seed: Seed = 0,
    noise_mm: Annotated[
        float | None,
        typer.Option(
            min=1e-6, help="Measurement noise per coordinate (default 0.05, or that of --from)."
        ),
    ] = None,
    unregistered: Annotated[
        bool,
        typer.Option(
            "--unregistered", help="Instrument frame and targets will have to be estimated as well."
        ),
    ] = False,
    joint_margin: Annotated[
        float,
        typer.Option(
            metavar="PERCENT",
            min=0,
            max=49,
            help="Part of each joint's range kept free at both ends.",
        ),
    ] = 0.0,
    min_singularity_distance: Annotated[
        float | None,
        typer.Option(min=0, help="Smallest distance from singularities (default 0.02)."),
    ] = None,
    floor_mm: Annotated[
        float | None,
        typer.Option(help="Arm, tool and targets stay above this z of the base frame."),
    ] = None,
    keep_out: Annotated[
        list[str] | None,
        typer.Option(
            metavar="BOX",
            help="x0,y0,z0,x1,y1,z1 in mm that arm, tool and sight stay out of; repeatable.",
        ),
    ] = None,
    instrument: Annotated[
        str | None,
        typer.Option(
            metavar="POINT", help="x,y,z in mm of an instrument that every target has to see."
        ),
    ] = None,
    normal: Annotated[
        str | None,
        typer.Option(
            metavar="VECTOR",
            help="x,y,z in which the targets look, in the tool frame (default 0,0,1).",
        ),
    ] = None,
    cone_deg: Annotated[
        float | None,
        typer.Option(
            min=0.1, max=180, help="Half angle in which a target sees the instrument (default 30)."
        ),
    ] = None,
    iso9283: Annotated[
        bool,
        typer.Option("--iso9283", help="Instead: the five poses of the ISO 9283 cube, in cycles."),
    ] = False,
    cube_mm: Annotated[
        float | None,
        typer.Option(min=1, help="Edge of that cube (default: the largest in the workspace)."),
    ] = None,
    cycles: Annotated[
        int | None, typer.Option(min=1, help="Cycles of --iso9283 (default 30).")
    ] = None,
    tool: ToolOption = None,
    allow: AllowOption = None,
    joint_values: JointValuesOption = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Choose the most informative configurations to measure, in an order of short travel.

    The table holds joint positions (j1_deg …) for the controller and for simulate --at. Links are
    checked as straight lines from joint to joint; motions between configurations are not checked.

    Example: calibtool plan fanuc-m1000ia -n 20 --joint-values controller -o plan.csv
    """
    target = report_target(output, json)
    if target is not None:
        check_output(target, force)
    choice(criterion, ("d", "i"), "--criterion")
    from dataclasses import replace
    from typing import cast

    import numpy as np

    from calibtool.errors import UsageError
    from calibtool.planning.constraints import Constraints
    from calibtool.planning.iso9283_poses import plan_test
    from calibtool.planning.plan import make_plan
    from calibtool.planning.selection import Criterion
    from calibtool.robot.damped_least_squares import MIN_SINGULARITY_DISTANCE

    model, values = load_described(robot, tool, allow), joint_values_of(joint_values)
    space = model.workspace(workspace)
    distance = (
        MIN_SINGULARITY_DISTANCE if min_singularity_distance is None else min_singularity_distance
    )
    constraints = Constraints(
        joint_margin=_finite(joint_margin, "--joint-margin") * 1e-2,
        singularity_distance=_finite(distance, "--min-singularity-distance"),
        floor=None if floor_mm is None else _finite(floor_mm, "--floor-mm") * 1e-3,
        keep_out=tuple(_box(text) for text in keep_out or []),
        sight=_sight(instrument, normal, cone_deg),
    )
    if iso9283:
        if source is not None:
            raise UsageError("--iso9283 chooses fixed poses; it does not use --from")
        edge = None if cube_mm is None else _finite(cube_mm, "--cube-mm") * 1e-3
        values = model.joint_values(model.name, values)
        cube = plan_test(model, space, constraints, model.targets, edge)
        cube = replace(cube, joint_values=values)
        if target is not None:
            write_output(target, cube.table(cycles or 30), force)
        _report_cube(cube, space.name, cycles or 30, json)
        if target is not None:
            wrote(target, f"5 poses, {count_of(cycles or 30, 'cycle')}")
        return
    for option, value in (("--cube-mm", cube_mm), ("--cycles", cycles)):
        if value is not None:
            raise UsageError(f"{option} belongs to --iso9283")
    if configurations > candidates:
        raise UsageError(
            f"-n {configurations}: only {candidates} candidates to choose from; raise --candidates"
        )
    knowledge = _knowledge(model, source, noise_mm, unregistered)
    values = model.joint_values(model.name, values)
    with working(f"choosing from {candidates} candidates"):
        made = make_plan(
            knowledge,
            space,
            configurations,
            constraints=constraints,
            criterion=cast(Criterion, criterion),
            candidates=candidates,
            rng=np.random.default_rng(seed),
            refine=refine,
            progress=counted,
        )
    made = replace(made, joint_values=values)
    if len(made.candidates.q) < candidates:
        message(
            f"warning: only {len(made.candidates.q)} candidates after {made.candidates.drawn} "
            "draws; the constraints are tight"
        )
    if target is not None:
        write_output(target, made.table, force)
    if json:
        print_json({**made.as_json(), "workspace": space.name, "seed": seed})
    else:
        _report(made, space.name)
    if target is not None:
        wrote(target, f"{count_of(len(made.q), 'configuration')}, in an order of short travel")


def _knowledge(
    model: "Robot", source: str | None, noise_mm: float | None, unregistered: bool
) -> "Knowledge":
    from calibtool.calibration import check_same_robot
    from calibtool.errors import InputError, UsageError
    from calibtool.planning.information import Knowledge

    noise = None if noise_mm is None else _finite(noise_mm, "--noise-mm") * 1e-3
    if source is None:
        return Knowledge.of_tolerances(model, 0.05e-3 if noise is None else noise, unregistered)
    if unregistered:
        raise UsageError("--unregistered: the set-up is that of --from")
    calibration, _ = load_calibration(source)
    check_same_robot(calibration.robot, model, shown(source), "ROBOT")
    posterior = calibration.base.posterior
    if posterior is None:
        raise InputError(
            f"{shown(source)}: its base model '{calibration.base.model}' has no posterior to start "
            "from; identify with --model complete"
        )
    if noise is None:
        noise = calibration.noise_position * posterior.noise_factor
    return Knowledge.of_identification(
        model, calibration.base, noise, calibration.noise_orientation
    )


def _report(made: "Plan", workspace: str) -> None:
    """What is known before and after measuring: predicted by the model."""
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
        f"{made.knowledge.robot.name}, {workspace}: {count} selected of "
        f"{len(made.candidates.q)} candidates; the model has "
        f"{count_of(made.knowledge.parameters.count, 'parameter')}",
        [(header, rows)],
    )
    message(
        "errors: expected standard deviation of a target point after compensation, over the "
        "workspace; observability indices: --json"
    )


def _report_cube(cube: "TestCube", workspace: str, cycles: int, json: bool) -> None:
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


def _sight(instrument: str | None, normal: str | None, cone_deg: float | None) -> "Sight | None":
    """The line of sight of three options."""
    from math import radians

    from calibtool.errors import UsageError
    from calibtool.planning.constraints import Sight

    if instrument is None:
        for option, value in (("--normal", normal), ("--cone-deg", cone_deg)):
            if value is not None:
                raise UsageError(f"{option} needs --instrument x,y,z to look at")
        return None
    x, y, z = _numbers(instrument, 3, "--instrument")
    u, v, w = _numbers(normal or "0,0,1", 3, "--normal")
    if not (u or v or w):
        raise UsageError(
            "--normal: 0,0,0 is no direction; give the one in which the targets look, such as 0,0,1"
        )
    cone = 30.0 if cone_deg is None else _finite(cone_deg, "--cone-deg")
    return Sight((x * 1e-3, y * 1e-3, z * 1e-3), (u, v, w), radians(cone))


def _numbers(text: str, count: int, option: str) -> list[float]:
    """Comma separated numbers of an option."""
    from calibtool.errors import UsageError

    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count:
        raise UsageError(f"{option}: '{text}' is not {count} numbers with commas between them")
    return [_finite(value, option) for value in values]


def _box(text: str) -> tuple[float, ...]:
    from calibtool.errors import UsageError

    values = _numbers(text, 6, "--keep-out")
    if any(low >= high for low, high in zip(values[:3], values[3:], strict=True)):
        raise UsageError(
            f"--keep-out: '{text}' is empty; give x0,y0,z0,x1,y1,z1 with x0 < x1, y0 < y1, z0 < z1"
        )
    return tuple(value * 1e-3 for value in values)


def _finite(value: float, option: str) -> float:
    from math import isfinite

    from calibtool.errors import UsageError

    if not isfinite(value):
        raise UsageError(f"{option}: {value} is no finite number")
    return value
