"""Provenance of a result: command, checksums of inputs, seed and versions; no time."""

import hashlib
from collections.abc import Sequence

from calibtool.cli.verbosity import SWITCHES

_OUTPUT_OPTIONS = ("-o", "--output", "--rest")
_command: list[str] = []


def remember_command(arguments: Sequence[str]) -> None:
    """Keep the command line without output names, --force, --json, -v, -q, --debug."""
    _command.clear()
    skip = False
    for argument in arguments:
        if skip:
            skip = False
        elif argument in _OUTPUT_OPTIONS:
            skip = True
        elif argument not in ("--force", "--json", *SWITCHES) and not argument.startswith(
            ("--output=", "--rest=", "-o")
        ):
            _command.append(argument)


def provenance(seed: int | None = None, **inputs: bytes) -> dict[str, str]:
    """Provenance of a file: command, seed, SHA-256 of every input by its role, versions."""
    from importlib.metadata import PackageNotFoundError, version

    result = {"command": " ".join(["calibtool", *_command])}
    if seed is not None:
        result["seed"] = str(seed)
    for role, data in inputs.items():
        result[f"sha256_{role}"] = hashlib.sha256(data).hexdigest()
    for package in ("calibtool", "pin", "numpy", "scipy", "h5py"):
        try:
            result[f"version_{package}"] = version(package)
        except PackageNotFoundError:
            result[f"version_{package}"] = "unknown"
    return result
