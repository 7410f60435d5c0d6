"""ABB programs (RAPID): what their routines assign, and the motions of their instructions."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from calibtool.programs.lists import closing
from calibtool.programs.motions import (
    BASE,
    FLANGE,
    FRAME,
    OFF,
    ON,
    TOOL,
    Aim,
    Assign,
    Begin,
    Call,
    Edited,
    Either,
    Else,
    End,
    Frame,
    Jump,
    Label,
    Literal,
    Move,
    Product,
    Program,
    Return,
    Routine,
    Source,
    Unknown,
    Value,
    frame_of,
)
from calibtool.programs.motions import Statement as Step
from calibtool.programs.rapid import Argument, Statement, arguments, statements
from calibtool.programs.rapid_data import SHAPES, Text
from calibtool.programs.rapid_names import Data, Names
from calibtool.programs.targets import Lines, Remark, comments_blanked, number_at
from calibtool.robot.model import Robot

NAME = "abb-rapid"
SUFFIXES = (".mod", ".modx", ".prg", ".sys", ".sysx")
_START = re.compile(
    r"^[^\S\n]*(?:MODULE\s+\w+|%%%)|\b(?:robtarget|jointtarget)\s+\w+\s*:=",
    re.MULTILINE | re.IGNORECASE,
)
_MOTION = re.compile(
    r"(?:Move|Trigg|Search|Arc|Paint|Spot|Disp|Cap)(?P<way>AbsJ|[JLC])(?![a-z])(?i:\w*)"
    r"|(?i:(?:Move|Trigg|Search|Arc|Paint|Spot|Disp|Cap)(?:AbsJ|[JLC]))"
)
_ENDS = ("endproc", "endfunc", "endtrap", "endmodule")
_DISPLACEMENT, _CONFJ, _CONFL = "displacement", "confj", "confl"
_COMPONENTS = {"x": 0, "y": 1, "z": 2, "q1": 3, "q2": 4, "q3": 5, "q4": 6}
_ZONE = re.compile(r"fine|z\d+", re.IGNORECASE)
_WORD = re.compile(r"(\w+)\s*+(?:\{([^{}]*)\})?\s*+")
_FUNCTION = re.compile(r"(\w+)\s*+(?=\()")


def matches(text: str) -> bool:
    """Whether this is a RAPID module."""
    return _START.search(text) is not None


def program(sources: Sequence[Source], robot: Robot) -> Program:
    """The positions and motions of modules of one task."""
    literals: list[Literal] = []
    modules = []
    names = Names()
    for number, source in enumerate(sources):
        code = comments_blanked(source.text, r"![^\r\n]*")
        text = Text(number, source.text, code, Lines(source.text), robot, literals)
        names.read(text)
        modules.append(text)
    whole = [text.code for text in modules]
    declared: dict[str, Value] = {"tool0": FLANGE, "wobj0.u": BASE, "wobj0.o": BASE}
    if any(re.search(r"\bPDisp(?:On|Set)\b", code, re.IGNORECASE) for code in whole):
        declared[_DISPLACEMENT] = BASE
    if any(re.search(r"\bConf[JL]\s*\\Off", code, re.IGNORECASE) for code in whole):
        declared |= {_CONFJ: ON, _CONFL: ON}
    readers = [_Reader(text, names, declared) for text in modules]
    for reader in readers:
        reader.declare()
    routines = [routine for reader in readers for routine in reader.routines()]
    for text in modules:
        literals += text.others()
    return Program(
        tuple(sources),
        tuple(literals),
        tuple(routines),
        declared,
        tuple(remark for reader in readers for remark in reader.remarks),
        persistent=True,
        unused="no instruction of this program moves there: its tool and work object are not known",
    )


class _Reader:
    """A module: its data, and its routines as steps."""

    def __init__(self, text: Text, names: Names, declared: dict[str, Value]) -> None:
        self.text, self.code, self.names, self.declared = text, text.code, names, declared
        self.module = f"{text.number}"
        self.scopes: tuple[str, ...] = (self.module,)
        self.remarks: list[Remark] = []

    # --- data --------------------------------------------------------------------------------------------------------

    def declare(self) -> None:
        """What data of the module hold when the program begins."""
        inside = False
        for statement in statements(self.code):
            if statement.word == "routine":
                inside = True
            elif statement.word in _ENDS:
                inside = False
            elif statement.word == "data" and not inside:
                self.declared |= dict(self._data(statement))

    def _data(self, statement: Statement) -> Iterator[tuple[str, Value]]:
        """Names of variables and what a declaration gives them."""
        data = self.names.data(statement.name, self.scopes)
        if data is None or data.type != statement.more[2] or not statement.start < statement.end:
            return
        start, end = statement.start, self._trimmed(statement.start, statement.end)
        if self.code[start] == "[" and not self._closed(start, statement.name):
            return
        if not statement.ended:
            self._bad(statement.position, statement.name, "no ; at its end")
            return
        for index, first, last in self._elements(data, start, end):
            name = statement.name + index
            if index:
                self.names.elements.setdefault(data.key, []).append(data.key + index)
            yield from self._held(data, data.key + index, first, last, name, 0)

    def _elements(self, data: Data, start: int, end: int) -> Iterator[tuple[str, int, int]]:
        """Index in braces and span of each element of an array, row by row; the data itself if it is none."""
        if not data.dimensions or self.code[start] != "[":
            yield "", start, end
            return
        waiting: list[tuple[int, int, tuple[int, ...]]] = [(start, end, ())]
        while waiting:
            first, last, index = waiting.pop()
            if len(index) == data.dimensions:
                yield "{" + ",".join(map(str, index)) + "}", first, last
                continue
            inner = [(a, b, (*index, k + 1)) for k, (a, b) in enumerate(self._parts(first, last))]
            waiting += reversed(inner)

    def _parts(self, start: int, end: int) -> Iterator[tuple[int, int]]:
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
                yield position, self._trimmed(position, stop)
                position = stop

    def _held(
        self, data: Data, key: str, start: int, end: int, name: str, line: int
    ) -> Iterator[tuple[str, Value]]:
        """Variables and what the text at start gives them; line: of the assignment, 0 of a declaration."""
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
            other = self._reference(word, data.type)
            for part in (".u", ".o"):
                known = isinstance(other, str)
                yield key + part, f"{other}{part}" if known else self._computed(start)
        elif data.type in (*SHAPES, "tooldata"):
            other = self._reference(word, data.type)
            yield key, self._computed(start) if other is None else other

    def _reference(self, word: str, type_: str) -> Value | None:
        """The variable that a word means, with its index, if it is one of this type."""
        match = _WORD.fullmatch(word)
        data = self.names.data(match[1], self.scopes) if match else None
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

    def _computed(self, position: int) -> Unknown:
        return Unknown(f"is computed (line {self.text.lines(position)})")

    # --- routines ----------------------------------------------------------------------------------------------------

    def routines(self) -> Iterator[Routine]:
        """The routines of the module; what stands outside of them is one of its own."""
        outside: list[Step] = []
        steps, name = outside, ""
        cases: list[bool] = []  # of open TEST: whether a CASE was seen
        for statement in statements(self.code):
            if statement.word == "routine":
                name = f"{self.module}|{statement.name.lower()}"
                steps, self.scopes, cases = [], (name, self.module), []
            elif statement.word in _ENDS:
                if name:
                    yield Routine(name, tuple(steps), self.text.number)
                steps, name, self.scopes = outside, "", (self.module,)
            elif statement.word == "data":
                if name:
                    line = self.text.lines(statement.position)
                    steps += [Assign(line, key, value) for key, value in self._data(statement)]
            else:
                steps += self._steps(statement, cases)
        if name:
            yield Routine(name, tuple(steps), self.text.number)
        yield Routine(f"{self.module}|", tuple(outside), self.text.number)

    def _steps(self, statement: Statement, cases: list[bool]) -> Iterator[Step]:
        word = statement.word
        if word in ("if", "for", "while", "test"):
            yield Begin(loop=word in ("for", "while"))
            if word == "test":
                cases.append(False)
        elif word in ("elseif", "else"):
            yield Else(last=word == "else")
        elif word in ("case", "default"):
            if cases and not cases[-1]:
                cases[-1] = True
            else:
                yield Else(last=word == "default")
        elif word in ("endif", "endfor", "endwhile", "endtest"):
            if word == "endtest" and cases:
                cases.pop()
            yield End()
        elif word == "label":
            yield Label(statement.name.lower())
        elif word in ("error", "undo", "backward"):
            yield Return()
        elif word == "assign":
            yield from self._assignment(statement)
        elif word == "instruction":
            yield from self._instruction(statement)

    def _assignment(self, statement: Statement) -> Iterator[Step]:
        data = self.names.data(statement.name, self.scopes)
        if data is None or data.type not in (*SHAPES, "tooldata", "wobjdata"):
            return
        start, end = statement.start, statement.end
        start += len(self.code[start:end]) - len(self.code[start:end].lstrip())
        end = self._trimmed(start, end)
        line = self.text.lines(statement.position)
        index, parts = statement.more
        if self.code[start : start + 1] == "[" and not self._closed(start, statement.name):
            return
        target = self._reference(statement.name + index, data.type)
        keys = target.parts if isinstance(target, Either) else (target,)
        if data.dimensions and not index and not parts:
            for place, first, last in self._elements(data, start, end):
                for key, value in self._held(
                    data, data.key + place, first, last, statement.name + place, line
                ):
                    yield Assign(line, key, value)
            return
        several = isinstance(target, Either)
        for key in (key for key in keys if isinstance(key, str)):
            held = (
                self._component(data, key, parts, start, end, line)
                if parts
                else self._held(data, key, start, end, statement.name + index, line)
            )
            for name, value in held:
                yield Assign(line, name, Either((name, value)) if several else value)

    def _component(
        self, data: Data, key: str, parts: str, start: int, end: int, line: int
    ) -> Iterator[tuple[str, Value]]:
        """What a variable holds once a component of it is assigned."""
        words = parts.strip(".").split(".")
        why = f"a component of it is assigned (line {line})"
        if data.type in SHAPES:
            yield key, Edited(key, (), "quaternion", line, why)
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
            spans = list(self._parts(start, end)) if self.code[start] == "[" else []
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
            yield name, Edited(name, components, "quaternion", line, why)

    # --- instructions ------------------------------------------------------------------------------------------------

    def _instruction(self, statement: Statement) -> Iterator[Step]:
        name, low = statement.name, statement.name.lower()
        line = self.text.lines(statement.position)
        if not statement.ended:
            if _MOTION.fullmatch(name):
                self.remarks.append(Remark(line, name, "no ; at its end", source=self.text.number))
            return
        if low == "goto":
            yield Jump(self.code[statement.start : statement.end].strip().lower())
        elif low in ("return", "exit", "raise", "retry", "trynext", "exitcycle"):
            yield Return()
        elif low in ("confj", "confl"):
            switch = self.code[statement.start : statement.end].lower()
            if _CONFJ in self.declared:
                yield Assign(line, low, OFF if "off" in switch else ON)
        elif low.startswith("pdisp"):
            yield from self._displacement(low, statement, line)
        else:
            given = arguments(self.code, statement.start, statement.end)
            for argument in given:
                if self.code[argument.start] == "[" and not self._closed(argument.start, name):
                    return
            procedure = self.names.routine(name, self.module)
            if procedure is not None:
                yield from self._call(procedure.key, procedure.parameters, given, line)
            elif low != "moveextj":
                yield from self._motion(name, given, line)

    def _displacement(self, low: str, statement: Statement, line: int) -> Iterator[Step]:
        if low == "pdispoff":
            yield Assign(line, _DISPLACEMENT, BASE)
            return
        start, end = statement.start, statement.end
        start += len(self.code[start:end]) - len(self.code[start:end].lstrip())
        T = self.text.pose(start, self._trimmed(start, end)) if low == "pdispset" else None
        unknown = Unknown(f"a program displacement (line {line}) moves it")
        yield Assign(line, _DISPLACEMENT, unknown if T is None else frame_of(FRAME, None, T, line))

    def _call(
        self,
        routine: str,
        parameters: Sequence[tuple[str, Data]],
        given: Sequence[Argument],
        line: int,
    ) -> Iterator[Step]:
        """A routine of the program, with what its parameters hold."""
        plain = [argument for argument in given if not argument.option]
        options = {argument.option: argument for argument in given if argument.option}
        passed: list[tuple[str, Value]] = []
        written: list[Assign] = []
        for name, data in parameters:
            optional = name.startswith("\\")
            argument = options.get(name[1:]) if optional else (plain.pop(0) if plain else None)
            if data.type not in (*SHAPES, "tooldata", "wobjdata"):
                continue
            if argument is None:
                nothing = Unknown("an argument that is not given")
                default = {"tooldata": FLANGE, "wobjdata": BASE}.get(data.type, nothing)
                keys = (".u", ".o") if data.type == "wobjdata" else ("",)
                passed += [(data.key + key, default) for key in keys]
                continue
            word = self.code[argument.start : argument.end]
            passed += self._held(data, data.key, argument.start, argument.end, word[:40], line)
            reference = self._reference(word, data.type)
            if name in self.names.changed and isinstance(reference, str):
                why = Unknown(f"is changed by a routine (line {line})")
                keys = (".u", ".o") if data.type == "wobjdata" else ("",)
                written += [Assign(line, reference + key, why) for key in keys]
        yield Call(line, routine, tuple(passed))
        yield from written

    def _motion(self, name: str, given: Sequence[Argument], line: int) -> Iterator[Step]:
        """The motion of an instruction, known or not, if a position is among its arguments."""
        plain = [k for k, argument in enumerate(given) if not argument.option]
        known = _MOTION.fullmatch(name)
        circle = known is not None and (known["way"] or name[-1]).upper() == "C"
        count = 2 if circle else 1
        aimed = [k for k in plain if self._is_position(given[k])]
        search = name.lower().startswith("search")
        if search and len(aimed) > count:
            for k in aimed[:-count]:
                found = self._reference(self.code[given[k].start : given[k].end], "robtarget")
                if isinstance(found, str):
                    yield Assign(line, found, Unknown(f"is found by {name} (line {line})"))
            aimed = aimed[-count:]
        elif known and not search and len(aimed) < count:
            aimed = plain[:count]
        if not aimed:
            return
        if known and len(plain) < 2:
            return
        tool, frame = self._tool_and_frame(name, given, plain, aimed[-1], known is not None)
        joint = re.search(r"J(?![a-z])", name) is not None or name.lower().endswith("j")
        obeyed: Value = (_CONFJ if joint else _CONFL) if _CONFJ in self.declared else ON
        type_ = "jointtarget" if re.search("AbsJ", name, re.IGNORECASE) else "robtarget"
        aims = []
        for number, k in enumerate(aimed):
            via = known is not None and circle and number == 0  # its configuration is not looked at
            aim = self._aim(given[k], type_, name, line)
            aims.append(replace(aim, frame=frame, tool=tool, obeyed=OFF if via else obeyed))
        yield Move(line, name, tuple(aims))

    def _is_position(self, argument: Argument) -> bool:
        """Whether an argument can only be a position: a list that begins with a list, or data of these types."""
        word = self.code[argument.start : argument.end]
        if word.startswith("["):
            if any(shape.fullmatch(word) for shape in SHAPES.values()):
                return True
            parts = list(self._parts(argument.start, argument.end))
            lists = [self.code[first] == "[" for first, _ in parts]
            if len(parts) == 4 and sum(lists) >= 2:
                return True
            pose = self.text.pose(argument.start, argument.end)
            return bool(lists) and lists[0] and pose is None
        function = _FUNCTION.match(word)
        if function:
            return function[1].lower() in ("offs", "reltool", "crobt", "cjointt")
        return any(self._reference(word, type_) is not None for type_ in SHAPES)

    def _aim(self, argument: Argument, type_: str, instruction: str, line: int) -> Aim:
        start, end = argument.start, argument.end
        word = self.code[start:end]
        if word.startswith("["):
            for shape in SHAPES:
                if SHAPES[shape].fullmatch(word):
                    type_ = shape
            return Aim(self.text.position(type_, start, end, f"{instruction} […]"))
        function = _FUNCTION.match(word)
        if function and function[1].lower() in ("offs", "reltool"):
            inner = arguments(self.code, start + function.end() + 1, end - 1)
            first = self.code[inner[0].start : inner[0].end] if inner else ""
            value = self._reference(first, "robtarget")
            why = "a relative motion; the point it starts from is treated by itself"
            if value is not None:
                return Aim(value, relative=why)
            return Aim(Unknown(f"{why} ({first[:30]})"))
        for shape in SHAPES:
            value = self._reference(word, shape)
            if value is not None:
                return Aim(value)
        if _WORD.fullmatch(word):
            return Aim(Unknown(f"'{word}' is a variable that no file gives a position"))
        return Aim(Unknown(f"an expression ({word[:40]})"))

    def _tool_and_frame(
        self,
        name: str,
        given: Sequence[Argument],
        plain: Sequence[int],
        target: int,
        known: bool,
    ) -> tuple[Value, Value]:
        """Tool and work object of an instruction, wherever they stand among its arguments."""
        work_object = next((a for a in given if a.option == "wobj"), None)
        later = [k for k in plain if k > target]
        words = {k: self.code[given[k].start : given[k].end] for k in later}
        place = next((k for k in later if self._reference(words[k], "tooldata") is not None), None)
        if place is None and work_object is not None and work_object.after > target:
            place = work_object.after
        if place is None:
            zones = [k for k in later if self._is_zone(words[k])]
            place = next((k for k in later if zones and k > zones[0]), None)
        if place is None and known and later:
            place = later[-1]
        tool: Value = Unknown(f"{name} is no instruction whose tool is known")
        option = next((a for a in given if a.option == "tool"), None)
        if option is not None:
            tool = self._named(self.code[option.start : option.end], "tooldata")
        elif place is not None:
            tool = self._named(words[place], "tooldata")
        frame: Value = BASE
        if work_object is not None:
            frame = self._named(self.code[work_object.start : work_object.end], "wobjdata")
        if _DISPLACEMENT in self.declared:
            frame = Product(FRAME, (frame, _DISPLACEMENT))
        return tool, frame

    def _is_zone(self, word: str) -> bool:
        match = _WORD.fullmatch(word)
        data = self.names.data(match[1], self.scopes) if match else None
        return _ZONE.fullmatch(word) is not None or (data is not None and data.type == "zonedata")

    def _named(self, word: str, type_: str) -> Value:
        """A tool or a work object by its name."""
        kind = TOOL if type_ == "tooldata" else FRAME
        reference = self._reference(word, type_)
        if reference is None:
            name = _WORD.fullmatch(word)
            if name is None or name[2]:
                return Unknown(f"an expression ({word[:30]})")
            return Frame(kind, name[1].lower())
        if kind == TOOL:
            return reference
        if not isinstance(reference, str):
            return Unknown(f"an expression ({word[:30]})")
        if reference == "wobj0":
            return BASE
        return Product(FRAME, (f"{reference}.u", f"{reference}.o"), reference.split("|")[-1])

    # --- spans and remarks -------------------------------------------------------------------------------------------

    def _trimmed(self, start: int, end: int) -> int:
        return start + len(self.code[start:end].rstrip())

    def _closed(self, start: int, name: str) -> bool:
        if closing(self.code, start) is not None:
            return True
        self._bad(start, name, "a bracket is not closed")
        return False

    def _bad(self, position: int, name: str, why: str) -> None:
        remark = Remark(self.text.lines(position), name, why, True, self.text.number)
        self.remarks.append(remark)
