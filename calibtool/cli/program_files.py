"""Controller programs on the command line: their files, written anew, and the summaries."""

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calibtool.cli.files import (
    STREAM,
    check_output,
    message,
    read_bytes,
    same_file,
    shown,
    write_output,
    write_outputs,
    wrote,
)
from calibtool.cli.program_flags import ROWS, ProgramFlags
from calibtool.errors import InputError, NoSolutionError, UsageError
from calibtool.units import count_of

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.programs.correction import ProgramOptions
    from calibtool.programs.program_summary import CompensatedProgram

_COLUMN = r"(j[1-9]\d*(_serial|_controller)?_(deg|rad|mm|m)|x_mm|x_m)"
_OBJECT = re.compile(rf"\s*\{{.*\"{_COLUMN}\"\s*:")  # a row of JSON
_NAMED = 5  # files in a message
_HEADER = re.compile(rf"(^|[,;\s\"]){_COLUMN}($|[,;\s\"])")


def recognised(path: str, head: bytes) -> str:
    """Format of the input from its name and first bytes: `csv`, `ndjson` or a program's."""
    text = head.decode("latin-1").removeprefix("\xef\xbb\xbf")
    first = next((line for line in text.splitlines() if line.strip()), "")
    suffix = "" if path == STREAM else Path(path).suffix.lower()
    if suffix in (".ndjson", ".jsonl") or _OBJECT.match(first):
        return "ndjson"
    if suffix in (".csv", ".tsv") or _HEADER.search(first):
        return "csv"
    from calibtool.programs.formats import detected

    return detected(text, "" if path == STREAM else path) or "csv"


def check_not_input(output: str, *inputs: str) -> None:
    """UsageError when a program would overwrite itself or the calibration, even with --force."""
    for path in inputs:
        if STREAM in (output, path) or not Path(output).exists() or not Path(path).exists():
            continue
        if same_file(output, path) or os.path.samefile(output, path):
            raise UsageError(
                f"{output}: is the input; a program is never overwritten, give another name"
            )


@dataclass(frozen=True)
class ProgramTask:
    """How the files of a program are corrected, and where the result is written.

    flags    options of the command for programs
    output   file or folder to write; force: it may exist
    bounds   a line for stderr: by how much joints may change
    """

    calibration: "Calibration"
    options: "ProgramOptions"
    flags: ProgramFlags
    output: str
    force: bool
    bounds: str


def compensate_file(task: ProgramTask, path: str, data: bytes, language: str) -> None:
    """Write the corrected program and its report; the summary and the bounds on stderr.

    NoSolutionError (after all is written) for a program that is corrected in part,
    unless --partial is given.
    """
    from calibtool.programs.compensate import compensate_texts

    flags, output, force = task.flags, task.output, task.force
    looked_up = [(shown(other), read_bytes(other), False) for other in flags.with_ or []]
    texts = iter([(shown(path), data, True), *looked_up])
    del data  # large programs are kept once, as text
    result = compensate_texts(task.calibration, texts, language, task.options)
    reports = {} if flags.report is None else {flags.report: result.report()}
    if output == STREAM:
        write_output(output, result.data, force, text=True)
        write_outputs({**reports}, force)
    else:
        write_outputs({output: result.data, **reports}, force)
    _print_summary(shown(path), result)
    message(task.bounds)
    wrote(output, "the corrected program")
    _check_complete([result], shown(path), flags.partial)


