"""Files that a description may name."""

from pathlib import Path

from calibtool.errors import InputError


def inside(folder: Path, name: str, place: str, allowed: tuple[Path, ...] = ()) -> Path:
    """A file in a folder or below it, or in one of --allow, links resolved.

    InputError with `place` for any other, so that a description cannot read other files.
    """
    try:
        path = (folder / name).resolve()
        found = any(path.is_relative_to(each.resolve()) for each in (folder, *allowed))
    except (OSError, ValueError, RuntimeError) as error:  # a zero byte, links in a circle
        raise InputError(f"{place}: {name!r}: {error}") from None
    if not found:
        raise InputError(
            f"{place}: {name!r} is outside of {folder}; copy the file there, or allow the folder "
            "that it is in: --allow FOLDER"
        )
    return path


def contents(path: Path) -> bytes:
    """The bytes of a file; InputError where it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
