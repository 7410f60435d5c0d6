"""Names of KRL texts: the variable or routine of each name, and how the text uses it."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import PurePath

from calibtool.programs.krl import Statement, arguments, declared, product, reference
from calibtool.programs.krl_data import Text

POSITIONS = ("POS", "E3POS", "E6POS", "AXIS", "E3AXIS", "E6AXIS", "FRAME")
CALLED = re.compile(r"(?<![\w$#.])([A-Za-z_]\w*)\s*(?=\()")
COMPONENTS = frozenset(
    ("x", "y", "z", "a", "b", "c", "s", "t", *(f"{c}{k}" for c in "ae" for k in range(1, 7)))
)
FORM_PARTS = ("base", "tool", "mode")
FORM_NAMES = ("base_no", "tool_no", "ipo_frame")
_FRAMES = re.compile(r"\$(?:TOOL|BASE)|(?:TOOL|BASE)_DATA", re.IGNORECASE)
_NAMES = re.compile(r"(?<![\w$#.'])(\$?[A-Za-z_]\w*)(?![\w$]*\s*\()")
_ITEMS = re.compile(r"\{[^{}]*\}")
_CONFIG = "$config"
# Functions that change no argument, and words that are none.
_BY_VALUE = re.compile(
    "abs|sqrt|sin|cos|tan|acos|asin|atan2"
    "|inverse|forward|varstate|[cs]write|stool2?|sbase|sipo_mode"
    "|and|or|exor|not|b_and|b_or|b_exor|b_not|for|sec|then|to|step|when|delay|until|return"
)
_EXTERNAL = re.compile(r"(?:[A-Za-z]\w*\s+)?([A-Za-z_]\w*)\s*\(([^()]*)\)")


@dataclass(frozen=True, slots=True)
class Procedure:
    """A routine: its unique name, its parameters, and those that are passed by value (`:IN`)."""

    key: str
    parameters: tuple[str, ...]
    copied: frozenset[str] = frozenset()


@dataclass(eq=False)
class Names:
    """Variables and routines of the texts of one program, names in lower case.

    inside    types of variables, by their routine or module, "" for global ones, and by name
    valued    variables that are assigned somewhere
    elements  names of an array's elements that are assigned, by the array's name
    driven    variables that are targets of motions
    framed    variables that are used as frames, with the line
    leading   FRAMEs on the left of products that are targets of motions, with the line
    used      names in other expressions
    changed   routines and the names that they assign; rewritten: those names alone
    passed    calls in a routine with one of its names as an argument: the called name and the place
    external  routines of other files, and for every parameter whether it is passed by value
    """

    inside: dict[str, dict[str, str]] = field(default_factory=dict)
    routines: dict[str, Procedure] = field(default_factory=dict)
    constants: dict[str, str] = field(default_factory=dict)
    valued: set[str] = field(default_factory=set)
    elements: dict[str, list[str]] = field(default_factory=dict)
    driven: set[str] = field(default_factory=set)
    framed: dict[str, int] = field(default_factory=dict)
    leading: dict[str, int] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    changed: set[tuple[str, str]] = field(default_factory=set)
    rewritten: set[str] = field(default_factory=set)
    passed: set[tuple[str, str, str, int]] = field(default_factory=set)
    external: dict[str, list[bool]] = field(default_factory=dict)

    def key(self, name: str, scopes: Sequence[str]) -> str:
        """The unique name of a variable in these scopes, the innermost first."""
        for scope in (*scopes, ""):
            if name in self.inside.get(scope, ()):
                return f"{scope}|{name}" if scope else name
        return f"{scopes[-1]}|{name}"

    def type(self, name: str, scopes: Sequence[str]) -> str:
        """Its type in upper case, "" if no text declares it."""
        return next((t for s in (*scopes, "") if (t := self.inside.get(s, {}).get(name))), "")

    def routine(self, name: str, module: str) -> Procedure | None:
        """The routine with this name in a module."""
        return self.routines.get(f"{module}|{name.lower()}") or self.routines.get(name.lower())

    def changes(self, called: str, place: int, module: str) -> bool:
        """Whether a routine may change its argument at a place. A routine of no file may change all
        but `:IN`.
        """
        procedure, low = self.routine(called, module), called.lower()
        if procedure is None:
            values = self.external.get(low, [])
            return not _BY_VALUE.fullmatch(low) and not (place < len(values) and values[place])
        parameter = procedure.parameters[place] if place < len(procedure.parameters) else ""
        return parameter not in procedure.copied and (procedure.key, parameter) in self.changed

    def value(self, name: str, index: str, scopes: Sequence[str]) -> str:
        """Note that a variable is assigned; returns its unique name."""
        key = self.key(name, scopes)
        if index:
            element = f"{key}[{index}]"
            if element not in self.valued:
                self.elements.setdefault(key, []).append(element)
            key = element
        self.valued.add(key)
        return key

    def read(self, texts: Sequence[Text]) -> None:
        """Read all texts: first their declarations, then the uses of the names."""
        _modules(texts)
        for text in texts:
            for statement, scopes in text.scoped:
                self._declare(text, statement, scopes)
        for text in texts:
            for statement, scopes in text.scoped:
                self._use(text, statement, scopes)
                if len(scopes) > 1:
                    self._pass(text, statement, scopes)
        self._spread(texts)
        self._spread_changes()

    def _declare(self, text: Text, statement: Statement, scopes: tuple[str, ...]) -> None:
        code = text.code
        if statement.word == "routine":
            name = statement.name.lower()
            head = code[statement.position : statement.start].upper()
            inner = code[statement.start : statement.end].strip().removeprefix("(")
            parts = inner.partition(")")[0].split(",")
            found = [
                m
                for part in parts
                if (m := re.match(r"\s*(\w+)[^:]*(:\s*IN\b)?", part, re.IGNORECASE))
            ]
            parameters = tuple(match[1].lower() for match in found)
            copied = frozenset(match[1].lower() for match in found if match[2])
            procedure = Procedure(scopes[0], parameters, copied)
            self.routines[f"{text.module}|{name}"] = procedure
            space = self.inside.setdefault(scopes[0], {})
            space.update(dict.fromkeys(parameters, ""))
            self.valued |= {f"{scopes[0]}|{parameter}" for parameter in parameters}
            first = not any(
                p.key.startswith(f"{text.module}|") for p in list(self.routines.values())[:-1]
            )
            if first or head.startswith("GLOBAL"):
                self.routines[name] = procedure
        elif statement.word == "aside" and statement.name.upper().startswith("EXT"):
            if external := _EXTERNAL.match(code, statement.start, statement.end):
                kinds = external[2].upper().split(",")
                self.external[external[1].lower()] = [":IN" in "".join(k.split()) for k in kinds]
        elif statement.word == "decl":
            everywhere = "GLOBAL" in statement.more or text.module == _CONFIG
            scope = "" if everywhere else scopes[0]
            for item in declared(code, statement.start, statement.end):
                name = item.name.lower()
                self.inside.setdefault(scope, {})[name] = statement.name
                if "CONST" in statement.more and item.start >= 0:
                    self.constants[name] = code[item.start : item.end].strip()

    def _use(self, text: Text, statement: Statement, scopes: tuple[str, ...]) -> None:
        code, start, end = text.code, statement.start, statement.end
        if statement.word == "decl":
            for item in declared(code, start, end):
                if item.start >= 0:
                    index = re.sub(r"[\s\[\]]", "", item.index).lower()
                    key = self.value(item.name.lower(), index, scopes)
                    if statement.name == "FDAT":
                        self.valued |= {f"{key}.{which}" for which in FORM_PARTS}
        elif statement.word == "assign":
            self._assigned(text, statement, scopes)
        elif statement.word == "move":
            self._moved(text, statement, scopes)
        elif (
            statement.word in ("if", "while", "other", "return", "aside") and "(" in code[start:end]
        ):
            self.used |= _words(code, start, end)

    def _assigned(self, text: Text, statement: Statement, scopes: tuple[str, ...]) -> None:
        code, start, end = text.code, statement.start, statement.end
        name = statement.name.lower()
        index = re.sub(r"[\s\[\]]", "", statement.more[0]).lower()
        part = statement.more[1].lower().strip(".")
        if name == "fdat_act" or "_NO" in code[start:end].upper() or part in FORM_NAMES:
            key = name if name == "fdat_act" else self.value(name, index, scopes)
            self.valued |= {f"{key}.{which}" for which in FORM_PARTS}
        elif not part or part in COMPONENTS:
            self.value(name, index, scopes)
        else:
            self.value(f"{name}{f'[{index}]' if index else ''}.{part}", "", scopes)
        if len(scopes) > 1:
            self.changed.add((scopes[0], name))
            self.rewritten.add(name)
        factors, stop = product(code, start, end)
        plain = len(factors) == 1 and stop == end and not factors[0].call
        if _FRAMES.fullmatch(statement.name):
            line = text.lines(start)
            for word in _words(code, start, end):
                self.framed.setdefault(word, line)
        elif not plain or part:
            self.used |= _words(code, start, end)
            for factor in factors[1:]:
                self.framed.setdefault(_first(factor.word), text.lines(start))

    def _moved(self, text: Text, statement: Statement, scopes: tuple[str, ...]) -> None:
        code, position = text.code, statement.start
        while position < statement.end:
            factors, stop = product(code, position, statement.end)
            if not factors:
                break
            first = _first(factors[0].word)
            if len(factors) > 1 and self.type(first, scopes) == "FRAME":
                self.leading.setdefault(first, text.lines(position))
            else:
                self.driven.add(first)
            for factor in factors[1:]:
                self.framed.setdefault(_first(factor.word), text.lines(position))
            position = stop + 1
            if code[stop : stop + 1] != ",":
                break

    def _pass(self, text: Text, statement: Statement, scopes: tuple[str, ...]) -> None:
        """Note names of a routine that are arguments of calls."""
        for match in CALLED.finditer(text.code, statement.start, statement.end):
            given = call_arguments(text, match.end(), statement.end)
            for place, (first, last) in enumerate(given):
                name = _first(text.code[first:last])
                if name:
                    self.passed.add((scopes[0], name, match[1], place))

    def _spread_changes(self) -> None:
        """An argument that a called routine changes is changed by the calling routine, too."""
        count = -1
        while count != len(self.changed):
            count = len(self.changed)
            for scope, name, called, place in self.passed:
                if self.changes(called, place, scope.rpartition("|")[0]):
                    self.changed.add((scope, name))

    def _spread(self, texts: Sequence[Text]) -> None:
        """A variable that is copied to a frame or to a target is used as one, too."""
        copies: dict[str, set[str]] = {}
        for text in texts:
            for statement in text.statements:
                if statement.word == "assign" and not _FRAMES.fullmatch(statement.name):
                    found, _ = product(text.code, statement.start, statement.end)
                    words = {_first(factor.word) for factor in found if factor.word}
                    copies.setdefault(statement.name.lower(), set()).update(words)
        for name, line in self.leading.items():
            if name not in self.driven:
                self.framed.setdefault(name, line)
        waiting = [*self.framed, *self.driven]
        while waiting:
            name = waiting.pop()
            for word in copies.get(name, ()):
                if name in self.framed and word not in self.framed:
                    self.framed[word] = self.framed[name]
                    waiting.append(word)
                if name in self.driven and word not in self.driven:
                    self.driven.add(word)
                    waiting.append(word)


def call_arguments(text: Text, start: int, end: int) -> list[tuple[int, int]]:
    """Spans of the arguments of the first call at or after start."""
    open_ = text.code.find("(", start, end)
    depth = 0
    for mark in re.compile(r"[()]").finditer(text.code, open_, end):
        depth += 1 if mark[0] == "(" else -1
        if not depth:
            return arguments(text.code, open_ + 1, mark.start())
    return []


def _words(code: str, start: int, end: int) -> set[str]:
    """Names of variables in an expression, without those of components in aggregates."""
    return {name.lower() for name in _NAMES.findall(_ITEMS.sub("", code[start:end]))}


def _first(word: str) -> str:
    found = reference(word)
    return found[0] if found else ""


def _modules(texts: Sequence[Text]) -> None:
    """Assign every text to its module: a data list and the program of the same name are one."""
    lists: dict[str, str] = {}
    for text in texts:
        name = next((s.name.lower() for s in text.statements if s.word == "data"), "")
        if name and name not in lists:
            text.module = lists[name] = name
        else:
            text.module = f"{text.number}"
    taken: set[str] = set()
    for text in texts:
        names = [s.name.lower() for s in text.statements if s.word == "routine"][:1]
        stem = PurePath(text.name).stem.lower()
        match = next((n for n in (stem, *names) if n in lists and n not in taken), None)
        if names and match is not None and text.module.isdecimal():
            text.module = match
            taken.add(match)
