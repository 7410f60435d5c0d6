"""calibtool study: Monte Carlo over robots, errors, noise and methods."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.atomic_output import weaker
from calibtool.cli.evaluate import change
from calibtool.cli.files import (
    HDF5,
    STREAM,
    check_output,
    message,
    read_text,
    shown,
    write_output,
    wrote,
)
from calibtool.cli.interrupts import interruptible
from calibtool.cli.options import Force, Json, report_target
from calibtool.cli.printing import Table, print_json, print_tables
from calibtool.cli.progress import counted
from calibtool.errors import CalibtoolError, InputError, UsageError
from calibtool.units import count_of, three_digits

if TYPE_CHECKING:
    from calibtool.evaluation.study import Definition, Study, StudyTable
    from calibtool.evaluation.study.cluster_security import ClusterSecurity


@dataclass(frozen=True)
class VariationOptions:
    """What a study varies; None where the definition tells."""

    runs: Annotated[
        int | None, typer.Option(min=1, help="Actual robots per combination (default 100).")
    ] = None
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of everything random (default 0).")
    ] = None
    methods: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LIST",
            help="Of local-poe, complete, network (on the robot as drawn), network-local-poe, "
            "default (train); nominal is always there. Default: local-poe,network,complete.",
        ),
    ] = None
    configurations: Annotated[
        list[str] | None,
        typer.Option("-n", "--configurations", metavar="LIST", help="Measured ones (default 100)."),
    ] = None
    noise_mm: Annotated[
        list[str] | None, typer.Option(metavar="LIST", help="Per coordinate (default 0.05).")
    ] = None
    errors: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KINDS",
            help="As in simulate (default geometric); repeat the option for alternatives.",
        ),
    ] = None
    error_scale: Annotated[
        list[str] | None,
        typer.Option(metavar="LIST", help="Factors on the sizes of all errors (default 1)."),
    ] = None
    workspace: Annotated[
        str | None,
        typer.Option(
            help="A named workspace (default: each robot's first); 'full' is the joint range."
        ),
    ] = None
    fresh: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Configurations for judging, seen by no fit (default 1000); 0: the measured ones.",
        ),
    ] = None

    def changes(self) -> dict[str, object]:
        """Keys of the definition; the parts of a LIST are separated."""
        lists = ("methods", "configurations", "noise_mm", "error_scale")
        return {
            key: ",".join(value).split(",") if value is not None and key in lists else value
            for key, value in vars(self).items()
        }


def study(
    *,
    robots: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ROBOT]...", help="Robots of the catalogue, or paths."),
    ] = None,
    plan: Annotated[
        str | None,
        typer.Option(
            metavar="STUDY.toml", help="The definition as a file; options go before its keys."
        ),
    ] = None,
    output: Annotated[
        str | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="Table: CSV, or HDF5 by .h5; '-' is stdout (default without --json).",
        ),
    ] = None,
    variation: VariationOptions,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Local processes (default: one per core).")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler, tcp://HOST:PORT.")
    ] = None,
    cluster_security: Annotated[
        str | None,
        typer.Option(
            "--cluster-security",
            metavar="TLS.toml",
            help="TLS files of the cluster, for tls://HOST:PORT; see docs/study.md.",
        ),
    ] = None,
    box_plot: Annotated[
        str | None,
        typer.Option("--box-plot", metavar="FILE", help="Also draw the errors: .svg or .png."),
    ] = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Compare methods over many simulated robots.

    Every run draws an actual robot, measures it, calibrates it by every method and judges them on
    fresh configurations. A LIST is comma separated, or the option is repeated; every combination of
    the lists is run. The results do not depend on the number of workers. With -o FILE finished runs
    are kept in FILE.journal, and the same command continues after an interruption.

    Example: calibtool study planar-3r --runs 4 --fresh 50 -o study.csv
    """
    target = report_target(output, json)
    from calibtool.evaluation.study import Study

    if cluster is not None and workers is not None:
        raise UsageError("--workers and --cluster exclude each other")
    if cluster_security is not None and not (cluster or "").startswith("tls://"):
        raise UsageError("--cluster-security is for --cluster tls://HOST:PORT")
    if box_plot is not None:
        from calibtool.evaluation.plots import image_format

        image_format(box_plot)
        check_output(box_plot, force)
    changes = {"robots": robots or None, **variation.changes()}
    study = Study.of(
        _definition(plan).changed(
            {key: value for key, value in changes.items() if value is not None}
        )
    )
    table = None if target is None or target == STREAM else _finished(study, target, force)
    if table is None:
        if target is not None:
            check_output(target, force, binary=_is_hdf5(target))
        table = _perform(study, target, workers, (cluster, cluster_security), force)
    else:
        message(f"{target}: this study is finished already")
    _report(study, table, json)
    if target is not None:
        wrote(target, f"{count_of(len(table.rows), 'row')} of {count_of(study.count, 'run')}")
    if box_plot is not None:
        from calibtool.evaluation.plots import draw_study, image_format

        write_output(box_plot, draw_study(table, image_format(box_plot)), force)
        wrote(box_plot, "box plot of the errors")


