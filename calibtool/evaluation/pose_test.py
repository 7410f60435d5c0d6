"""Pose accuracy AP and repeatability RP after ISO 9283, from repeated configurations."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from calibtool.evaluation.metrics import MethodErrors
from calibtool.robot.se3 import Array

FEWEST = 3  # repeats of a configuration that make a group; the standard asks for 30
_SAME = 1e-8  # joint positions that differ by less, rad or m, are the same command
_CENTRED = 0.01  # P1 is the centre of the others to this part of their extent


@dataclass(frozen=True, eq=False)
class RepeatedPose:
    """One commanded configuration and its repeats.

    name  P1 … P5 where the poses are those of the standard's cube, else `configuration k`
          by its first row
    rows  (r,) its rows, in the order of measurement
    """

    name: str
    rows: np.ndarray


@dataclass(frozen=True, eq=False)
class PoseTest:
    """AP of every method (m, p) and RP (p,) at p poses: position in m, orientation in rad, None
    where it is not seen.

    AP  distance from the commanded pose, as the method predicts it, to the barycentre of
        the attained ones
    RP  mean + 3 standard deviations (r − 1) of the distances from the barycentre; the same
        for every method

    The position is that of the barycentre of the target points. Orientations are rotation
    vectors, distances their lengths: one number instead of the standard's three angles. Where the
    commands were measured before a correction, too, `before` holds the RP of those rows: position
    and turn, (p,) each.
    """

    poses: list[RepeatedPose]
    methods: list[str]
    accuracy: Array
    repeatability: Array
    accuracy_turn: Array | None
    repeatability_turn: Array | None
    before: tuple[Array, Array | None] | None = None

    def alone(self, k: int) -> Self:
        """AP of the k-th method alone, and RP."""
        turned = self.accuracy_turn
        turned = None if turned is None else turned[k : k + 1]
        return replace(
            self,
            methods=self.methods[k : k + 1],
            accuracy=self.accuracy[k : k + 1],
            accuracy_turn=turned,
        )

    def as_json(self) -> dict[str, object]:
        """The object `iso9283` of `evaluate --json`."""

        def listed(values: Array | None) -> list[float] | None:
            return None if values is None else (values * 1e3).tolist()

        def of_method(values: Array | None, k: int) -> list[float] | None:
            return None if values is None else listed(values[k])

        earlier: dict[str, object] = {}
        if self.before is not None:
            position, turn = map(listed, self.before)
            earlier = {"rp_before_mm": position, "rp_before_mrad": turn}
        return {
            "poses": [pose.name for pose in self.poses],
            "first_configurations": [int(pose.rows[0]) + 1 for pose in self.poses],
            "repeats": [len(pose.rows) for pose in self.poses],
            "rp_mm": listed(self.repeatability),
            "rp_mrad": listed(self.repeatability_turn),
            **earlier,
            "methods": [
                {
                    "name": name,
                    "ap_mm": of_method(self.accuracy, k),
                    "ap_mrad": of_method(self.accuracy_turn, k),
                }
                for k, name in enumerate(self.methods)
            ],
        }


def repeated_poses(q: Array, position: Array) -> list[RepeatedPose]:
    """Configurations among q (N, n) that occur at least `FEWEST` times, named; none where
    nothing was repeated.

    position (N, 3): commanded tool points, m, by which the poses of the standard's cube are
    recognised: five, the last or the first in the middle of the others.
    """
    _, first, group = np.unique(np.round(q / _SAME), axis=0, return_index=True, return_inverse=True)
    group = group.reshape(-1)
    order = sorted((int(start), k) for k, start in enumerate(first))
    rows = [np.flatnonzero(group == k) for _, k in order]
    rows = [r for r in rows if len(r) >= FEWEST]
    names = [f"configuration {int(r[0]) + 1}" for r in rows]
    if len(rows) == 5:
        centres = np.array([position[r[0]] for r in rows])
        if _is_centre(centres[4], centres[:4]):  # a cycle from P5 to P1
            rows, names = rows[::-1], [f"P{k}" for k in range(1, 6)]
        elif _is_centre(centres[0], centres[1:]):
            names = [f"P{k}" for k in range(1, 6)]
    return [RepeatedPose(name, r) for name, r in zip(names, rows, strict=True)]


def pose_test(methods: list[MethodErrors], poses: list[RepeatedPose]) -> PoseTest:
    """AP and RP from measured minus predicted errors. RP uses those of the first method, whose
    prediction is the same within a group.
    """
    position = [errors.position.mean(axis=1) for errors in methods]
    turns = [errors.orientation for errors in methods]
    accuracy, repeatability = _accuracy_and_repeatability(position, poses)
    accuracy_turn = repeatability_turn = None
    if all(turn is not None for turn in turns):
        accuracy_turn, repeatability_turn = _accuracy_and_repeatability(
            [t for t in turns if t is not None], poses
        )
    return PoseTest(
        poses,
        [errors.name for errors in methods],
        accuracy,
        repeatability,
        accuracy_turn,
        repeatability_turn,
    )


def measured_pose_test(
    before: MethodErrors, after: MethodErrors, poses: list[RepeatedPose], *, before_measured: bool
) -> PoseTest:
    """AP of before and after a correction from commanded against measured errors,
    RP of those after.

    before_measured: RP before, too; expected errors have no scatter.
    """
    test = pose_test([after, before], poses)
    alone = pose_test([before], poses) if before_measured else None
    turned = test.accuracy_turn
    return replace(
        test,
        methods=test.methods[::-1],
        accuracy=test.accuracy[::-1],
        accuracy_turn=None if turned is None else turned[::-1],
        before=None if alone is None else (alone.repeatability, alone.repeatability_turn),
    )


def _accuracy_and_repeatability(
    errors: list[Array], poses: list[RepeatedPose]
) -> tuple[Array, Array]:
    """AP (m, p) and RP (p,) from errors (N, 3) per method."""
    accuracy = np.array(
        [[np.linalg.norm(e[pose.rows].mean(axis=0)) for pose in poses] for e in errors]
    )
    repeatability = []
    for pose in poses:
        attained = errors[0][pose.rows]
        distance = np.linalg.norm(attained - attained.mean(axis=0), axis=-1)
        repeatability.append(distance.mean() + 3.0 * distance.std(ddof=1))
    return accuracy, np.array(repeatability)


def _is_centre(point: Array, others: Array) -> bool:
    extent = np.linalg.norm(np.ptp(others, axis=0))
    return bool(extent > 0 and np.linalg.norm(point - others.mean(axis=0)) < _CENTRED * extent)
