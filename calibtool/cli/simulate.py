"""calibtool simulate: measure a perturbed robot."""

from dataclasses import dataclass, replace
from math import isfinite
from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.files import HDF5, check_output, one_stdin, read_text, shown, write_output, wrote
from calibtool.cli.input_files import RobotOptions, load_measurements, measurements_words
from calibtool.cli.options import (
    Force,
    JointValuesOption,
    Output,
    RobotArgument,
    Seed,
    WorkspaceName,
    choice,
    comma_numbers,
    finite,
    joint_values_of,
)
from calibtool.cli.progress import working
from calibtool.cli.provenance import provenance
from calibtool.errors import InputError, UsageError

if TYPE_CHECKING:
    from calibtool.errormodel.actual import ErrorScales


@dataclass(frozen=True)
class ErrorOptions:
    """Kinds and sizes of the errors of the actual robot."""

    errors: Annotated[
        str,
        typer.Option(
            help="'all', or a comma list of geometric, gear, gravity, backlash, payload, thermal, "
            "bending, wobble."
        ),
    ] = "geometric"
    length_error_mm: Annotated[
        float, typer.Option(min=0, help="Standard deviation of geometric lengths.")
    ] = 0.5
    angle_error_mrad: Annotated[
        float, typer.Option(min=0, help="Standard deviation of geometric angles.")
    ] = 0.5
    gear_mrad: Annotated[
        float, typer.Option(min=0, help="Standard deviation of each gear harmonic's coefficients.")
    ] = 0.2
    gravity_mrad: Annotated[
        float, typer.Option(min=0, help="Wind-up of a loaded joint at its largest torque.")
    ] = 0.5
    backlash_mrad: Annotated[
        float, typer.Option(min=0, help="Half width of the backlash (mm if prismatic).")
    ] = 0.1
    payload_mrad: Annotated[
        float,
        typer.Option(
            min=0, help="Wind-up and bending of a loaded joint at its largest moment under 10 kg."
        ),
    ] = 0.5
    thermal_k: Annotated[
        float, typer.Option(min=0, help="Temperature rise of the steel links.")
    ] = 10.0

    def check_finite(self) -> None:
        """UsageError for a size that is no finite number."""
        for name, size in vars(self).items():
            if name != "errors":
                finite(size, f"--{name.replace('_', '-')}")

    def scales(self) -> "ErrorScales":
        """The same for the library; UsageError for an unknown kind of error."""
        from calibtool.errormodel.actual import ErrorScales
        from calibtool.errormodel.families import ERROR_KINDS

        kinds = tuple(kind.strip() for kind in self.errors.split(","))
        if self.errors == "all":
            kinds = ERROR_KINDS
        unknown = [kind for kind in kinds if kind not in ERROR_KINDS]
        if unknown:
            known = f"all, {', '.join(ERROR_KINDS)}"
            raise UsageError(f"--errors: unknown '{unknown[0]}'; known: {known}")
        return ErrorScales.of(kinds, vars(self))


