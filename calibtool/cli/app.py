"""The application: commands, exit codes and one-line errors."""

import re
import sys
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from calibtool import __version__
from calibtool.cli import (
    compensate,
    demo,
    evaluate,
    export,
    guide,
    identify,
    import_,
    info,
    monitor,
    plan,
    plot,
    report,
    robots,
    serve,
    simulate,
    study,
    train,
    view,
)
from calibtool.cli.command_help import Command
from calibtool.cli.files import message
from calibtool.cli.option_groups import with_groups
from calibtool.cli.provenance import remember_command
from calibtool.cli.verbosity import SWITCHES, detail, take_switches
from calibtool.errors import CalibtoolError, near_names

# Messages of typer and pydantic, and plain words for them.
_PLAINER = (
    (r"Input should be greater than or equal to (\S+)", r"expected at least \1"),
    (r"Input should be less than or equal to (\S+)", r"expected at most \1"),
    (r"Input should be greater than (\S+)", r"expected more than \1"),
    (r"Input should be less than (\S+)", r"expected less than \1"),
    (r"Input should be a valid integer.*", "expected a whole number"),
    (r"Input should be a valid number.*", "expected a number"),
    (r"^(Missing .*)\.$", r"\1"),
)


class _Group(TyperGroup):
    """Turns every foreseen failure into one line on stderr and its documented exit code."""

    debug = False

    def main(  # type: ignore[override]
        self, args: Sequence[str] | None = None, prog_name: str | None = None, **extra: Any
    ) -> None:
        arguments = list(sys.argv[1:] if args is None else args)
        remember_command(arguments)
        _Group.debug = "--debug" in arguments
        extra["standalone_mode"] = False
        try:
            code = super().main(take_switches(arguments), prog_name or "calibtool", **extra)
            detail("done")
        except CalibtoolError as error:
            words = (word for word in arguments if not word.startswith("-"))
            text, command = str(error), next(words, "")
            of_command = text.startswith("--") and text.split()[0] not in SWITCHES
            if error.exit_code == 2 and of_command and command in self.commands:
                text = f"{text} (see calibtool {command} --help)"
            self._give_up(text, error.exit_code)
        except MemoryError:
            self._give_up("out of memory; use fewer configurations at a time", 1)
        except Exception as error:
            if hasattr(error, "format_message"):  # wrong usage, found by typer
                self._give_up(_usage(error), 2)
            if self.debug:
                raise
            # the system's: a full disk behind --help
            if isinstance(error, OSError) and error.strerror is not None:
                self._give_up(f"{error.filename or 'standard streams'}: {error.strerror}", 1)
            text = " ".join(str(error).split())
            self._give_up(
                f"unexpected {type(error).__name__}: {text}; please report it with the "
                "output of --debug",
                1,
            )
        sys.exit(code if isinstance(code, int) else 0)

    def _give_up(self, text: str, code: int) -> None:
        if self.debug and sys.exc_info()[0] is not None and code != 2:
            import traceback

            traceback.print_exc()
        message(" ".join(text.split()), important=True)
        sys.exit(code)


def _usage(error: Any) -> str:
    """A wrong use in one line: near options or all of them, and where to look."""
    context = getattr(error, "ctx", None)
    path = "calibtool" if context is None else context.command_path
    text = str(error.format_message())
    unknown = getattr(error, "option_name", None)
    if unknown is not None and context is not None:
        options = context.command.get_params(context)
        every = [name for p in options for name in (*p.opts, *p.secondary_opts)]
        known = [name for name in every if name.startswith("--")]
        text = f"{path} has no option {unknown}; {near_names(unknown, known)}"
    elif context is not None and text.startswith("No such command"):
        name = text.split("'")[1]
        text = f"there is no command '{name}'; {near_names(name, context.command.commands)}"
    for found, plain in _PLAINER:
        text = re.sub(found, plain, text)
    return f"{text} (see {path} --help)"


app = typer.Typer(
    cls=_Group,
    help="Make a robot arm accurate in software: from its description and measurements to "
    "corrected joints, programs and controller code.",
    epilog="-v, -q and --debug are understood before and after a command's name. "
    "Exit codes: 0 done, 1 unexpected, 2 wrong usage, 3 bad input data, 4 no solution, 5 an "
    "acceptance limit was not met, 130 interrupted.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"calibtool {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and leave."
        ),
    ] = False,
    verbose: Annotated[
        bool, typer.Option("-v", "--verbose", help="Say what is being done, with times.")
    ] = False,
    quiet: Annotated[
        bool, typer.Option("-q", "--quiet", help="Only warnings and errors on stderr.")
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


for _name, _function in (
    ("guide", guide.guide),
    ("robots", robots.robots),
    ("simulate", simulate.simulate),
    ("import", import_.import_),
    ("plan", plan.plan),
    ("identify", identify.identify),
    ("train", train.train),
    ("evaluate", evaluate.evaluate),
    ("compensate", compensate.compensate),
    ("export", export.export),
    ("serve", serve.serve),
    ("plot", plot.plot),
    ("report", report.report),
    ("view", view.view),
    ("study", study.study),
    ("monitor", monitor.monitor),
    ("info", info.info),
    ("demo", demo.demo),
):
    app.command(_name, cls=Command)(with_groups(_function))
