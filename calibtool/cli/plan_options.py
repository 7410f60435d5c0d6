"""Options of calibtool plan: the constraints of configurations, and the instrument."""

from dataclasses import dataclass
from math import radians
from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.files import shown
from calibtool.cli.input_files import load_measurements
from calibtool.cli.options import choice, comma_numbers, finite
from calibtool.errors import UsageError

if TYPE_CHECKING:
    import numpy as np

    from calibtool.planning.constraints import Constraints, Sight
    from calibtool.planning.instrument_rows import InstrumentRows
    from calibtool.robot.robot import Robot
    from calibtool.robot.workspace import Workspace


@dataclass(frozen=True)
class InstrumentOptions:
    """What observes the arm, and where it stands."""

    observe: Annotated[
        str,
        typer.Option(
            metavar="KIND",
            help="The instrument, as of simulate --observe; where it stands is proposed too.",
        ),
    ] = "points"
    places: Annotated[int, typer.Option(min=1, help="Of --observe, as of simulate --places.")] = 1
    gauge_mm: Annotated[
        float | None, typer.Option(min=1, help="Of --observe, as of simulate --gauge-mm.")
    ] = None
    set_up: Annotated[
        str | None,
        typer.Option(
            metavar="MEASUREMENTS.h5",
            help="The instrument as it stands in these measurements: a few rows by hand will do.",
        ),
    ] = None

    @property
    def given(self) -> bool:
        """Whether an instrument other than a tracker of points was chosen."""
        return self.observe != "points" or self.set_up is not None

    def rows(
        self,
        model: "Robot",
        space: "Workspace",
        noise: float | None,
        rng: "np.random.Generator",
    ) -> "InstrumentRows | None":
        """The rows that the instrument sees; None for points of a tracker. noise: m."""
        from calibtool.calibration import check_same_robot
        from calibtool.measurement.instruments import INSTRUMENTS
        from calibtool.planning.instrument_rows import InstrumentRows

        choice(self.observe, ("points", *INSTRUMENTS), "--observe")
        if self.set_up is not None:
            if self.observe != "points":
                raise UsageError("--observe and --set-up: the measurements say what observes")
            measurements, _ = load_measurements(self.set_up)
            check_same_robot(measurements.robot, model, shown(self.set_up), "ROBOT")
            return InstrumentRows.of(measurements, space)
        if self.observe == "points":
            return None
        gauge = None if self.gauge_mm is None else self.gauge_mm * 1e-3
        stated = 0.05e-3 if noise is None else noise
        return InstrumentRows.proposed(model, space, self.observe, self.places, gauge, stated, rng)


@dataclass(frozen=True)
class ConstraintOptions:
    """Where a configuration may be."""

    joint_margin: Annotated[
        float,
        typer.Option(
            metavar="PERCENT",
            min=0,
            max=49,
            help="Part of each joint's range kept free at both ends.",
        ),
    ] = 1.0
    min_singularity_distance: Annotated[
        float | None,
        typer.Option(min=0, help="Smallest distance from singularities (default 0.02)."),
    ] = None
    floor_mm: Annotated[
        float | None,
        typer.Option(help="Arm, tool and targets stay above this z of the base frame."),
    ] = None
    keep_out: Annotated[
        list[str] | None,
        typer.Option(
            metavar="BOX",
            help="x0,y0,z0,x1,y1,z1 in mm that arm, tool and sight stay out of; repeatable.",
        ),
    ] = None
    instrument: Annotated[
        str | None,
        typer.Option(
            metavar="POINT", help="x,y,z in mm of an instrument that every target has to see."
        ),
    ] = None
    normal: Annotated[
        str | None,
        typer.Option(
            metavar="VECTOR",
            help="x,y,z in which the targets look, in the tool frame (default 0,0,1).",
        ),
    ] = None
    cone_deg: Annotated[
        float | None,
        typer.Option(
            min=0.1, max=180, help="Half angle in which a target sees the instrument (default 30)."
        ),
    ] = None

    def constraints(self) -> "Constraints":
        """The same for the library, in SI; UsageError for what is no number or no box."""
        from calibtool.planning.constraints import Constraints
        from calibtool.robot.singularity import MIN_SINGULARITY_DISTANCE

        distance = self.min_singularity_distance
        return Constraints(
            joint_margin=finite(self.joint_margin, "--joint-margin") * 1e-2,
            singularity_distance=finite(
                MIN_SINGULARITY_DISTANCE if distance is None else distance,
                "--min-singularity-distance",
            ),
            floor=None if self.floor_mm is None else finite(self.floor_mm, "--floor-mm") * 1e-3,
            keep_out=tuple(_box(text) for text in self.keep_out or []),
            sight=self._sight(),
        )

    def _sight(self) -> "Sight | None":
        from calibtool.planning.constraints import Sight

        if self.instrument is None:
            for option, value in (("--normal", self.normal), ("--cone-deg", self.cone_deg)):
                if value is not None:
                    raise UsageError(f"{option} needs --instrument x,y,z to look at")
            return None
        x, y, z = _numbers(self.instrument, 3, "--instrument")
        u, v, w = _numbers(self.normal or "0,0,1", 3, "--normal")
        if not (u or v or w):
            raise UsageError(
                "--normal: 0,0,0 is no direction; give the one in which the targets look, such as "
                "0,0,1"
            )
        cone = 30.0 if self.cone_deg is None else finite(self.cone_deg, "--cone-deg")
        return Sight((x * 1e-3, y * 1e-3, z * 1e-3), (u, v, w), radians(cone))


def _numbers(text: str, count: int, option: str) -> list[float]:
    """Comma separated numbers of an option."""
    values = comma_numbers(text)
    if len(values) != count:
        raise UsageError(f"{option}: '{text}' is not {count} numbers with commas between them")
    return [finite(value, option) for value in values]


def _box(text: str) -> tuple[float, ...]:
    """A box of --keep-out, m."""
    values = _numbers(text, 6, "--keep-out")
    if any(low >= high for low, high in zip(values[:3], values[3:], strict=True)):
        raise UsageError(
            f"--keep-out: '{text}' is empty; give x0,y0,z0,x1,y1,z1 with x0 < x1, y0 < y1, z0 < z1"
        )
    return tuple(value * 1e-3 for value in values)
