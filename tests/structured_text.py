"""Structured Text as Python: an independent way to run an exported function block. Only what such blocks use.

Assignments, IF, FOR with BY, RETURN, arrays from 1 (indices are checked, which Python alone would not do), REAL and LREAL.
"""

import math
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

_TOKEN = re.compile(r"\(\*.*?\*\)|\s+|(?P<number>\d+\.\d+(?:[eE][+-]?\d+)?)|(?P<whole>\d+)|(?P<word>[A-Za-z_]\w*)|"
                    r"(?P<sign>:=|\.\.|<=|>=|<>|[-+*/()\[\],;:<>=])", re.DOTALL)  # fmt: skip
_OPERATORS = {"=": "==", "<>": "!=", "AND": " and ", "OR": " or ", "NOT": " not "}
_FUNCTIONS = {"ABS": abs, "SQRT": math.sqrt, "SIN": math.sin, "COS": math.cos, "ATAN": math.atan, "EXP": math.exp}


class Grid:
    """ARRAY[1..a, 1..b, ...]: an index outside is an error."""

    def __init__(self, shape: tuple[int, ...], values: list[Any]) -> None:
        self.values, self.shape = values, shape
        assert len(values) == math.prod(shape), "an initial value has another number of elements than its array"

    def _at(self, index: int | tuple[int, ...]) -> int:
        place = 0
        indices = index if isinstance(index, tuple) else (index,)
        for i, size in zip(indices, self.shape, strict=True):
            assert 1 <= i <= size, f"index {index} of an array {self.shape}"
            place = place * size + i - 1
        return place

    def __getitem__(self, index: int | tuple[int, ...]) -> Any:
        return self.values[self._at(index)]

    def __setitem__(self, index: int | tuple[int, ...], value: Any) -> None:
        self.values[self._at(index)] = value


class FunctionBlock:
    """One instance: call it with q, and read q_corrected and status; variables keep their values between calls."""

    def __init__(self, text: str) -> None:
        self.tokens = list(_tokens(text))
        self.variables: dict[str, Any] = {}
        self._take("FUNCTION_BLOCK")
        self.name = self._next()
        self.constants: set[str] = set()
        while self.tokens[0].startswith("VAR"):
            self._declarations()
        lines = ["def body(v):"]
        self._statements(lines, 1)
        self._take("END_FUNCTION_BLOCK")
        assert not self.tokens
        scope: dict[str, Any] = {"number": self.number, "steps": _steps}
        scope |= {name: self._function(function) for name, function in _FUNCTIONS.items()}
        exec("\n".join(lines), scope)
        self.body: Callable[[dict[str, Any]], None] = scope["body"]

    def __call__(self, q: np.ndarray) -> tuple[np.ndarray, int]:
        self.variables["q"].values[:] = [self.number(value) for value in q]
        self.body(self.variables)
        return np.array(self.variables["q_corrected"].values, dtype=float), self.variables["status"]

    def number(self, text: Any) -> Any:
        """A literal or an input in the block's own precision."""
        return np.float32(text) if self.single else float(text)

    def _function(self, function: Callable[[Any], Any]) -> Callable[[Any], Any]:
        return lambda x: self.number(function(x))

    # Declarations

    def _declarations(self) -> None:
        self._next()
        constant = self.tokens[0] == "CONSTANT" and bool(self._next())
        while self.tokens[0] != "END_VAR":
            names = [self._next()]
            while self.tokens[0] == ",":
                self._next()
                names.append(self._next())
            self._take(":")
            self._variable(names, constant)
        self._next()

    def _variable(self, names: list[str], constant: bool) -> None:
        shape: list[int] = []
        if self.tokens[0] == "ARRAY":
            self._take("ARRAY", "[")
            while not shape or self.tokens[0] == ",":
                if shape:
                    self._take(",")
                self._take("1", "..")
                shape.append(int(self._next()))
            self._take("]", "OF")
        kind = self._next()
        if kind != "INT":
            self.single = kind == "REAL"
        zero = 0 if kind == "INT" else self.number(0)
        values = [zero] * math.prod(shape)
        if self.tokens[0] == ":=":
            self._next()
            values = [self.number(text) for text in self._initial()]
        self._take(";")
        for name in names:
            assert name.lower() not in self.variables, f"{name} is declared twice: case does not matter"
            self.variables[name.lower()] = Grid(tuple(shape), list(values)) if shape else values[0]
            if constant:
                self.constants.add(name)

    def _initial(self) -> list[str]:
        texts: list[str] = []
        sign, depth = "", 0
        while self.tokens[0] != ";":
            token = self._next()
            depth += (token == "[") - (token == "]")
            if token == "-":
                sign = "-"
            elif token not in "[],":
                texts.append(sign + token)
                sign = ""
        assert depth == 0
        return texts

    # Statements

    def _statements(self, lines: list[str], depth: int) -> None:
        pad, before = "    " * depth, len(lines)
        while self.tokens[0] not in ("END_FOR", "END_IF", "ELSE", "ELSIF", "END_FUNCTION_BLOCK"):
            word = self._next()
            if word == "RETURN":
                lines.append(f"{pad}return")
            elif word == "IF":
                lines.append(f"{pad}if {self._expression('THEN')}:")
                self._statements(lines, depth + 1)
                while self.tokens[0] == "ELSIF":
                    self._next()
                    lines.append(f"{pad}elif {self._expression('THEN')}:")
                    self._statements(lines, depth + 1)
                if self.tokens[0] == "ELSE":
                    self._next()
                    lines.append(f"{pad}else:")
                    self._statements(lines, depth + 1)
                self._take("END_IF")
            elif word == "FOR":
                variable = self._next().lower()
                self._take(":=")
                first, last = self._expression("TO"), self._expression("DO", "BY")
                step = self._expression("DO") if self.ended == "BY" else "1"
                lines.append(f"{pad}for v[{variable!r}] in steps({first}, {last}, {step}):")
                self._statements(lines, depth + 1)
                self._take("END_FOR")
            else:
                assert word not in self.constants, f"{word} is a constant"
                target = self._expression(":=", first=word)
                lines.append(f"{pad}{target} = {self._expression(';')}")
                continue
            self._take(";")
        if len(lines) == before:
            lines.append(f"{pad}pass")

    def _expression(self, *ends: str, first: str | None = None) -> str:
        """Tokens up to one of `ends`; operators bind as in Python, but for NOT, which stands before a bracket only."""
        parts = []
        token = first or self._next()
        while token not in ends:
            if token[0].isdigit():
                parts.append(f"number({token!r})" if "." in token else token)
            elif token in _OPERATORS:
                assert token != "NOT" or self.tokens[0] == "("
                parts.append(_OPERATORS[token])
            elif token[0].isalpha() and token not in _FUNCTIONS:
                assert token.lower() in self.variables, f"{token} is not declared"
                parts.append(f"v[{token.lower()!r}]")
            else:
                parts.append(token)
            token = self._next()
        self.ended = token
        return "".join(parts)

    def _next(self) -> str:
        return self.tokens.pop(0)

    def _take(self, *expected: str) -> None:
        for token in expected:
            found = self._next()
            assert found == token, f"{found} where {token} is expected"


def _tokens(text: str) -> Iterator[str]:
    place = 0
    while place < len(text):
        match = _TOKEN.match(text, place)
        assert match, f"not Structured Text: {text[place : place + 20]!r}"
        place = match.end()
        if match.lastgroup:
            yield match[0]


def _steps(first: int, last: int, step: int) -> range:
    return range(first, last + (1 if step > 0 else -1), step)
