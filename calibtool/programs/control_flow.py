"""Control flow of a routine: blocks of statements and their successors."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from calibtool.programs.motions import (
    Assign,
    Begin,
    Break,
    Call,
    Else,
    End,
    Jump,
    Label,
    Move,
    Return,
    Statement,
)

Action = Move | Assign | Call


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive actions without a branch, and the numbers of the blocks that can follow."""

    actions: list[Action] = field(default_factory=list)
    next: list[int] = field(default_factory=list)


@dataclass(eq=False)
class _Open:
    """A selection or loop that has not ended yet: its first block, and the blocks that lead out of
    it.
    """

    head: int
    loop: bool
    once: bool = False
    complete: bool = False  # no way around all branches
    leaving: list[int] = field(default_factory=list)


def blocks(body: Sequence[Statement]) -> list[Block]:
    """The blocks of a routine. The first one is its beginning, the last one, without actions, its
    end.

    A statement that cannot be reached from the beginning, such as an error handler, is assumed to
    follow the beginning directly. Markers without a partner are ignored.
    """
    builder = _Builder()
    for statement in body:
        builder.take(statement)
    return builder.done()


class _Builder:
    def __init__(self) -> None:
        self.blocks = [Block()]
        self.open: list[_Open] = []
        self.labels: dict[str, int] = {}
        self.jumps: list[tuple[int, str]] = []
        self.returns: list[int] = []
        self.here = 0

    def take(self, statement: Statement) -> None:
        if isinstance(statement, Move | Assign | Call):
            self.blocks[self.here].actions.append(statement)
        elif isinstance(statement, Begin):
            self._begin(statement)
        elif isinstance(statement, Else):
            self._else(statement)
        elif isinstance(statement, End):
            self._end()
        elif isinstance(statement, Break):
            inner = next((entry for entry in reversed(self.open) if entry.loop), None)
            if inner is not None:
                inner.leaving.append(self.here)
                self._block()
        elif isinstance(statement, Label):
            self.labels[statement.name] = self._block(self.here)
        elif isinstance(statement, Jump):
            self.jumps.append((self.here, statement.label))
            self._block(*(() if statement.always else (self.here,)))
        elif isinstance(statement, Return):
            self.returns.append(self.here)
            self._block()

    def done(self) -> list[Block]:
        while self.open:
            self._end()
        for start, name in self.jumps:
            if name in self.labels:
                self.blocks[start].next.append(self.labels[name])
        entered = {number for block in self.blocks for number in block.next}
        self.blocks[0].next.extend(k for k in range(1, len(self.blocks)) if k not in entered)
        self._block(self.here, *self.returns)
        return self.blocks

    def _block(self, *before: int) -> int:
        """A new block after others, to which the next statements belong."""
        self.blocks.append(Block())
        self.here = len(self.blocks) - 1
        for number in before:
            self.blocks[number].next.append(self.here)
        return self.here

    def _begin(self, statement: Begin) -> None:
        head = self._block(self.here) if statement.loop else self.here
        self.open.append(_Open(head, statement.loop, statement.once))
        self._block(head)

    def _else(self, statement: Else) -> None:
        if not self.open or self.open[-1].loop:
            return
        entry = self.open[-1]
        entry.leaving.append(self.here)
        entry.complete |= statement.last
        self._block(entry.head)

    def _end(self) -> None:
        if not self.open:
            return
        entry = self.open.pop()
        last = self.here
        if entry.loop:
            self.blocks[last].next.append(entry.head)
            self._block(*entry.leaving, last if entry.once else entry.head)
        else:
            around = () if entry.complete else (entry.head,)
            self._block(*entry.leaving, last, *around)
