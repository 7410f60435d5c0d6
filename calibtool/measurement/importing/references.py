"""Correction of rows for a motion of the instrument, from reference points fixed to the base."""

from dataclasses import replace

import numpy as np

from calibtool.errors import InputError, UsageError
from calibtool.measurement.importing.imported import Imported
from calibtool.measurement.importing.reference_file import read_references
from calibtool.measurement.importing.stated_units import Stated
from calibtool.measurement.reference_motion import (
    InstrumentMotion,
    ReferencePoints,
    instrument_motion,
)
from calibtool.robot.se3 import Array, readonly
from calibtool.units import count_of, millimetres

_APART = 0.01  # m: reference points that are nearer to each other do not show a rotation
_USELESS = 20.0  # times the stated noise: readings that scatter by more are mixed up


def undo_instrument_motion(
    imported: Imported, file: tuple[bytes | str, str] | None = None, stated: Stated = Stated()
) -> tuple[Imported, list[str], bool]:
    """The rows as if all were measured when the references were first read, notes, and whether rows
    moved.

    The instrument's motion is that of `instrument_motion`, over time where both have stamps,
    otherwise over the order of the rows; each labelled place has its own. Rows do not change where
    the motion of the references is within their noise. file: contents and name of a table with the
    readings, instead of columns of the table. Raises UsageError without references and for values
    that are not in an instrument's frame, InputError for readings that do not match the rows.
    """
    measurements, auxiliary = imported.measurements, imported.auxiliary
    table = imported.understood.source.table.name
    if measurements.kind not in ("points", "pose"):
        raise UsageError(
            "--use-references: only points and poses in the frame of one instrument are brought "
            "back"
        )
    if file is None and auxiliary.reference_points is None:
        raise UsageError(
            f"--use-references: {table} has no reference points (ref1_x_mm ref1_y_mm ref1_z_mm …); "
            "map them with [[references]], or give their own table with --references FILE"
        )
    stamps = auxiliary.time_s
    ordered = np.arange(1.0, len(measurements) + 1)
    stamped = stamps is not None and bool(np.isfinite(stamps).all() and np.ptp(stamps) > 0)
    if file is None:
        assert auxiliary.reference_points is not None
        instants = stamps if stamped and stamps is not None else ordered
        references = ReferencePoints(instants, auxiliary.reference_points)
    else:
        references, by_time = read_references(*file, stated)
        if by_time and not stamped:
            raise InputError(
                f"{table}: not every row has a time stamp, but the readings in {file[1]} are found "
                "by theirs; give a column row there, the number of rows measured before each "
                "reading"
            )
        instants = stamps if by_time and stamps is not None else ordered
    place = np.zeros(len(instants), int) if measurements.place is None else measurements.place
    if not len(references.ordered().times):
        raise InputError(f"{file[1] if file else table}: no reference point was read")
    nearest = place[np.abs(references.times[:, None] - instants).argmin(axis=1)]
    points, rotations = measurements.points.copy(), measurements.rotations
    rotations = None if rotations is None else rotations.copy()
    fixed = None if auxiliary.reference_points is None else auxiliary.reference_points.copy()
    notes, moved = [], False
    for number in np.unique(place):
        rows = np.flatnonzero(place == number)
        of = nearest == number
        text, motion = _motion(
            ReferencePoints(references.times[of], references.points[of]),
            instants[rows],
            measurements.points[rows],
            measurements.noise_position,
        )
        label = f"{measurements.places[number]}: " if measurements.places else ""
        notes.append(f"{label}{text}")
        if motion is None:
            continue
        moved = True
        turned = None if rotations is None else rotations[rows]
        points[rows], turned = motion.moved_back(instants[rows], points[rows], turned)
        if rotations is not None:
            rotations[rows] = turned
        if fixed is not None:
            fixed[rows] = motion.moved_back(instants[rows], fixed[rows])[0]
    back = replace(
        measurements,
        points=readonly(points),
        rotations=None if rotations is None else readonly(rotations),
    )
    # What was decided here is not advised again by the checks.
    beside = replace(auxiliary, reference_points=fixed if moved else None)
    return imported._replace(measurements=back, auxiliary=beside), notes, moved


def _motion(
    references: ReferencePoints, instants: Array, points: Array, noise: float
) -> tuple[str, InstrumentMotion | None]:
    """Notes on the readings for points (N, m, 3) measured at instants (N,), and the motion where it
    is significant.
    """
    clean, gross = references.ordered().without_gross(noise)
    readings = len(np.unique(clean.times))
    omitted = f"; {count_of(gross, 'reading')} far from the others left out" if gross else ""
    if readings < 2:
        return f"the reference points were read once only: the rows stay as they are{omitted}", None
    first, last = float(clean.times[0]), float(clean.times[-1])
    if last < instants.min() or first > instants.max():
        raise InputError(
            "every reading of the reference points is "
            f"{'before the first' if last < instants.min() else 'after the last'} row: they do not "
            "say how the instrument moved; check the two clocks"
        )
    places = np.nanmean(clean.points, axis=0)
    apart = np.linalg.norm(places[:, None] - places, axis=-1).max()
    if 0 < apart < _APART:
        raise InputError(
            f"the reference points lie within {millimetres(apart)} of each other; check their unit"
        )
    motion = instrument_motion(clean, noise)
    if motion.noise > _USELESS * noise:
        raise InputError(
            f"the readings of the reference points scatter by {millimetres(motion.noise)}, so they "
            "do not say how the instrument moved; check that every point keeps its columns"
        )
    if not motion.found:
        span = float((np.nanmax(clean.points, axis=0) - np.nanmin(clean.points, axis=0)).max())
        return (
            f"the reference points do not say more than their noise ({motion.noise * 1e3:.2g} mm; "
            f"they differ by up to {span * 1e3:.2g} mm): the rows stay as they are{omitted}"
        ), None
    back, _ = motion.moved_back(instants, points)
    size = float(np.nanmax(np.linalg.norm(back - points, axis=-1)))
    seen = points[np.isfinite(points[..., 0])]
    shift, turn = (np.linalg.norm(part, axis=1).max() for part in np.split(motion.twists, 2, 1))
    outside = int(((instants < first) | (instants > last)).sum())
    ends = (
        f"; {count_of(outside, 'row')} beyond the first or last reading: as there"
        if outside
        else ""
    )
    return (
        f"the reference points move by up to {millimetres(shift)} and {turn * 1e3:.3g} mrad "
        f"against the instrument ({readings} readings, noise {motion.noise * 1e3:.2g} mm): rows "
        f"are brought back into the frame of the first reading, by up to {millimetres(size)} "
        f"± {motion.deviation(seen) * 1e3:.2g} mm at the points{ends}{omitted}"
    ), motion
