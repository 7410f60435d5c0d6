"""Input and output of commands: `-` for streams, atomic output, no silent overwriting."""

import contextlib
import io
import os
import stat
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, TextIO

from calibtool.atomic_output import PartialFile, encoded, staged, weaker, written_at
from calibtool.cli.verbosity import detail, is_quiet, tell
from calibtool.errors import InputError, UsageError, printable
from calibtool.unfinished_files import held

STREAM = "-"
_WIDTH = 80  # characters in a line of the terminal, if unknown
HDF5 = (".h5", ".hdf5")
# Suffixes that promise a format: an output of another one is refused.
_FORMATS = {
    *HDF5,
    ".csv",
    ".json",
    ".html",
    ".htm",
    ".pdf",
    ".png",
    ".svg",
    ".jpg",
    ".docx",
    ".xlsx",
}


def message(text: str, important: bool = False) -> None:
    """One line for people on stderr; with --quiet only warnings and errors.

    A terminal gets it wrapped between words. A closed stderr is ignored.
    """
    if is_quiet() and not important and not text.startswith("warning"):
        return
    line = printable(text)
    tell(wrapped(line, stderr_width()) if sys.stderr.isatty() else [line])


def wrapped(text: str, width: int) -> list[str]:
    """Text in lines of at most `width` columns, broken between words; later ones are indented."""
    from textwrap import wrap

    indent = " " * (len(text) - len(text.lstrip()))
    lines = wrap(
        text,
        width,
        initial_indent=indent,
        subsequent_indent=f"{indent}  ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return lines or [""]


def stderr_width() -> int:
    """Columns for people: those of the terminal, 80 where stderr is none."""
    if not sys.stderr.isatty():
        return _WIDTH
    try:
        columns = int(os.environ.get("COLUMNS", "0"))
        return columns or os.get_terminal_size(sys.stderr.fileno()).columns or _WIDTH
    except (OSError, ValueError):
        return _WIDTH


def wrote(path: str, what: str) -> None:
    """The line after an output was written: its path and what it holds; none for stdout."""
    if path != STREAM:
        message(f"wrote {path}: {what}")


def read_bytes(path: str) -> bytes:
    """The contents of a file, or of stdin for `-`.

    UsageError if there is no such file, InputError if it is unreadable.
    """
    if path == STREAM:
        if sys.stdin.isatty():
            raise UsageError("stdin is a terminal; give a file, or pipe one in")
        return _binary(sys.stdin).read()
    with _input_errors(path):
        data = Path(path).read_bytes()
    detail(f"{path}: {len(data):,} bytes read")
    return data


@contextlib.contextmanager
def _input_errors(path: str) -> Iterator[None]:
    """An error of the operating system for an input, as UsageError or InputError."""
    try:
        yield
    except FileNotFoundError:
        raise UsageError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder; expected a file") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None


def read_text(path: str) -> str:
    """The same as text, UTF-8."""
    try:
        return read_bytes(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{shown(path)}: not a UTF-8 text file (byte {error.start + 1})") from None


@contextlib.contextmanager
def input_stream(path: str) -> Iterator[io.BufferedReader]:
    """A file, or stdin for `-`, read as its bytes arrive; `peek` looks at the first ones."""
    if path == STREAM:
        if sys.stdin.isatty():
            raise UsageError("stdin is a terminal; give a file, or pipe one in")
        stream: Any = _binary(sys.stdin)
        yield stream if isinstance(stream, io.BufferedReader) else io.BufferedReader(stream)
        return
    with _input_errors(path):
        file: Any = open(path, "rb", buffering=65536)  # noqa: SIM115
    with file:
        yield file


def text_lines(stream: io.BufferedReader, name: str) -> Iterator[str]:
    """Lines of UTF-8 text as they arrive, so that memory stays small; `name` is for messages."""
    text = io.TextIOWrapper(stream, encoding="utf-8")
    count = 0
    try:
        for line in text:
            count += 1
            yield line
    except UnicodeDecodeError:
        raise InputError(f"{name}: not a UTF-8 text file (after line {count})") from None
    except OSError as error:
        raise InputError(f"{name}: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(ValueError):  # closed already when the command ends early
            text.detach()


def shown(path: str) -> str:
    """Name of a path in messages."""
    return "stdin" if path == STREAM else path


def stem(path: str) -> str:
    """Name of a calibration in tables: the file's stem, printable, or `stdin`."""
    return "stdin" if path == STREAM else printable(Path(path).stem)


def one_stdin(*paths: str | None) -> None:
    """UsageError when more than one input wants stdin."""
    if sum(path == STREAM for path in paths) > 1:
        raise UsageError("only one input can be '-': stdin holds one file")


def check_output(
    path: str, force: bool, *, binary: bool = False, suffixes: tuple[str, ...] = ()
) -> None:
    """Refuse an output before the work starts: an existing file without --force, a missing folder,
    binary on a terminal, a suffix of another format than those of `suffixes`.
    """
    suffix = Path(path).suffix.lower()
    if suffixes and suffix in _FORMATS and suffix not in suffixes:
        raise UsageError(f"{path}: {suffix} is another format; this output is {suffixes[0]}")
    if path == STREAM:
        if sys.stdout is None:
            raise UsageError("stdout: cannot be written: it is closed")
        if binary and sys.stdout.isatty():
            raise UsageError(
                "the output is binary and stdout is a terminal; give -o FILE, or a pipe"
            )
        return
    if not path:
        raise UsageError("the output has no name; give a file, or '-' for stdout")
    try:
        target = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        target = None
    except OSError as error:
        raise _unwritable(path, error) from None
    if target is not None and stat.S_ISDIR(target.st_mode):
        raise UsageError(f"{path}: is a folder; give the name of a file")
    if target is not None and not stat.S_ISREG(target.st_mode):
        return  # a device or a named pipe is written to, never replaced
    if target is not None and not force:
        raise _exists(path)
    folder = written_at(path).parent
    if not os.path.isdir(folder):
        raise UsageError(f"{path}: there is no folder {folder}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UsageError(f"{path}: the folder {folder} is not writable")


def same_file(a: str, b: str) -> bool:
    """Whether two outputs are one file."""
    return os.path.realpath(a) == os.path.realpath(b)


def write_output(path: str, contents: bytes | str, force: bool, *, text: bool = False) -> None:
    """Write the whole file or nothing, see `atomic_output`. text: may be written to a terminal."""
    check_output(path, force, binary=isinstance(contents, bytes) and not text)
    with output_stream(path, force, checked=True) as write:
        write(encoded(contents))


@contextlib.contextmanager
def output_stream(
    path: str, force: bool, *, checked: bool = False
) -> Iterator[Callable[[bytes], None]]:
    """Write piece by piece.

    A file appears when the block ends, and not at all when it fails; stdout is written at once.
    """
    if not checked:
        check_output(path, force)
    if path == STREAM:
        yield write_stdout
        return
    with _reported(path):
        if _is_device(path):
            # Without truncation: by now the path may be a file, which keeps its contents.
            with os.fdopen(os.open(path, os.O_WRONLY), "wb") as stream:
                yield _writer(stream, path)
        else:
            with staged(written_at(path)) as part:
                yield _writer(part.stream, path)
                detail(f"{path}: {part.stream.tell():,} bytes written")
                with held():
                    part.publish(force)
                _say_if_weaker(path, part)


def write_outputs(outputs: dict[str, bytes | str], force: bool) -> None:
    """Write several files that belong together: all are on the disk before the first is renamed.

    When one cannot be renamed, those before are restored.
    """
    with contextlib.ExitStack() as stack:
        parts: dict[str, PartialFile] = {}
        for path, contents in outputs.items():
            check_output(path, force, binary=isinstance(contents, bytes))
            if path != STREAM and not _is_device(path):
                with _reported(path):
                    parts[path] = stack.enter_context(staged(written_at(path)))
                    parts[path].stream.write(encoded(contents))
                    parts[path].stream.flush()
        for path, contents in outputs.items():
            if path not in parts:
                write_output(path, contents, force)
        with held():
            _publish_all(parts, force)
        for path, part in parts.items():
            _say_if_weaker(path, part)


def _say_if_weaker(path: str, part: PartialFile) -> None:
    if part.lacking:
        message(f"note: {path}: {weaker(part.lacking)}")


def _publish_all(parts: dict[str, PartialFile], force: bool) -> None:
    done: dict[str, bytes | None] = {}
    for path, part in parts.items():
        before = part.target.read_bytes() if part.target.is_file() else None
        try:
            with _reported(path):
                part.publish(force)
        except UsageError:
            for earlier, old in done.items():
                if old is None:
                    written_at(earlier).unlink(missing_ok=True)
                else:
                    write_output(earlier, old, True)
            raise
        done[path] = before


def _writer(stream: BinaryIO, path: str) -> Callable[[bytes], None]:
    def write(data: bytes) -> None:
        try:
            stream.write(data)
        except OSError as error:
            raise _unwritable(path, error) from None

    return write


@contextlib.contextmanager
def _reported(path: str) -> Iterator[None]:
    """An error of the operating system for an output, as UsageError."""
    try:
        yield
    except FileExistsError:
        raise _exists(path) from None
    except OSError as error:
        raise _unwritable(path, error) from None


def _exists(path: str) -> UsageError:
    return UsageError(f"{path}: exists already; choose another name, or overwrite it with --force")


def _unwritable(path: str, error: OSError) -> UsageError:
    return UsageError(f"{path}: cannot be written: {error.strerror or error}")


def _is_device(path: str) -> bool:
    return os.path.exists(path) and not os.path.isfile(path)


def write_stdout(data: bytes) -> None:
    """Write all data to stdout.

    UsageError if it is closed or full; a reader that has ended ends the command quietly.
    """
    try:
        stream, rest = _binary(sys.stdout), memoryview(data)
        while rest:  # unbuffered, one call may take only a part
            rest = rest[stream.write(rest) :]
        stream.flush()
    except BrokenPipeError:
        _give_up_stdout()
        raise
    except (OSError, AttributeError, ValueError) as error:
        _give_up_stdout()
        raise UsageError(
            f"stdout: cannot be written: {getattr(error, 'strerror', None) or 'it is closed'}"
        ) from None


def _give_up_stdout() -> None:
    """Keep Python from writing the rest again when it ends, and from complaining."""
    with contextlib.suppress(OSError, AttributeError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _binary(stream: TextIO) -> BinaryIO:
    return stream.buffer
