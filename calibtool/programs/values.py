"""Sets of possible values of a program's variables, and values computed from them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from calibtool.programs.frames import NamedFrames, pose, pose_values
from calibtool.programs.motions import (
    FRAME,
    POSE,
    Edited,
    Either,
    Entry,
    Frame,
    Literal,
    Product,
    Setting,
    Unknown,
    Value,
    frame_of,
)
from calibtool.robot.orientation import QUATERNION

_DIFFERENT = 8  # with more computed values than this, a place counts as unknown


Atom = int | Frame | Unknown | Setting | Entry | Product | Edited  # the last two hold an Entry
Atoms = frozenset[Atom]
MANY = Unknown("takes too many different values")


def joined(one: Atoms, other: Atoms) -> Atoms:
    """The union of both sets of values."""
    if one is other or not other:
        return one
    if not one:
        return other
    both = one | other
    return one if len(both) == len(one) else _few(both)


def _few(atoms: Atoms) -> Atoms:
    """The set; with too many values that are no literals, MANY replaces those."""
    if len(atoms) > _DIFFERENT or MANY in atoms:
        literals = frozenset(atom for atom in atoms if isinstance(atom, int))
        if MANY in atoms or len(atoms) - len(literals) > _DIFFERENT:
            return literals | {MANY}
    return atoms


def _factors(part: Atom, of: Product) -> tuple[Value, ...]:
    """The factors of a part of a product: its own, so that long chains are not nested deeply."""
    if isinstance(part, Product) and part.kind == of.kind and part.name is None:
        return part.parts
    return (part,)


@dataclass(eq=False)
class ValueAnalysis:
    """Values of variables and of expressions.

    literals  positions by their numbers
    frames    positions that are used as frames or tools
    given     frames and tools by name, which take precedence over those of the program
    owners    of each literal the variables to which it is assigned
    spoiled   literals that are no constants because a component of such a variable, or of a copy,
              is assigned, and why
    """

    literals: Sequence[Literal]
    given: NamedFrames
    owners: Mapping[int, set[str]]
    spoiled: dict[int, str] = field(default_factory=dict)
    frames: set[int] = field(default_factory=set)
    _constants: dict[Value, Atoms] = field(default_factory=dict)
    _pending: dict[Atoms, bool] = field(default_factory=dict)
    _products: dict[tuple[str, str | None, tuple[Atom, ...]], Atom] = field(default_factory=dict)

    def atoms(self, value: Value, variable: Callable[[str], Atoms]) -> Atoms:
        """The possible values of a value; variable: of a variable."""
        if isinstance(value, str):
            return variable(value)
        if isinstance(value, Entry):
            return variable(value.name)
        if isinstance(value, Frame | Setting | int):
            if value not in self._constants:
                known = self._known(value) if isinstance(value, Frame) else value
                self._constants[value] = frozenset([known])
            return self._constants[value]
        if isinstance(value, Either):
            return _few(frozenset().union(*(self.atoms(p, variable) for p in value.parts)))
        if isinstance(value, Product):
            parts = [self.atoms(part, variable) for part in value.parts]
            if math.prod(map(len, parts)) > _DIFFERENT**2:
                return frozenset([MANY])
            found = (self._product(value, combination) for combination in product(*parts))
        elif isinstance(value, Edited):
            found = (self._edited(value, atom) for atom in self.atoms(value.base, variable))
        else:
            return frozenset([value])
        return _few(frozenset(found))

    def entered(self, atoms: Atoms, variable: Callable[[str], Atoms]) -> Atoms:
        """The values with those of the routine's beginning inserted."""
        if atoms not in self._pending:
            self._pending[atoms] = any(isinstance(a, Entry | Product | Edited) for a in atoms)
        if not self._pending[atoms]:
            return atoms
        result: Atoms = frozenset()
        for atom in atoms:
            pending = isinstance(atom, Entry | Product | Edited)
            result = joined(result, self.atoms(atom, variable) if pending else frozenset([atom]))
        return result

    def _known(self, frame: Frame) -> Frame:
        """A frame with the pose given for it, unless the program has set it since."""
        given = self.given.frames if frame.kind == FRAME else self.given.tools
        if frame.values is not None and (frame.line or frame.name not in given):
            return frame
        if frame.name == "":
            return frame_of(frame.kind, "", given.get("0", np.eye(4)))
        T = given.get("default" if frame.name is None else frame.name)
        return frame if T is None else frame_of(frame.kind, frame.name, T)

    def _product(self, value: Product, parts: tuple[Atom, ...]) -> Atom:
        key = value.kind, value.name, parts
        if key not in self._products:
            self._products[key] = self._multiplied(value, parts)
        return self._products[key]

    def _multiplied(self, value: Product, parts: tuple[Atom, ...]) -> Atom:
        if any(isinstance(part, Entry | Product | Edited) for part in parts):
            return replace(value, parts=tuple(f for part in parts for f in _factors(part, value)))
        T, line = np.eye(4), 0
        for part in parts:
            if isinstance(part, int):
                self.frames.add(part)
                literal = self.literals[part]
                if literal.kind != POSE or not literal.numbers:
                    return Unknown(f"'{literal.name}' is no frame (line {literal.line})")
                T = T @ pose(literal.values, literal.orientation)
                continue
            if not isinstance(part, Frame):
                return (
                    part
                    if isinstance(part, Unknown)
                    else Unknown("a product of what are no frames")
                )
            if part.values is None:
                return part
            T, line = T @ part.T, max(line, part.line)
        return self._known(frame_of(value.kind, value.name, T, line))

    def _edited(self, value: Edited, base: Atom) -> Atom:
        if isinstance(base, int):
            name = value.base.name if isinstance(value.base, Entry) else value.base
            own = name in self.owners.get(base, ())  # otherwise a copy of it is changed
            if own:
                self.spoiled.setdefault(base, value.why)
            return Unknown(value.why, quiet=own, edited=base)
        if isinstance(base, Edited) and base.orientation == value.orientation:
            both = dict(base.components) | dict(value.components)
            told = bool(base.components and value.components)
            return replace(base, components=tuple(both.items()) if told else (), line=value.line)
        if isinstance(base, Entry | Product | Edited):
            return replace(value, base=base)
        if not isinstance(base, Frame) or base.values is None or not value.components:
            known = base if isinstance(base, Unknown) else Unknown("")
            return replace(known, why=value.why)
        turn = 4 if value.orientation == QUATERNION else 3
        numbers = pose_values(base.T, value.orientation, [0.0] * (3 + turn))
        for index, number in value.components:
            numbers[index] = number
        return frame_of(base.kind, base.name, pose(numbers, value.orientation), value.line)
