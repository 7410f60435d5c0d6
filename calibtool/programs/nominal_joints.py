"""Joint positions of the nominal robot at each use of a position, solved along the motions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibtool.programs.agreement import Position
from calibtool.programs.branches import Answers, Controller, solve
from calibtool.programs.configurations import Configuration
from calibtool.programs.frames import poses
from calibtool.programs.motion_flow import Flow, Use
from calibtool.programs.motions import JOINT, Program
from calibtool.programs.sequential_poses import follow_forest, forest
from calibtool.robot.se3 import Array, inverse

_SAME = 1e-6  # rad or m: joint positions that differ by less are one answer


@dataclass(frozen=True, eq=False)
class NominalJoints:
    """Joint positions of the nominal robot at the positions of a program.

    q        per position the different joint positions of its uses, (n,) each; none if one of them
             has no solution
    why      per position the reason, otherwise ""
    guessed  per position whether the branch of one of its uses is not known
    T        (M, 4, 4) T_base_tool of the positions; the identity for joint targets
    """

    q: list[list[Array]]
    why: list[str]
    guessed: list[bool]
    T: Array


def nominal_joints(
    controller: Controller, program: Program, flow: Flow, found: Sequence[Position]
) -> NominalJoints:
    """Solve every use of every position, near the previous use where the controller does so."""
    return _Solving(controller, program, flow, found).result()


class _Solving:
    """Arrays over the uses: joints q (N, n), which are joint targets, and whose branch is known."""

    def __init__(
        self, controller: Controller, program: Program, flow: Flow, found: Sequence[Position]
    ) -> None:
        self.controller, self.uses, self.found = controller, flow.uses, found
        self.literals = program.literals
        self.T = _flange_poses(program, found)
        count = len(self.uses)
        self.place = np.full(count, -1)  # the position of a use
        for number, position in enumerate(found):
            self.place[list(position.uses)] = number
        self.why = [""] * count
        self.on_branch = np.zeros(count, dtype=bool)
        written = [
            number
            for number, literal in enumerate(self.literals)
            if literal.kind == JOINT and not literal.not_corrected and number not in flow.spoiled
        ]
        self.written: dict[int, Array] = {}
        if written:
            values = np.array([self.literals[k].values for k in written])
            self.written = dict(zip(written, controller.to_serial(values), strict=True))
        self.q = np.tile(controller.home, (count, 1))
        self.fixed = np.array([use.literal in self.written for use in self.uses], dtype=bool)
        known = self.fixed | (self.place >= 0)
        self.before: list[tuple[int, ...]] = []
        self.sure = np.zeros(count, dtype=bool)
        for k, use in enumerate(self.uses):
            near = next((n for n in use.near if n in self.written), None)
            seed = use.literal if self.fixed[k] else near
            if seed is not None:
                self.q[k], self.sure[k] = self.written[seed], True
                self.before.append(())
            else:
                self.sure[k] = use.sure and all(known[b] for b in use.before)
                self.before.append(use.before)

    def result(self) -> NominalJoints:
        trees = forest(self.before, self.fixed.tolist())
        for row in trees.order:  # parts begin from the joints before them that are known
            if trees.parents[row] >= 0:
                self.q[row] = self.q[trees.parents[row]]
        self.q = follow_forest(trees, self.q, self._solve)
        others = self._from_other_sides(trees.parents)
        q: list[list[Array]] = []
        why: list[str] = []
        guessed: list[bool] = []
        for position in self.found:
            uses = position.uses
            rows = [self.q[k] for k in uses] + [row for k in uses for row in others.get(k, ())]
            why.append(next((self.why[k] for k in uses if self.why[k]), ""))
            q.append([] if why[-1] else _different(rows))
            guessed.append(any(not self.sure[k] and not self.on_branch[k] for k in uses))
        return NominalJoints(q, why, guessed, self.T)

    def _solve(self, rows: np.ndarray, start: Array) -> Array:
        """Solutions of uses near `start`, the previous position of the robot."""
        q = np.where(self.fixed[rows, None], self.q[rows], start)
        here = np.flatnonzero((self.place[rows] >= 0) & ~self.fixed[rows])
        if len(here):
            answers = self._answers(rows[here], start[here])
            for k, why in zip(rows[here], answers.why, strict=True):
                self.why[k] = why
            self.on_branch[rows[here]] = answers.obeyed
            q[here[answers.found]] = answers.q[answers.found]
        return q

    def _answers(self, uses: np.ndarray, start: Array) -> Answers:
        configurations, strict = zip(
            *(self._configuration(self.uses[k], self.sure[k]) for k in uses), strict=True
        )
        start, external = start.copy(), []
        for row, use in enumerate(uses.tolist()):
            for joint, number in self.literals[self.uses[use].literal].external:
                start[row, joint] = number.value
                external.append((row, joint, number.value))
        answers = solve(
            self.controller, self.T[self.place[uses]], start, configurations, np.array(strict)
        )
        for row, joint, value in external:
            if abs(answers.q[row, joint] - value) > _SAME:
                answers.why[row] = f"the external axis at joint {joint + 1} is outside its limits"
        return answers

    def _configuration(self, use: Use, sure: bool) -> tuple[Configuration | None, bool]:
        """The configuration data to use, and whether they decide; where the controller stays near
        the previous position, they only help.
        """
        configuration = self.literals[use.literal].configuration
        if use.obeyed is False and sure:
            return None, False
        return configuration, use.obeyed is True

    def _from_other_sides(self, parents: np.ndarray) -> dict[int, list[Array]]:
        """Solutions of uses that the robot may also reach from other positions."""
        pairs = [
            (k, other)
            for k, before in enumerate(self.before)
            if len(before) > 1 and self.place[k] >= 0 and not self.fixed[k]
            for other in before
            if other != parents[k]
        ]
        if not pairs:
            return {}
        rows, others = np.array(pairs).T
        answers = self._answers(rows, self.q[others])
        found: dict[int, list[Array]] = {}
        for k in np.flatnonzero(answers.found):
            found.setdefault(int(rows[k]), []).append(answers.q[k])
        return found


def _flange_poses(program: Program, found: Sequence[Position]) -> Array:
    """T_base_tool of each position, with the description's tool; the identity for joints."""
    T = np.tile(np.eye(4), (len(found), 1, 1))
    groups: dict[str, list[int]] = {}
    for number, position in enumerate(found):
        literal = program.literals[position.literal]
        if literal.kind != JOINT:
            groups.setdefault(literal.orientation, []).append(number)
    for orientation, rows in groups.items():
        values = np.array([program.literals[found[k].literal].values for k in rows])
        T[rows] = placed(poses(values, orientation), [found[k] for k in rows])
    return T


def placed(T: Array, found: Sequence[Position], back: bool = False) -> Array:
    """Poses (N, 4, 4) in frame and tool as T_base_tool of the description; back: the inverse."""
    frames: dict[tuple[float, ...], list[int]] = {}
    for row, position in enumerate(found):
        assert position.frame is not None
        assert position.tool is not None
        assert position.frame.values is not None
        assert position.tool.values is not None
        frames.setdefault(position.frame.values + position.tool.values, []).append(row)
    result = np.empty_like(T)
    for values, rows in frames.items():
        frame, tool = np.reshape(values, (2, 4, 4))
        if back:
            result[rows] = inverse(frame) @ T[rows] @ tool
        else:
            result[rows] = frame @ T[rows] @ inverse(tool)
    return result


def _different(rows: Sequence[Array]) -> list[Array]:
    found: list[Array] = []
    for q in rows:
        if all(np.abs(q - other).max() > _SAME for other in found):
            found.append(q)
    return found