def _perform(
    study: "Study",
    target: str | None,
    workers: int | None,
    cluster: tuple[str | None, str | None],
    force: bool,
) -> "StudyTable":
    """Perform what is not finished yet, and write the table. cluster: address and TLS files."""
    from calibtool.evaluation.study import StudyTable
    from calibtool.evaluation.study.cluster import on_cluster
    from calibtool.evaluation.study.journal import Journal
    from calibtool.evaluation.study.local import in_processes
    from calibtool.processes import processors
    from calibtool.unfinished_files import held

    # A stream or a device cannot be continued: no journal beside it.
    plain = (
        target is not None
        and target != STREAM
        and (Path(target).is_file() or not Path(target).exists())
    )
    path = Path(f"{target}.journal") if plain else None
    with Journal(path, study, discard=force) as journal:
        if journal.finished:
            message(f"{path}: {len(journal.finished)} of {study.count} runs are finished already")
        if journal.lacking:
            message(f"note: {path}: {weaker(journal.lacking)}")
        rest = [index for index in range(study.count) if index not in journal.finished]
        address, security = cluster
        if address is not None:
            results = on_cluster(study, rest, address, _security(security), message)
        else:
            results = in_processes(study, rest, workers or processors())
        try:
            with interruptible():
                for index, rows in counted(
                    results, "runs simulated, calibrated and judged", total=len(rest)
                ):
                    with held():
                        journal.add(index, rows)
                table = StudyTable(study.key, journal.rows())
                with held():  # the table replaces the journal
                    if target is not None:
                        write_output(target, _contents(target, study, table), force)
                    journal.remove()
        except (CalibtoolError, KeyboardInterrupt) as error:
            results.close()
            if path is None or not journal.finished:
                raise
            kept = (
                f"{len(journal.finished)} of {study.count} runs are kept; the same command goes on"
            )
            if isinstance(error, KeyboardInterrupt):
                message(kept)
                raise
            raise type(error)(f"{error} ({kept})") from None
    return table


def _security(path: str | None) -> "ClusterSecurity | None":
    from calibtool.evaluation.study.cluster_security import parse_security

    return None if path is None else parse_security(read_text(path), path, Path(path).parent)


def _definition(plan: str | None) -> "Definition":
    from calibtool.evaluation.study import Definition, parse_definition

    return Definition() if plan is None else parse_definition(read_text(plan), shown(plan))


def _is_hdf5(path: str) -> bool:
    return path.lower().endswith(HDF5)


def _contents(path: str, study: "Study", table: "StudyTable") -> bytes | str:
    if not _is_hdf5(path):
        return table.as_csv()
    from calibtool.storage.studies import study_to_bytes

    return study_to_bytes(table, study.definition.model_dump_json())


def _finished(study: "Study", path: str, force: bool) -> "StudyTable | None":
    """The table of this very study when it is there already; UsageError when the file holds
    something else, unless it may be overwritten.
    """
    if not Path(path).is_file():
        return None
    try:
        table = _read_table(path)
    except InputError:
        problem = "exists already and is no study's table"
    else:
        if table.key == study.key and len(table.rows) == study.count * len(
            study.definition.methods
        ):
            return table
        problem = (
            "has lost rows"
            if table.key == study.key
            else f"holds another study ({table.key}, not {study.key})"
        )
    if not force:
        raise UsageError(f"{path}: {problem}; choose another name, or overwrite it with --force")
    return None


def _read_table(path: str) -> "StudyTable":
    import io

    from calibtool.cli.files import read_bytes
    from calibtool.evaluation.study.study_table import parse_csv

    if not _is_hdf5(path):
        return parse_csv(read_text(path), path)
    from calibtool.storage import read_study

    return read_study(io.BytesIO(read_bytes(path)), path).table


def _report(study: "Study", table: "StudyTable", json: bool) -> None:
    """JSON on stdout, or medians and 5-95 % quantiles for people; failures are always printed."""
    from calibtool.evaluation.study.statistics import study_summary

    summary = study_summary(table)
    if json:
        print_json(summary)
    else:
        _show(study, summary)
    if summary["failed"]:
        status = next(text for text in table.column("status") if text != "ok")
        message(
            f"warning: {summary['failed']} of {summary['rows']} rows have no result; the "
            f"first: {status}"
        )


def _show(study: "Study", summary: dict[str, object]) -> None:
    groups = summary["groups"]
    assert isinstance(groups, list)
    varied = [
        key
        for key in ("robot", "errors", "error_scale", "noise_mm", "configurations")
        if _differs(groups, key)
    ]
    keys = 1 + len(varied)
    tables: list[Table] = []
    for quantity, unit in (("position", "mm"), ("orientation", "mrad")):
        key = f"{quantity}_{unit}"
        rows = [
            [
                group["method"],
                *(str(group[name]) for name in varied),
                _spread(group[key]["mean"]),
                _spread(group[key]["max"]),
                ""
                if group["method"] == "nominal"
                else _changed(group["reduction_percent"][f"{quantity}_max"]),
            ]
            for group in groups
            if group[key] is not None and group[key]["mean"] is not None
        ]
        header = [f"{quantity}, {unit}", *(name.replace("_", " ") for name in varied)]
        if rows:
            tables.append(([*header, "mean error", "max error", "change of max"], rows))
    judged = (
        f"{study.definition.fresh} fresh configurations"
        if study.definition.fresh
        else "the measured configurations"
    )
    names = ", ".join(dict.fromkeys(group["robot"] for group in groups))
    print_tables(f"{names}: {count_of(study.count, 'run')}, judged on {judged}", tables, keys)
    message(
        "median of the runs, in brackets the range of the middle 90 %; of the change, in brackets, "
        "what only 5 % of the runs fall short of"
    )


def _differs(groups: list[dict[str, object]], key: str) -> bool:
    return len({str(group[key]) for group in groups}) > 1


def _spread(values: dict[str, float]) -> str:
    low, high = three_digits(values["q05"]), three_digits(values["q95"])
    return f"{three_digits(values['median'])} ({low}…{high})"


def _changed(values: dict[str, float] | None) -> str:
    return "" if values is None else f"{change(values['median'])} ({change(values['q05'])})"
