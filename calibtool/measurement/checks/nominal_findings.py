"""Comparison with the nominal robot, and the single mistakes that would explain a bad fit."""

from dataclasses import replace
from itertools import permutations

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from calibtool.measurement.checks.finding import Finding, Numbers, listed
from calibtool.measurement.checks.groups import groups_of_rows
from calibtool.measurement.checks.mistakes import mistakes
from calibtool.measurement.checks.nominal_fit import Fit, nominal_fit
from calibtool.measurement.checks.zeros import zero_of_one_joint, zeros_of_all_joints
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.sampling import spread_rows
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import readonly, transform_points
from calibtool.units import count_of, millimetres

# Of the length, and m: no arm differs from its drawing by more
_SUSPICIOUS, _AT_LEAST = 1.5e-2, 5e-3
_GROSS = 3e-2  # of the length: the same limit where no tried mistake explains the residual
_TARGETS_APART = 5e-3  # m: farther apart than one target that was measured again
_BETTER = 3.0  # how much better the data must be explained before a mistake is named
_FAR = 4.0  # times the median: rows with a larger residual are left out in one trial
_ALIKE = 1.5  # explanations whose residuals differ by a smaller factor are named together
_OF_SPREAD = 0.1  # of the spread of the points: an explanation must leave a smaller residual
_FEWER = 10.0  # how much better explanations with more unknowns must explain the data
_MOST_ROWS = 150  # number of rows that is enough to distinguish the explanations


def nominal_findings(measurements: Measurements, stated: Fit) -> tuple[list[Finding], np.ndarray]:
    """Wrong units, axes, joints, orders of targets or set-up; and the rows (k,) whose targets are
    swapped.

    stated: the fit with what is known of the set-up kept.
    """
    none = np.zeros(0, dtype=int)
    swapped, rows = _swapped_rows(measurements, stated)
    if swapped is not None:
        return [swapped], rows
    limit = max(_SUSPICIOUS * measurements.robot.length, _AT_LEAST)
    if stated.rms < limit:
        order = _other_order(measurements, stated.setup)
        zero = _small_zero(measurements)
        row = None if zero else _rows_off(measurements)
        return [*zero, *(each for each in (row, order) if each is not None)], none
    given = measurements.setup.frame_known or measurements.setup.targets_known
    free = nominal_fit(measurements, free=True) if given else stated
    if free.rms >= limit:
        return _single_mistake(measurements), none
    if stated.rms > _BETTER * free.rms:
        return [_wrong_setup(measurements, stated.rms, free)], none
    return [], none


def orientation_finding(measurements: Measurements, fit: Fit) -> Finding | None:
    """Whether the sensor of a 6-D instrument turns with the tool."""
    if measurements.rotations is None or len(measurements) < 3 or not np.isfinite(fit.rms):
        return None
    T_base_tool = measurements.robot.mechanism.forward(measurements.q)
    R_instrument_tool = fit.setup.T_instrument_base[:3, :3] @ T_base_tool[:, :3, :3]
    sensors = Rotation.from_matrix(np.swapaxes(R_instrument_tool, -1, -2) @ measurements.rotations)
    spread = float(np.sqrt(np.mean((sensors * sensors.mean().inv()).magnitude() ** 2)))
    if spread < np.deg2rad(5):
        return None
    message = (
        f"the measured orientations differ from the robot's by {np.rad2deg(spread):.3g} deg rms "
        "although its positions fit; check the convention and the unit of the angles"
    )
    return Finding(
        "orientation_convention", "warning", message, {"rms_deg": float(np.rad2deg(spread))}
    )


