"""Values of RAPID names and expressions, as used by motions."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from calibtool.programs.bracketed_lists import closing, trimmed
from calibtool.programs.motions import (
    BASE,
    FRAME,
    TOOL,
    Edited,
    Either,
    Frame,
    Product,
    Unknown,
    Value,
    frame_of,
)
from calibtool.programs.numbers import Remark, number_at
from calibtool.programs.rapid_data import SHAPES, Text
from calibtool.programs.rapid_names import Data, Names
from calibtool.robot.orientation import QUATERNION

_COMPONENTS = {"x": 0, "y": 1, "z": 2, "q1": 3, "q2": 4, "q3": 5, "q4": 6}
_WORD = re.compile(r"([^\W\d]\w*)\s*+(?:\{([^{}]*)\})?\s*+")


@dataclass(eq=False)
class Values:
    """Values of a module's texts in these scopes, the innermost first.

    declared  values of variables of all modules when the program begins
    remarks   errors that were found
    """

    text: Text
    names: Names
    declared: dict[str, Value]
    scopes: tuple[str, ...] = ()
    remarks: list[Remark] = field(default_factory=list)

    @property
    def code(self) -> str:
        """The module's code."""
        return self.text.code

    def data(self, word: str) -> Data | None:
        """The data of a word that is a name, with or without an index."""
        match = _WORD.fullmatch(word)
        return self.names.data(match[1], self.scopes) if match else None

    def reference(self, word: str, type_: str) -> Value | None:
        """The variable of a word, if it has this type; of an array all possible elements."""
        match, data = _WORD.fullmatch(word), self.data(word)
        if match is None or data is None or data.type != type_:
            return None
        if not data.dimensions:
            return data.key
        index = re.sub(r"\s", "", match[2] or "")
        if re.fullmatch(r"\d+(?:,\d+)*", index):
            return f"{data.key}{{{index}}}"
        elements = tuple(self.names.elements.get(data.key, ()))
        if match[1].lower() in self.names.changed or not elements:
            return Either(elements) if elements else None
        every = f"{data.key}{{}}"
        self.declared.setdefault(every, Either(elements))
        return every

    def named(self, word: str, type_: str) -> Value:
        """A tool or a work object by its name; `--frames` may define an undeclared one."""
        reference = self.reference(word, type_)
        if reference is None:
            name = _WORD.fullmatch(word)
            if name is None or name[2]:
                return Unknown(f"an expression ({word[:30]})")
            return Frame(TOOL if type_ == "tooldata" else FRAME, name[1].lower())
        if type_ == "tooldata":
            return reference
        if not isinstance(reference, str):
            return Unknown(f"an expression ({word[:30]})")
        if reference == "wobj0":
            return BASE
        parts = (f"{reference}.u", f"{reference}.o")
        return Product(FRAME, parts, reference.split("|")[-1])

    def held(
        self, data: Data, key: str, start: int, end: int, name: str, line: int = 0
    ) -> Iterator[tuple[str, Value]]:
        """Variables and the values of a text. line: of the assignment, 0 of a declaration."""
        word = self.code[start:end]
        if data.type in SHAPES and word.startswith("["):
            yield key, self.text.position(data.type, start, end, name)
        elif data.type == "tooldata" and word.startswith("["):
            yield key, self.text.tool(start, end, None if line else name.lower(), line)
        elif data.type == "wobjdata" and word.startswith("["):
            user, thing = self.text.work_object(start, end, line)
            yield f"{key}.u", user
            yield f"{key}.o", thing
        elif data.type == "wobjdata":
            other = self.reference(word, data.type)
            for part in (".u", ".o"):
                known = isinstance(other, str)
                yield key + part, f"{other}{part}" if known else self._computed(start)
        elif data.type in (*SHAPES, "tooldata"):
            other = self.reference(word, data.type)
            yield key, self._computed(start) if other is None else other

    def _computed(self, position: int) -> Unknown:
        return Unknown(f"is computed (line {self.text.lines(position)})")

    def elements(self, data: Data, start: int, end: int) -> Iterator[tuple[str, int, int]]:
        """Index and span of each element of an array, row by row; the data itself if it is none."""
        if not data.dimensions or self.code[start] != "[":
            yield "", start, end
            return
        waiting: list[tuple[int, int, tuple[int, ...]]] = [(start, end, ())]
        while waiting:
            first, last, index = waiting.pop()
            if len(index) == data.dimensions:
                yield "{" + ",".join(map(str, index)) + "}", first, last
                continue
            inner = [(a, b, (*index, k + 1)) for k, (a, b) in enumerate(self.parts(first, last))]
            waiting += reversed(inner)

    def parts(self, start: int, end: int) -> Iterator[tuple[int, int]]:
        """The elements of a list in brackets."""
        position = start + 1
        while position < end - 1:
            if self.code[position] == "[":
                stop = (closing(self.code, position) or end) + 1
                yield position, stop
                position = stop
            elif self.code[position].isspace() or self.code[position] == ",":
                position += 1
            else:
                stop = self.code.find(",", position, end - 1)
                stop = end - 1 if stop < 0 else stop
                yield position, trimmed(self.code, position, stop)[1]
                position = stop

    def component(
        self, data: Data, key: str, parts: str, start: int, end: int, line: int
    ) -> Iterator[tuple[str, Value]]:
        """The value of a variable after the assignment of one of its components."""
        words = parts.strip(".").split(".")
        why = f"a component of it is assigned (line {line})"
        if data.type in SHAPES:
            yield key, Edited(key, (), QUATERNION, line, why)
            return
        part = {"tframe": "", "uframe": ".u", "oframe": ".o"}.get(words[0])
        if part is None:
            if words[0] in ("robhold", "ufprog", "ufmec"):
                yield key if data.type == "tooldata" else f"{key}.u", Unknown(why)
            return
        name = key + part
        kind = TOOL if data.type == "tooldata" else FRAME
        if len(words) == 1:
            T = self.text.pose(start, end)
            yield name, Unknown(why) if T is None else frame_of(kind, None, T, line)
            return
        first = {"trans": 0, "rot": 3}.get(words[1], 0)
        if len(words) == 2:
            spans = list(self.parts(start, end)) if self.code[start] == "[" else []
            indices = list(range(first, first + (4 if first else 3)))
        else:
            spans, indices = [(start, end)], [_COMPONENTS.get(words[2], 0)]
        numbers = [
            number_at(self.text.text, *span, "" if k >= 3 else "mm")
            for k, span in zip(indices, spans, strict=False)
        ]
        values = [number.value for number in numbers if number is not None]
        if len(values) != len(indices) or words[1:2] == ["rot"] != words[1:]:
            yield name, Unknown(why)
        else:
            components = tuple(zip(indices, values, strict=True))
            yield name, Edited(name, components, QUATERNION, line, why)

    def closed(self, start: int, name: str) -> bool:
        """Whether a list that begins here is closed; an open one is noted as an error."""
        if self.code[start : start + 1] != "[" or closing(self.code, start) is not None:
            return True
        self.bad(start, name, "a bracket is not closed")
        return False

    def bad(self, position: int, name: str, why: str) -> None:
        """Note an error."""
        remark = Remark(self.text.lines(position), name, why, True, self.text.number)
        self.remarks.append(remark)
