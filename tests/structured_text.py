"""Structured Text as Python: an independent way to run an exported function block.

Only what such blocks use. Assignments, IF, FOR with BY, RETURN, arrays from 1 (indices are checked,
which Python alone would not do), REAL and LREAL.
"""

import math
import re
from collections import deque
from collections.abc import Callable, Iterator
from itertools import product
from typing import Any

import numpy as np

_TOKEN = re.compile(
    r"\(\*.*?\*\)|\s+|(?P<number>\d+\.\d+(?:[eE][+-]?\d+)?)|(?P<whole>\d+)"
    r"|(?P<word>[A-Za-z_]\w*)|(?P<sign>:=|\.\.|<=|>=|<>|[-+*/()\[\],;:<>=])",
    re.DOTALL,
)
_OPERATORS = {"=": "==", "<>": "!=", "AND": " and ", "OR": " or ", "NOT": " not "}
_FUNCTIONS = {
    "ABS": abs,
    "SQRT": math.sqrt,
    "SIN": math.sin,
    "COS": math.cos,
    "ATAN": math.atan,
    "EXP": math.exp,
}


class Grid(dict[Any, Any]):
    """ARRAY[1..a, 1..b, ...] by its indices: to read or to write outside is an error."""

    def __init__(self, shape: tuple[int, ...], values: list[Any]) -> None:
        indices = list(product(*(range(1, size + 1) for size in shape)))
        assert len(values) == len(indices), (
            "an initial value has another number of elements than its array"
        )
        super().__init__(
            zip(indices if len(shape) > 1 else [index for (index,) in indices], values, strict=True)
        )

    def __setitem__(self, index: Any, value: Any) -> None:
        assert index in self, f"index {index} of an array"
        super().__setitem__(index, value)


class FunctionBlock:
    """One instance: call it with q, and read q_corrected and status; variables keep their
    values between calls.
    """

    def __init__(self, text: str) -> None:
        self.tokens = deque(_tokens(text))
        self.literals: list[Any] = []
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
        scope: dict[str, Any] = {"literals": self.literals, "steps": _steps}
        scope |= {name: self._function(function) for name, function in _FUNCTIONS.items()}
        exec("\n".join(lines), scope)
        self.body: Callable[[dict[str, Any]], None] = scope["body"]

    def __call__(self, q: np.ndarray) -> tuple[np.ndarray, int]:
        for j, value in enumerate(q):
            self.variables["q"][j + 1] = self.number(value)
        self.body(self.variables)
        return np.array(list(self.variables["q_corrected"].values()), dtype=float), self.variables[
            "status"
        ]

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
            values = [int(text) if kind == "INT" else self.number(text) for text in self._initial()]
        self._take(";")
        for name in names:
            assert name.lower() not in self.variables, (
                f"{name} is declared twice: case does not matter"
            )
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
        """Tokens up to one of `ends`; operators bind as in Python, but for NOT, which stands
        before a bracket only.
        """
        parts = []
        token = first or self._next()
        while token not in ends:
            if token[0].isdigit():
                if "." in token:
                    self.literals.append(self.number(token))
                    token = f"literals[{len(self.literals) - 1}]"
                parts.append(token)
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
        return self.tokens.popleft()

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
