"""calibtool plan: the most informative configurations to measure."""

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, cast

import typer

from calibtool.cli.files import check_output, message, shown, write_output, write_outputs, wrote
from calibtool.cli.input_files import RobotOptions, load_calibration
from calibtool.cli.options import (
    Force,
    JointValuesOption,
    Json,
    RobotArgument,
    Seed,
    WorkspaceName,
    choice,
    finite,
    joint_values_of,
    report_target,
)
from calibtool.cli.plan_options import ConstraintOptions, InstrumentOptions
from calibtool.cli.plan_tables import report_cube, report_plan
from calibtool.cli.printing import print_json
from calibtool.cli.progress import counted, working
from calibtool.errors import InputError, UsageError
from calibtool.units import count_of

if TYPE_CHECKING:
    from calibtool.planning.information import Knowledge
    from calibtool.planning.instrument_rows import InstrumentRows
    from calibtool.robot.robot import Robot


def plan(
    *,
    robot: RobotArgument,
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
        str | None,
        typer.Option(
            metavar="i|d",
            help="Least uncertainty of poses in the workspace (i, the default for closed loops) or "
            "of the parameters (d, the default for serial arms, and for instruments whose place "
            "has to be found too).",
        ),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="CALIBRATION",
            help="Start from what a calibration knows: what to measure next.",
        ),
    ] = None,
    workspace: WorkspaceName = None,
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
    observing: InstrumentOptions,
    program: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Write the rows as a program too: .ls (FANUC), .src (KUKA), .mod (ABB), .script "
            "(UR).",
        ),
    ] = None,
    limits: ConstraintOptions,
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
    described: RobotOptions,
    joint_values: JointValuesOption = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Choose what to measure.

    Writes the most informative configurations in an order of short travel, as joint positions
    (j1_deg …) for the controller and for simulate --at. With --floor-mm and --keep-out the links
    are checked as straight lines from joint to joint; motions between configurations are not.

    With --observe or --set-up the rows are those in which the instrument sees the tool: a tip on
    planes, spheres or in a gauge, a board in a camera's field of view.

    Example: calibtool plan fanuc-m1000ia -n 20 --joint-values controller -o plan.csv
    """
    target = report_target(output, json)
    if target is not None:
        check_output(target, force, suffixes=(".csv",))
    if program is not None:
        check_output(program, force)
    if criterion is not None:
        choice(criterion, ("d", "i"), "--criterion")
    import numpy as np

    from calibtool.planning.instrument_rows import placed
    from calibtool.planning.iso9283_poses import plan_test
    from calibtool.planning.plan import make_plan
    from calibtool.planning.selection import Criterion
    from calibtool.programs.point_list import check_suffix, point_list

    if program is not None:
        check_suffix(program)
    model, values = described.load(robot), joint_values_of(joint_values)
    space = model.workspace(workspace)
    constraints = limits.constraints()
    if iso9283:
        if source is not None:
            raise UsageError("--iso9283 chooses fixed poses; it does not use --from")
        if observing.given or program is not None:
            raise UsageError("--observe, --set-up and --program do not go with --iso9283")
        edge = None if cube_mm is None else finite(cube_mm, "--cube-mm") * 1e-3
        values = model.joint_values(model.name, values)
        cube = plan_test(model, space, constraints, model.targets, edge)
        cube = replace(cube, joint_values=values)
        if target is not None:
            write_output(target, cube.table(cycles or 30), force)
        report_cube(cube, space.name, cycles or 30, json)
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
    noise = None if noise_mm is None else finite(noise_mm, "--noise-mm") * 1e-3
    rng = np.random.default_rng(seed)
    seen_by = observing.rows(model, space, noise, rng)
    knowledge = _knowledge(model, source, noise, unregistered, seen_by)
    values = model.joint_values(model.name, values)
    closed = model.chain.tree is not None and seen_by is None
    with working(f"choosing from {candidates} candidates"):
        made = make_plan(
            knowledge,
            space,
            configurations,
            constraints=constraints,
            criterion=cast(Criterion, criterion or ("i" if closed else "d")),
            candidates=candidates,
            rng=rng,
            refine=refine,
            instrument=seen_by,
            progress=counted,
        )
    made = replace(made, joint_values=values)
    if len(made.candidates.q) < candidates:
        message(
            f"warning: only {len(made.candidates.q)} candidates after {made.candidates.drawn} "
            "draws; the constraints are tight"
        )
    outputs: dict[str, bytes | str] = {} if target is None else {target: made.table}
    if program is not None:
        outputs[program] = point_list(program, model, made.q, made.beside)
    write_outputs(outputs, force)
    if json:
        print_json({**made.as_json(), "workspace": space.name, "seed": seed})
    else:
        report_plan(made, space.name)
        if seen_by is not None and observing.set_up is None:
            for line in placed(seen_by.setup):
                message(f"note: {line}")
    if target is not None:
        wrote(target, f"{count_of(len(made.q), 'configuration')}, in an order of short travel")


def _knowledge(
    model: "Robot",
    source: str | None,
    noise: float | None,
    unregistered: bool,
    seen_by: "InstrumentRows | None",
) -> "Knowledge":
    from calibtool.calibration import check_same_robot
    from calibtool.planning.information import Knowledge

    if seen_by is not None and source is None:
        return Knowledge.of_tolerances(
            model,
            seen_by.noise if noise is None else noise,
            setup=seen_by.setup,
            noise_orientation=seen_by.noise_orientation,
        )
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
    own, instrument = calibration.setup.kind, None if seen_by is None else seen_by.setup.kind
    if own is not instrument and (instrument is not None or own.id not in ("points", "pose")):
        raise UsageError(
            f"{shown(source)}: it was identified from another instrument "
            f"({own.words.format(m=len(calibration.setup.targets))}); give the measurements it was "
            "identified from with --set-up"
        )
    if noise is None:
        noise = calibration.noise_position * posterior.noise_factor
    return Knowledge.of_identification(
        model, calibration.base, noise, calibration.noise_orientation
    )
