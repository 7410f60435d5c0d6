"""Replacement of the numbers of corrected positions in the texts of a program."""

from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO

import numpy as np

from calibtool.compensation.status import MEANING, OK
from calibtool.programs.agreement import Position
from calibtool.programs.branches import Controller
from calibtool.programs.configurations import Digit
from calibtool.programs.frames import poses_values
from calibtool.programs.motions import POSE, Literal, Program
from calibtool.programs.nominal_joints import placed
from calibtool.programs.numbers import Remark, pieces, rewritten
from calibtool.robot.se3 import Array

_NO_CHANGE = 1e-9  # rad or m: the text of a target that changes by less stays as it is
_GUESSED = "its branch is a guess: the program does not state from where the robot comes"
_TURNED = "a joint passes into another turn: its configuration data are changed too"


@dataclass(frozen=True, eq=False)
class NewPositions:
    """The new positions.

    found       (N) the positions, with their frames and tools
    q, q_new    (N, n) nominal and corrected joint positions of the chain, rad or m
    T           (N, 4, 4) T_base_tool by which the controller reaches the corrected joints, m
    T_nominal   (N, 4, 4) T_base_tool of the nominal robot at q, m
    status      (N,) of the compensation
    guessed     (N,) whether the branch is not known
    """

    found: list[Position]
    q: Array
    q_new: Array
    T: Array
    T_nominal: Array
    status: np.ndarray
    guessed: np.ndarray


class Writing:
    """The corrected texts, and what is found while they are written.

    changed    numbers of the literals that have new numbers
    largest_m, largest_rad   the largest change: of the nominal tool's position, and of a joint
    looks      corrected positions that should be checked
    """

    def __init__(self, program: Program, controller: Controller, new: NewPositions) -> None:
        self.program, self.controller, self.new = program, controller, new
        self.changed: set[int] = set()
        self.largest_m = self.largest_rad = 0.0
        self.looks: list[Remark] = []

    def texts(self) -> Iterator[bytes]:
        """The bytes of each source."""
        literals = self.program.literals
        numbers = self._numbers()

        def start(row: int) -> int:
            return literals[self.new.found[row].literal].numbers[0].start

        rows: list[list[int]] = [[] for _ in self.program.sources]
        for row, position in enumerate(self.new.found):
            rows[literals[position.literal].source].append(row)
        for source, here in zip(self.program.sources, rows, strict=True):
            if not source.edited:
                yield source.text.encode("latin-1")
                continue
            here.sort(key=start)
            edits = (edit for row in here for edit in self._edits(row, numbers, source.text))
            corrected = BytesIO()
            corrected.writelines(piece.encode("latin-1") for piece in pieces(source.text, edits))
            yield corrected.getvalue()

    def _numbers(self) -> Array:
        """The numbers to write: controller's joint values, or poses in their frames; (N, 7)."""
        literals = [self.program.literals[position.literal] for position in self.new.found]
        joints = self.controller.to_controller(self.new.q_new)
        result = np.zeros((len(literals), max(7, joints.shape[1])))
        result[:, : joints.shape[1]] = joints
        groups: dict[str, list[int]] = {}
        for k, literal in enumerate(literals):
            if literal.kind == POSE:
                groups.setdefault(literal.orientation, []).append(k)
        for orientation, rows in groups.items():
            near = np.array([literals[k].values for k in rows])
            here = placed(self.new.T[rows], [self.new.found[k] for k in rows], back=True)
            result[rows, : near.shape[1]] = poses_values(here, orientation, near)
        return result

    def _edits(self, row: int, numbers: Array, text: str) -> list[tuple[int, int, str]]:
        """The changes in the text of one position, in order."""
        number = self.new.found[row].literal
        literal = self.program.literals[number]
        turned = np.abs(self.new.q_new[row] - self.new.q[row])
        self._look(literal, row)
        moved = np.abs(self.new.T[row] - self.new.T_nominal[row]).max()
        if turned.max() < _NO_CHANGE and (literal.kind != POSE or moved < _NO_CHANGE):
            return []
        values = numbers[row, : len(literal.numbers)].tolist()
        edits = rewritten(text, literal.numbers, values)
        digits = self._digits(literal, row)
        if digits:
            self.looks.append(remark_of(literal, _TURNED))
        if literal.external:
            joints = self.controller.to_controller(self.new.q_new[row])
            axes, beside = zip(*literal.external, strict=True)
            edits += rewritten(text, beside, joints[list(axes)].tolist())
        edits += [(digit.start, digit.end, str(value)) for digit, value in digits]
        if edits:
            revolute = ~np.array(self.controller.robot.prismatic)
            self.changed.add(number)
            shift = self.new.T[row, :3, 3] - self.new.T_nominal[row, :3, 3]
            self.largest_m = max(self.largest_m, float(np.linalg.norm(shift)))
            self.largest_rad = max(self.largest_rad, float(turned[revolute].max(initial=0.0)))
        return sorted(edits)

    def _digits(self, literal: Literal, row: int) -> list[tuple[Digit, int]]:
        """Configuration data to change: right before, and wrong for the corrected joints."""
        data = literal.configuration
        arm = self.controller.robot.arm
        if data is None or not data.turns(self.controller.to_controller(self.new.q[row])[arm]):
            return []
        return data.digits(self.controller.to_controller(self.new.q_new[row])[arm])

    def _look(self, literal: Literal, row: int) -> None:
        status = str(self.new.status[row])
        if status != OK:
            self.looks.append(remark_of(literal, MEANING[status]))
        if self.new.guessed[row]:
            self.looks.append(remark_of(literal, _GUESSED))


def remark_of(literal: Literal, why: str) -> Remark:
    """A remark on a literal."""
    return Remark(literal.line, literal.name, why, source=literal.source)