def _single_mistake(measurements: Measurements) -> list[Finding]:
    """The mistake without which the robot explains the points, or a finding that none does."""
    rows = spread_rows(len(measurements), _MOST_ROWS)
    some = measurements.rows(rows)
    before = nominal_fit(some, free=True).rms
    explained = max(_SUSPICIOUS * measurements.robot.length, _AT_LEAST)
    tried = []
    for mistake in mistakes(measurements, rows):
        rms = nominal_fit(mistake.repaired, free=True).rms
        if rms < min(explained, _OF_SPREAD * _spread(mistake.repaired)):
            tried.append((rms, mistake))
    best = min((rms for rms, _ in tried), default=np.inf)
    groups = groups_of_rows(measurements, explained)
    if groups is not None and groups.rms * _FEWER < min(best, before):
        return [groups.finding(before)]
    zero = (
        None
        if best * _BETTER < before and best < explained / _FEWER
        else zero_of_one_joint(some, grid=True)
    )
    explained = min(explained, _OF_SPREAD * _spread(some))
    if zero is not None and zero.rms * _BETTER < min(best, before) and zero.rms < explained:
        return [zero.finding(before)]
    if best * _BETTER < before:
        alike = [mistake for rms, mistake in tried if rms <= _ALIKE * best]
        message = (
            f"the nominal robot fits the points to {millimetres(before)} rms, but to "
            f"{millimetres(best)} if {' or '.join(mistake.text for mistake in alike[:3])}"
        )
        numbers: Numbers = (
            {"rms_mm": before * 1e3, "repaired_rms_mm": best * 1e3} if np.isfinite(before) else {}
        )
        return [Finding(alike[0].name, "warning", message, numbers)]
    if (rows_off := _rows_off(measurements)) is not None:
        return [rows_off]
    zeros = zeros_of_all_joints(some)
    if zeros is not None and zeros.rms * _BETTER < before and zeros.rms < explained:
        return [zeros.finding(before)]
    if not _GROSS * measurements.robot.length < before < np.inf:
        return []
    message = (
        f"the nominal robot fits the points to {millimetres(before)} rms only; check the robot, "
        "its zero positions, the joint columns with their units and signs, and that rows of joints "
        f"and of points belong together{_list_of_targets(measurements)}"
    )
    return [Finding("nominal_robot", "warning", message, {"rms_mm": before * 1e3})]


def _list_of_targets(measurements: Measurements) -> str:
    """What explains one point per row where the joints repeat, k rows each, and the points do not;
    the end of a message.
    """
    q, points = measurements.q, measurements.points
    if points.shape[1] != 1 or measurements.setup.kind.id != "points":
        return ""
    starts = np.flatnonzero(np.r_[True, (np.diff(q, axis=0) != 0).any(axis=1), True])
    runs = np.diff(starts)
    k = int(runs.max())
    if k < 2 or np.mean(runs == k) < 0.9:
        return ""
    steps = np.linalg.norm(np.diff(points[:, 0], axis=0), axis=-1)
    within = np.delete(steps, starts[1:-1] - 1)
    if np.nanmedian(within) < _TARGETS_APART:
        return ""
    return (
        f"; {k} rows each repeat their joints: where they are {k} targets of one configuration, "
        "name them in a column (P1_T1, P1_T2 …)"
    )


def _spread(measurements: Measurements) -> float:
    """Rms distance of the points from their mean, m; small for an arm that hardly moves."""
    points = measurements.points[measurements.seen]
    return float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=-1).mean()))


def _small_zero(measurements: Measurements) -> list[Finding]:
    """One joint with a small offset of its zero position, in data that otherwise fit the robot."""
    zero = zero_of_one_joint(measurements, grid=False)
    if zero is None:
        return []
    before = nominal_fit(measurements, free=True).rms
    return [zero.finding(before)] if zero.rms * _BETTER < before else []


def _rows_off(measurements: Measurements) -> Finding | None:
    """A few rows without which all others fit: a slipped decimal, joints of another row."""
    kept = np.arange(len(measurements))
    before = after = nominal_fit(measurements, free=True)
    for _ in range(10):
        size = np.sqrt((after.residual**2).sum(axis=-1))
        near = size < _FAR * np.median(size)
        if near.all() or near.sum() < 0.8 * len(measurements):
            break
        kept = kept[near]
        after = nominal_fit(measurements.rows(kept), free=True)
        if not np.isfinite(after.rms):
            break
    rows = np.setdiff1d(np.arange(len(measurements)), kept)
    if not len(rows) or not after.rms * _BETTER < before.rms:
        return None
    those = f"row {listed(rows)} does" if len(rows) == 1 else f"rows {listed(rows)} do"
    message = (
        f"{those} not belong to the others: the nominal robot fits the points "
        f"to {millimetres(before.rms)} rms, "
        f"without {'it' if len(rows) == 1 else 'them'} to {millimetres(after.rms)}"
    )
    numbers: Numbers = {
        "rows": [int(r) + 1 for r in rows],
        "rms_mm": before.rms * 1e3,
        "repaired_rms_mm": after.rms * 1e3,
    }
    return Finding("rows_out_of_place", "warning", message, numbers)