def simulate(
    *,
    robot: RobotArgument,
    output: Output = "-",
    configurations: Annotated[
        int, typer.Option("-n", "--configurations", min=1, help="How many to measure.")
    ] = 100,
    seed: Seed = 0,
    workspace: WorkspaceName = None,
    sizes: ErrorOptions,
    payload_kg: Annotated[
        str | None,
        typer.Option(
            metavar="KG[,KG]",
            help="Mass at the tool; two: drawn evenly between them for every row.",
        ),
    ] = None,
    temperature_c: Annotated[
        str | None,
        typer.Option(
            metavar="C[,C]", help="Temperature of the links; two: a drift from one to the other."
        ),
    ] = None,
    noise_mm: Annotated[
        float, typer.Option(min=0, help="Measurement noise per coordinate.")
    ] = 0.05,
    unregistered: Annotated[
        bool,
        typer.Option(
            "--unregistered", help="Instrument and targets at random places that stay unknown."
        ),
    ] = False,
    observe: Annotated[
        str,
        typer.Option(
            metavar="KIND",
            help="points: a tracker; contact: a gauge with two sockets; distance: wires; plane or "
            "sphere: a probe; board or corners: a camera on the tool; camera or corners-beside: a "
            "camera beside the arm; second-arm: a sensor on another arm.",
        ),
    ] = "points",
    places: Annotated[
        int,
        typer.Option(
            min=1, help="Of --observe: placements, planes, boards, stations; wires at a time."
        ),
    ] = 1,
    gauge_mm: Annotated[
        float | None,
        typer.Option(
            min=1,
            help="Of contact: between its two sockets (default 50); of plane: height of a block on "
            "it.",
        ),
    ] = None,
    same_robot: Annotated[
        str | None,
        typer.Option(metavar="FILE.h5", help="Measure the actual robot of that simulation again."),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="POSES", help="Measure at these configurations: a CSV of joints or poses."
        ),
    ] = None,
    commanded: Annotated[
        str | None,
        typer.Option(
            metavar="TARGETS",
            help="The joints of --at are corrected ones: what went into compensate.",
        ),
    ] = None,
    described: RobotOptions,
    joint_values: JointValuesOption = None,
    force: Force = False,
) -> None:
    """Simulate measurements of a robot with random errors.

    Its targets are observed with noise at configurations of a workspace. The file also keeps the
    true errors, for `evaluate`. To rehearse a correction: --same-robot FILE.h5 --at corrected.csv
    --commanded targets.csv.

    Example: calibtool simulate fanuc-m1000ia -n 100 --seed 1 -o measurements.h5
    """
    check_output(output, force, binary=True, suffixes=HDF5)
    one_stdin(same_robot, at, commanded)
    if commanded is not None and at is None:
        raise UsageError(
            "--commanded belongs to --at: those joints are corrected for these targets"
        )
    sizes.check_finite()
    finite(noise_mm, "--noise-mm")
    from calibtool.compensation.targets import read_configurations
    from calibtool.measurement.importing.commanded_targets import commanded_poses
    from calibtool.measurement.instruments import INSTRUMENTS
    from calibtool.measurement.simulate import Simulation
    from calibtool.measurement.simulate import simulate as run
    from calibtool.storage import to_bytes
    from calibtool.tables import parse_table

    values = joint_values_of(joint_values)
    if values is not None and at is None:
        raise UsageError("--joint-values is for the joints of --at")
    model = described.load(robot)
    scales = sizes.scales()
    inputs: dict[str, bytes] = {}
    truth = None
    if same_robot is not None:
        earlier, inputs["same_robot"] = load_measurements(same_robot)
        if earlier.truth is None:
            raise InputError(
                f"{shown(same_robot)}: holds no simulated robot; --same-robot needs a file of "
                "calibtool simulate"
            )
        if observe == "points" and earlier.setup.kind.id != "points":
            raise UsageError(
                f"--same-robot {shown(same_robot)}: its set-up is of another instrument than a "
                "tracker; give --observe, too"
            )
        if unregistered != (not earlier.setup.known) and unregistered:
            raise UsageError("--unregistered: the set-up is that of --same-robot")
        from calibtool.calibration import check_same_robot

        check_same_robot(earlier.robot, model, shown(same_robot), "ROBOT")
        truth = earlier.truth
    q_at = None
    if at is not None:
        text = read_text(at)
        inputs["at"] = text.encode()
        q_at = read_configurations(text, shown(at), model, values)
    poses = None
    if commanded is not None and at is not None and q_at is not None:
        text = read_text(commanded)
        inputs["commanded"] = text.encode()
        table = parse_table(text, shown(commanded))
        if len(table) != len(q_at):
            counts = f"{len(table)} rows, but {shown(at)} has {len(q_at)}"
            raise InputError(f"{shown(commanded)}: {counts}")
        poses = commanded_poses(table, model, values)
    count = configurations if q_at is None else len(q_at)
    with working(f"simulating {count} configurations"):
        measurements = run(
            model,
            Simulation(
                seed=seed,
                configurations=configurations,
                workspace=workspace,
                scales=scales,
                noise=noise_mm * 1e-3,
                unregistered=unregistered,
                at=q_at,
                same_robot=truth,
                payload_kg=_range(payload_kg, "--payload-kg", 0.0),
                temperature_c=_range(temperature_c, "--temperature-c", -273.15),
                instrument=choice(observe, ("points", *INSTRUMENTS), "--observe"),
                places=places,
                gauge=None if gauge_mm is None else gauge_mm * 1e-3,
            ),
        )
    measurements = replace(measurements, commanded=poses, provenance=provenance(seed, **inputs))
    write_output(output, to_bytes(measurements), force)
    wrote(output, measurements_words(measurements))


def _range(text: str | None, option: str, lowest: float) -> tuple[float, float] | None:
    """One number, or the two ends of a range."""
    if text is None:
        return None
    ends = comma_numbers(text)
    if len(ends) not in (1, 2) or not all(isfinite(end) and end >= lowest for end in ends):
        raise UsageError(
            f"{option}: '{text}' is not one number, or two with a comma, of at least {lowest:g}"
        )
    return ends[0], ends[-1]
