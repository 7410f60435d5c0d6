"""Several files of measurements as one; each file's set-up becomes a labelled place."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibtool.errormodel.operating_conditions import Conditions
from calibtool.errors import InputError
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.registration import register
from calibtool.robot.se3 import Array, readonly


def merged(parts: Sequence[tuple[str, Measurements]]) -> Measurements:
    """The rows of named files in their order, with the same targets on the tool.

    Each place of each file becomes a place of its own. The set-up is registered with the nominal
    robot. Raises InputError for different robots, kinds of observation, numbers of targets or known
    set-ups, and for wires.
    """
    (name, first), *others = parts
    if not others:
        return first
    for other_name, other in others:
        what = next((what for what, same in _alike(first, other).items() if not same), None)
        if what is not None:
            raise InputError(f"{other_name}: {what} differs from {name}; identify them apart")
    if first.kind == "distance" or first.setup.frame_known:
        why = "the fixed points of wires" if first.kind == "distance" else "a known frame"
        raise InputError(f"{name}: files with {why} are not taken together; import them as one")
    labels: list[str] = []
    place: list[np.ndarray] = []
    for part_name, part in parts:
        own = part.places or ("",)
        number = np.zeros(len(part), dtype=int) if part.place is None else part.place
        place.append(number + len(labels))
        labels += [f"{part_name} {label}".strip() for label in own]
    every = [part for _, part in parts]
    setup = replace(first.setup, **_environment(first, len(labels)))  # type: ignore[arg-type]
    setup = replace(setup, places=tuple(labels))
    rows = replace(
        first,
        q=_joined([part.q for part in every]),
        points=_joined([part.points for part in every]),
        rotations=None
        if first.rotations is None
        else _joined([part.rotations for part in every if part.rotations is not None]),
        values=None
        if first.values is None
        else _joined([part.values for part in every if part.values is not None]),
        setup=setup,
        truth=None,
        conditions=_conditions(every),
        deviations=_joined([_deviations(part) for part in every]),
        place=np.concatenate(place),
        findings=tuple(finding for part in every for finding in part.findings),
        commanded=None,
    )
    return replace(rows, setup=register(rows))


def _alike(one: Measurements, other: Measurements) -> dict[str, bool]:
    """The properties that two files must share, in words, and whether they do."""
    source = one.robot.source
    return {
        "the robot": source.toml_text == other.robot.source.toml_text,
        "the kind of observation": one.kind == other.kind,
        "the number of targets": len(one.setup.targets) == len(other.setup.targets),
        "what is known of the set-up": (one.setup.frame_known, one.setup.targets_known)
        == (other.setup.frame_known, other.setup.targets_known),
    }


def _environment(first: Measurements, places: int) -> dict[str, Array]:
    """The arrays of the set-up with one entry per place, as a start."""
    setup = first.setup
    if setup.planes is not None:
        return {"planes": readonly(np.tile(setup.planes[:1], (places, 1)))}
    if setup.T_base_boards is not None:
        return {"T_base_boards": readonly(np.tile(setup.T_base_boards[:1], (places, 1, 1)))}
    return {"further_frames": readonly(np.tile(setup.T_instrument_base, (places - 1, 1, 1)))}


def _joined(arrays: Sequence[Array]) -> Array:
    return readonly(np.concatenate(arrays))


def _deviations(part: Measurements) -> Array:
    """Standard deviations of every coordinate (N, d), stated for all or for each."""
    if part.deviations is not None:
        return part.deviations
    lengths = part.setup.kind.lengths(part.setup)
    sigma = np.where(lengths, part.noise_position, part.noise_orientation)
    return np.tile(sigma, (len(part), 1))


def _conditions(parts: Sequence[Measurements]) -> Conditions:
    """The conditions of the rows that all files state."""
    known: dict[str, Array] = {}
    for name in ("direction", "payload_kg", "temperature_c"):
        values = [getattr(part.conditions, name) for part in parts]
        if all(value is not None and np.ndim(value) for value in values):
            known[name] = _joined(values)
    return Conditions(**known)
