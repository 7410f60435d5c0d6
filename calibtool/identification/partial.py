"""A part of the complete model alone: lost mastering is a matter of joint offsets, nothing else."""

from dataclasses import replace

from calibtool.errormodel.families import BY_ID
from calibtool.errors import UsageError, near_names
from calibtool.identification.complete import CompleteOptions

_SHORT = {"q": "offsets"}


def of_families(
    options: CompleteOptions, only: str | None = None, fix: str | None = None
) -> CompleteOptions:
    """Options with families of errors left out: all but those of `only`, or those of `fix`.

    Both are comma lists of their names, `q` for the joint offsets.

    Raises UsageError for an unknown name, for both at a time, or when nothing is left.
    """
    if only is not None and fix is not None:
        raise UsageError("--only and --fix: give one of them")
    if only is None and fix is None:
        return options
    named = [part.strip() for part in (only or fix or "").split(",")]
    chosen = [_SHORT.get(name, name) for name in named]
    for name in chosen:
        if name not in BY_ID:
            option = "--only" if only is not None else "--fix"
            raise UsageError(f"{option}: no family '{name}'; {near_names(name, list(BY_ID))}")
    left_out = [name for name in BY_ID if (name in chosen) == (only is None)]
    if len(left_out) == len(BY_ID):
        raise UsageError("--fix: no family is left to identify")
    return replace(options, orders={**options.orders, **dict.fromkeys(left_out, 0)})
