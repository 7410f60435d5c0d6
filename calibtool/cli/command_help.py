"""Help and completion of the commands: options in groups, names of their values, and values."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from typer.core import TyperCommand

GROUPS = {
    "Data": "on before source same_robot at commanded robot columns join join_tolerance_s joints "
    "clock_offset sheet layout unit angle_unit convention encoding rows sample rest tool "
    "joint_values board robot_targets frames controller dh with_ refit_setup payload_kg "
    "temperature_c check meshes plan accept_misfit history date",
    "Output": "output force json report pdf paper parameters html box_plot width_mm picture "
    "map_template dry_run uncertainty verify line_buffered magnify port precision prefix "
    "learning_curve require partial chart",
    "Document": "title serial customer operator instrument date temperature about",
}  # options in none of them state how it is computed
_OTHERS = "Method"
_DOCUMENT = "report"  # the command whose options describe a document
_LONGEST = 26  # characters of choices that are shown in place of a name
_UNITS = ("mm", "mrad", "deg", "kg", "k", "s", "c")


class Command(TyperCommand):
    """A command whose help shows its options in groups, with plain names of their values."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        for parameter in self.params:
            _name_value(parameter)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """`[OPTIONS] ROBOT [TARGETS]`."""
        arguments = (p for p in self.params if p.param_type_name == "argument")
        return ["[OPTIONS]", *(str(argument.metavar) for argument in arguments)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Arguments, then the groups of options."""
        arguments = [p for p in self.params if p.param_type_name == "argument"]
        if arguments:
            with formatter.section("Arguments"):
                formatter.write_dl(
                    [(str(a.metavar), str(getattr(a, "help", ""))) for a in arguments]
                )
        groups: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if parameter.param_type_name == "option" and record is not None:
                group = self._group(str(parameter.name))
                groups.setdefault(group, []).append((record[0], _without_ranges(record[1])))
        order = ("Data", _OTHERS, "Document", "Output", "Help")
        for name in sorted(groups, key=order.index):
            with formatter.section(name if len(groups) > 2 else "Options"):
                formatter.write_dl(groups[name])
            if len(groups) <= 2:
                groups = {}
                break

    def _group(self, name: str) -> str:
        if name == "help":
            return "Help"
        if self.name == _DOCUMENT and name in GROUPS["Document"].split():
            return "Document"
        for group, names in GROUPS.items():
            if group != "Document" and name in names.split():
                return group
        return _OTHERS


def _name_value(parameter: Any) -> None:
    """Give a parameter the plain name of its value, and the values that complete it."""
    if getattr(parameter, "is_flag", False):
        return
    given = parameter.metavar or _plain(str(parameter.name), _kind(parameter))
    parameter.metavar = given
    if "|" in given and len(given) > _LONGEST:
        parameter.metavar = "NAME"
        parameter.help = f"{parameter.help} One of {', '.join(given.split('|'))}."
    parameter.shell_complete = lambda context, incomplete: [
        SimpleNamespace(value=value, type="plain", help=None)
        for value in completions(given, incomplete)
    ]


def _plain(name: str, kind: str) -> str:
    """Name of the value of an option that has none."""
    unit = name.rpartition("_")[2]
    if "int" in kind:
        return "N"
    if "float" in kind:
        return unit.upper() if unit in _UNITS else "NUMBER"
    return {"robot": "ROBOT", "workspace": "NAME", "errors": "KINDS"}.get(name, "TEXT")


def _kind(parameter: Any) -> str:
    """The type of a value: typer keeps it in one place or another."""
    described = getattr(parameter, "type_descriptor", None)
    return str(parameter.type.name if described is None else described.annotation).lower()


def _without_ranges(text: str) -> str:
    """Help without the bounds of a number, which an error states where they matter."""
    head, bracket, tail = text.rpartition("  [")
    kept = [part for part in tail.rstrip("]").split("; ") if "<=" not in part and ">=" not in part]
    return text if not bracket else f"{head}  [{'; '.join(kept)}]" if kept else head


def completions(metavar: str, incomplete: str) -> list[str]:
    """Values that fit a parameter whose value is called `metavar` and begins with `incomplete`."""
    return [value for value in _values(metavar, incomplete) if value.startswith(incomplete)]


def _values(metavar: str, incomplete: str) -> Iterator[str]:
    names = metavar.strip("[].").replace("[", "").replace("]", "").split("|")
    yield from (name for name in names if name == name.lower())
    for name in names:
        if name == "ROBOT":
            from calibtool.robot.catalogue import robot_names

            yield from robot_names()
            yield from _paths(incomplete, (".toml", ".urdf", ".xacro", ".csv", ".yaml"))
        elif name == "FIGURE":
            from calibtool.evaluation.plots import FIGURES

            yield from FIGURES
        elif name == "KINDS":
            from calibtool.errormodel.families import ERROR_KINDS

            yield from ("all", *ERROR_KINDS)
        elif name in ("CALIBRATION", "MEASUREMENTS"):
            yield from _paths(incomplete, (".h5", ".hdf5"))
        elif "." in name:
            yield from _paths(incomplete, (f".{name.rpartition('.')[2]}",))
        elif name in ("FILE", "TABLE", "TARGETS", "POSES", "FOLDER", "DIR"):
            yield from _paths(incomplete, ())


def _paths(incomplete: str, suffixes: Iterable[str]) -> Iterator[str]:
    """Folders, and files with one of the suffixes, or any file without them."""
    kept = tuple(suffixes)
    head, slash, tail = incomplete.rpartition("/")
    folder = Path(f"{head}{slash}" or ".")
    if not folder.is_dir():
        return
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") and not tail.startswith("."):
            continue
        if path.is_dir():
            yield f"{head}{slash}{path.name}/"
        elif not kept or path.suffix.lower() in kept:
            yield f"{head}{slash}{path.name}"
