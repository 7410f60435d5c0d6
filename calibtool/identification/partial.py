"""A part of the complete model alone: lost mastering is a matter of joint offsets, nothing else."""

from dataclasses import replace

import numpy as np

from calibtool.errormodel.families import BY_ID
from calibtool.errors import UsageError, near_names
from calibtool.identification.complete import CompleteOptions
from calibtool.identification.identification import Identification
from calibtool.identification.report import AT_PRIOR

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


def offset_lines(identification: Identification) -> list[str]:
    """Joint offsets with their standard deviations, in degrees or mm, for a mastering screen: what
    to add to the joint values.

    None at all where placement errors are identified too: turns about a joint's axis are theirs.
    """
    posterior = identification.posterior
    if posterior is None or "offsets" not in posterior.parameters.orders:
        return []
    if "placements" in posterior.parameters.orders:
        return []
    block, robot = posterior.parameters.blocks["offsets"], identification.errors.robot
    values, prior = identification.errors["offsets"], posterior.prior_std[block]
    lines = []
    for j, std in enumerate(posterior.std[block]):
        factor, unit = (1e3, "mm") if robot.prismatic[j] else (180.0 / np.pi, "deg")
        unseen = " (not observable here)" if std > AT_PRIOR * prior[j] else ""
        value = f"{values[j] * factor:+.4f} ± {std * factor:.4f} {unit}"
        lines.append(f"offset of joint {j + 1}: {value}{unseen}")
    return lines