def _wrong_setup(measurements: Measurements, before: float, free: Fit) -> Finding:
    """A given set-up that does not fit: targets in another order, a wrong frame or targets."""
    setup, m = measurements.setup, len(measurements.setup.targets)
    if setup.targets_known and 2 <= m <= 5:
        tried = []
        for order in permutations(range(m)):
            permuted = replace(setup, targets=readonly(setup.targets[list(order)]))
            tried.append(
                (nominal_fit(replace(measurements, setup=permuted), free=False).rms, order)
            )
        after, order = min(tried)
        if after * _BETTER < before:
            message = (
                f"the targets fit to {millimetres(before)} rms in the order given, but to "
                f"{millimetres(after)} as {listed(order)}; sort their columns"
            )
            numbers: Numbers = {
                "order": [i + 1 for i in order],
                "rms_mm": before * 1e3,
                "repaired_rms_mm": after * 1e3,
            }
            return Finding("target_order", "warning", message, numbers)
    given = " and ".join(
        what
        for what, known in (
            ("instrument frame", setup.frame_known),
            ("targets on the tool", setup.targets_known),
        )
        if known
    )
    message = (
        f"with the {given} as given the points fit to {millimetres(before)} rms, with an estimated "
        f"set-up to {millimetres(free.rms)}; check what was given, or leave it out"
    )
    return Finding(
        "given_setup",
        "warning",
        message,
        {"rms_mm": before * 1e3, "estimated_rms_mm": free.rms * 1e3},
    )


def _other_order(measurements: Measurements, setup: Setup) -> Finding | None:
    """Estimated targets that are where the robot's description has them, but in another order."""
    targets = measurements.robot.targets
    if measurements.setup.targets_known or len(targets) != len(setup.targets) or len(targets) < 2:
        return None
    apart = np.linalg.norm(setup.targets[:, None] - targets[None], axis=-1)
    order = linear_sum_assignment(apart)[1]
    spread = float(np.linalg.norm(targets - targets.mean(axis=0), axis=-1).max())
    if (order == np.arange(len(order))).all() or apart[
        np.arange(len(order)), order
    ].max() > 0.1 * spread:
        return None
    message = (
        f"the targets stand where {measurements.robot.name} has its targets {listed(order)}, in "
        "this order; harmless while they are estimated, wrong with --robot-targets"
    )
    return Finding("target_order", "note", message, {"order": [int(i) + 1 for i in order]})


def _swapped_rows(measurements: Measurements, stated: Fit) -> tuple[Finding | None, np.ndarray]:
    """Rows whose targets are in another order than in the other rows of the file."""
    count, none = len(measurements), np.zeros(0, dtype=int)
    if len(measurements.setup.targets) < 2 or not np.isfinite(stated.rms):
        return None, none
    best, answer = stated.rms / _BETTER, None
    parts = [np.arange(count), np.arange(count // 2), np.arange(count // 2, count)]
    for part in parts if stated.rms > _SUSPICIOUS * measurements.robot.length else parts[:1]:
        orders = None
        sorted_points, fit = measurements, nominal_fit(measurements.rows(part), free=False)
        for _ in range(5):  # the set-up and the orders in turn
            previous, orders = orders, _orders(measurements, fit.setup)
            if previous is not None and (orders == previous).all():
                break
            points = np.take_along_axis(measurements.points, orders[..., None], axis=1)
            sorted_points = replace(measurements, points=readonly(points))
            fit = nominal_fit(sorted_points, free=False)
        if fit.rms < best and orders is not None:
            best, answer = fit.rms, orders
    if answer is None:
        return None, none
    usual, counts = np.unique(answer, axis=0, return_counts=True)
    rows = np.flatnonzero((answer != usual[np.argmax(counts)]).any(axis=-1))
    if not len(rows):
        return None, none
    message = (
        f"in {count_of(len(rows), 'row')} the targets are in another order than in the rest (row "
        f"{listed(rows)}): sorted, the nominal "
        f"robot fits the points to {millimetres(best)} instead of {millimetres(stated.rms)} rms"
    )
    numbers: Numbers = {
        "rows": [int(r) + 1 for r in rows],
        "rms_mm": stated.rms * 1e3,
        "repaired_rms_mm": best * 1e3,
    }
    return Finding("target_order", "warning", message, numbers), rows


def _orders(measurements: Measurements, setup: Setup) -> np.ndarray:
    """Which measured point is target i in each row, by a set-up: (N, m); the given order unless
    another one is far better.
    """
    poses = setup.T_instrument_base @ measurements.robot.mechanism.forward(measurements.q)
    predicted = transform_points(poses, setup.targets)
    apart = np.nan_to_num(
        ((predicted[:, :, None] - measurements.points[:, None]) ** 2).sum(axis=-1)
    )
    own = np.arange(len(setup.targets))
    orders = np.tile(own, (len(apart), 1))
    for k, cost in enumerate(apart):
        order = linear_sum_assignment(cost)[1]
        if _BETTER**2 * cost[own, order].sum() < cost[own, own].sum():
            orders[k] = order
    return orders