def compensate_folder(task: ProgramTask, folder: str) -> None:
    """The same for all programs of a folder; those of one language are treated as one program.

    All files are written or none.
    """
    from calibtool.programs.compensate import compensate_texts

    flags, output, report = task.flags, task.output, task.flags.report
    if output == STREAM:
        raise UsageError(
            f"{folder}: is a folder; give another one for the corrected programs with -o"
        )
    if Path(output).resolve() == Path(folder).resolve():
        raise UsageError(
            f"{output}: is the folder of the programs; give another one for the corrected ones"
        )
    found = _programs(folder, flags.kind, Path(output))
    if not found:
        raise InputError(
            f"{folder}: holds no programs; give their format with --format, or other files"
        )
    languages: dict[str, list[tuple[str, bytes, bool]]] = {}
    for path, data, language in found:
        languages.setdefault(language, []).append((path, data, True))
    looked_up = {other: read_bytes(other) for other in flags.with_ or []}
    results = []
    outputs: dict[str, bytes | str] = {}
    for language, texts in languages.items():
        more = [(o, d, False) for o, d in looked_up.items() if recognised(o, d[:65536]) == language]
        result = compensate_texts(task.calibration, [*texts, *more], language, task.options)
        results.append(result)
        for (path, _, _), text in zip(texts, result.texts, strict=False):
            outputs[str(Path(output) / Path(path).relative_to(folder))] = text
    if report is not None:
        if any(Path(path).resolve() == Path(report).resolve() for path in outputs):
            raise UsageError(
                f"{report}: is a corrected program, too; give another file for --report"
            )
        first, *rest = [result.report() for result in results]
        outputs[report] = first + "".join(text.partition("\n")[2] for text in rest)
    _write_folder(outputs, output, report, task.force)
    for language, result in zip(languages, results, strict=True):
        _print_summary(f"{folder} ({language})", result)
    message(task.bounds)
    wrote(output, count_of(len(outputs) - (report is not None), "corrected program"))
    _check_complete(results, folder, flags.partial)


def _programs(folder: str, kind: str, output: Path) -> list[tuple[str, bytes, str]]:
    """Path, bytes and language of the programs below a folder, without those in `output`.

    Files with a suffix of other things, and those in languages that are not read, are named and
    passed over, unless --format names a language.
    """
    from calibtool.programs.formats import usual_suffix
    from calibtool.programs.unread import unread_program

    found, others = [], []
    for path in sorted(Path(folder).rglob("*")):
        if not path.is_file() or path.is_relative_to(output):
            continue
        data = read_bytes(str(path))
        language = recognised(str(path), data[:65536])
        if language in ROWS or kind not in ("auto", language):
            continue
        unusual = unread_program(data[:65536]) or not usual_suffix(str(path), language)
        if kind == "auto" and unusual:
            others.append(str(path.relative_to(folder)))
        else:
            found.append((str(path), data, language))
    if others:
        more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
        message(
            f"{folder}: passed over, of other suffixes or languages: "
            f"{', '.join(others[:_NAMED])}{more}; --format takes them too"
        )
    return found


def _write_folder(
    outputs: dict[str, bytes | str], output: str, report: str | None, force: bool
) -> None:
    """Write files, and make their folders; a failure removes the folders that were made."""
    if Path(output).exists() and not Path(output).is_dir():
        raise UsageError(
            f"{output}: is no folder; the programs of a folder are written to another one"
        )
    if report is not None:
        check_output(report, force)
    made: list[Path] = []
    try:
        for folder in sorted({Path(path).parent for path in outputs if path != report}):
            for parent in (*reversed(folder.parents), folder):
                if not parent.exists():
                    parent.mkdir()
                    made.append(parent)
        write_outputs(outputs, force)
    except OSError as error:
        raise UsageError(f"{output}: cannot be written: {error.strerror or error}") from None
    finally:
        for folder in reversed(made):
            if not any(folder.iterdir()):
                folder.rmdir()


def _print_summary(name: str, result: "CompensatedProgram") -> None:
    for k, line in enumerate(result.summary(name)):
        # The first line has the counts; the others tell what is not corrected or must be checked.
        message(line, important=k > 0)


def _check_complete(results: "list[CompensatedProgram]", name: str, partial: bool) -> None:
    uncorrected = sum(result.inconsistent for result in results)
    if uncorrected and not partial:
        poses = "1 pose is" if uncorrected == 1 else f"{uncorrected} poses are"
        raise NoSolutionError(
            f"{name}: {poses} left while others, to which the program moves too, are corrected: "
            "its path has steps there; what is corrected is written, but should not be run like "
            "that (--partial: exit 0)"
        )
