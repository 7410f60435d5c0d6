"""Options of controller programs on the command line."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, cast

import typer

from calibtool.cli.files import message, read_text, shown
from calibtool.cli.options import choice
from calibtool.errors import UsageError

if TYPE_CHECKING:
    from calibtool.robot.mechanism import Mechanism
    from calibtool.robot.robot import Robot

ROWS = ("csv", "ndjson")
FORMATS = ("auto", *ROWS, "fanuc-ls", "kuka-krl", "abb-rapid", "ur-script", "ros2-trajectory")


@dataclass(frozen=True)
class ProgramFlags:
    """How a controller program is read, corrected and reported."""

    kind: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="auto|csv|ndjson|fanuc-ls|kuka-krl|abb-rapid|ur-script|ros2-trajectory",
            help="Rows (CSV, JSON objects one per line), or a controller program, which keeps all "
            "but its targets' numbers.",
        ),
    ] = "auto"
    on_error: Annotated[
        str,
        typer.Option(
            "--on-error",
            metavar="stop|skip",
            help="Targets of a program without an answer: write nothing, or leave them.",
        ),
    ] = "stop"
    frames: Annotated[
        str | None,
        typer.Option(
            "--frames",
            metavar="FRAMES.toml",
            help="Frames and tools that poses of a program refer to.",
        ),
    ] = None
    controller: Annotated[
        str | None,
        typer.Option(
            "--controller",
            metavar="nominal|FILE",
            help="By which model the controller solves poses: "
            "URDF, UR calibration yaml, calibration.conf, DH table.",
        ),
    ] = None
    dh: Annotated[
        str | None,
        typer.Option(
            "--dh", metavar="standard|modified", help="Convention of a DH table of --controller."
        ),
    ] = None
    with_: Annotated[
        list[str] | None,
        typer.Option(
            "--with",
            metavar="FILE",
            help="Another file of the program, to look up frames, tools and positions; it is not "
            "corrected. Repeatable.",
        ),
    ] = None
    external: Annotated[
        str,
        typer.Option(
            "--external",
            metavar="leave|ignore",
            help="Poses with external axes: leave them, or look at the arm alone.",
        ),
    ] = "leave"
    report: Annotated[
        str | None,
        typer.Option(
            "--report",
            metavar="FILE.csv",
            help="Every position of a program, and why it is left if it is.",
        ),
    ] = None
    partial: Annotated[
        bool,
        typer.Option(
            "--partial",
            help="Exit 0 although poses that the program moves to are left beside corrected ones.",
        ),
    ] = False

    def check(self) -> None:
        """UsageError for an unknown value."""
        choice(self.kind, FORMATS, "--format")
        choice(self.on_error, ("stop", "skip"), "--on-error")
        choice(self.external, ("leave", "ignore"), "--external")

    @property
    def given(self) -> bool:
        """Whether an option that only programs have is given."""
        same = replace(self, with_=self.with_ or None)
        return same != ProgramFlags(kind=self.kind, external=self.external)


def controller_mechanism(flags: ProgramFlags, robot: "Robot") -> "Mechanism | None":
    """Kinematics named by `--controller`, None without it; prints their distance."""
    given, dh = flags.controller, flags.dh
    if given is None and dh is None:
        return None
    from calibtool.controller.controller_model import read_controller_model
    from calibtool.robot.denavit_hartenberg import DH_CONVENTIONS, DhConvention

    if dh is not None:
        choice(dh, DH_CONVENTIONS, "--dh")
    if given is None or (given == "nominal" and dh is not None):
        raise UsageError(
            "--dh is for a table of DH parameters; give it with --controller TABLE.csv"
        )
    if given == "nominal":
        return robot.mechanism
    model = read_controller_model(
        read_text(given), shown(given), robot, cast("DhConvention | None", dh)
    )
    message(
        f"{shown(given)}: the controller's tool is up to {model.position * 1e3:.2f} mm and "
        f"{model.orientation * 1e3:.2f} mrad from the nominal one, over the whole joint range"
    )
    return model.mechanism
