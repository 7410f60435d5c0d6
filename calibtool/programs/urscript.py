"""The syntax of URScript: motions, statements, calls and their arguments, as spans of the text."""

import ast
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from calibtool.programs.bracketed_lists import closing, split, trimmed

# Motions and the parameters that say where they go.
MOTIONS = {
    "movej": ("q",),
    "movel": ("pose",),
    "movep": ("pose",),
    "movec": ("pose_via", "pose_to"),
    "servoj": ("q",),
    "servoc": ("pose",),
    "servol": ("pose",),
    "optimovej": ("q",),
    "optimovel": ("pose",),
    "mc_add_linear": ("pose",),
    "mc_add_circular": ("pose_via", "pose_to"),
}
_STOP = re.compile(r"[\n\r]|[(\[{]")
_HEADER = re.compile(
    r"[^\S\n\r]*+(?:(?P<routine>def|thread|sec)\s+(?P<name>\w+)\s*+(?=\()"
    r"|(?P<block>if|elif|elseif|else|while|for|switch|case|default)\b"
    r"|(?P<end>end|return|break|continue|halt)\b)"
)
_COLON = re.compile(r"[:\n\r]|[(\[{]")
_ASSIGNED = re.compile(
    r"\s*+(?:(?:global|local)\s+)?(?P<name>[A-Za-z_]\w*)\s*+(?P<index>\[[^\[\]]*\])?\s*+=(?!=)\s*+"
)
_END = re.compile(r"\bend\b[^\S\n\r]*+$")
CALL = re.compile(r"\b([A-Za-z_]\w*)\s*+(?=\()")
MOTION_CALL = re.compile(rf"\b(?:{'|'.join(MOTIONS)})\s*\(")
MOVED_TO = re.compile(rf"{MOTION_CALL.pattern}\s*(?:\w+\s*=\s*)?(\w+)\s*[,)]")
_LONGEST = 200  # characters that a constant expression may have


@dataclass(frozen=True, slots=True)
class Statement:
    """A statement.

    word        `def` (of threads too), `if`, `while`, … , `end`; `assign`; `plain`
    name        of a routine or of the variable that is assigned; index: in brackets behind it
    start, end  parameters in parentheses, the value that is assigned, or the whole statement
    """

    word: str
    position: int
    start: int
    end: int
    name: str = ""
    index: str = ""


def statements(code: str) -> Iterator[Statement]:
    """The statements of a script, comments and strings blanked."""
    position = 0
    while position < len(code):
        end = _line_end(code, position)
        yield from _line(code, position, end)
        position = end + 1


def arguments(code: str, opening: int) -> list[tuple[str, int, int]]:
    """Arguments of the call with this parenthesis: name or "", and the span without blanks."""
    end = closing(code, opening)
    found = []
    for start, stop in split(code, opening + 1, end) if end is not None else ():
        named = re.compile(r"\s*+([A-Za-z_]\w*)\s*+=(?!=)").match(code, start, stop)
        first, last = trimmed(code, named.end() if named else start, stop)
        if first < last:
            found.append((named[1] if named else "", first, last))
    return found


def constant(expression: str) -> float | None:
    """The value of an expression of numbers, pi and d2r(); None for anything else."""
    if len(expression) > _LONGEST:
        return None
    try:
        value = _value(ast.parse(expression.strip(), mode="eval").body)
    except (SyntaxError, ValueError, ArithmeticError, RecursionError, MemoryError):
        return None
    return value if value is not None and math.isfinite(value) else None


def _value(node: ast.expr) -> float | None:
    if isinstance(node, ast.Constant):
        number = node.value
        return float(number) if type(number) in (int, float) else None  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        return math.pi if node.id == "pi" else None
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and len(node.args) == 1:
        inner = _value(node.args[0])
        factor = {"d2r": math.pi / 180, "r2d": 180 / math.pi}.get(node.func.id)
        return None if inner is None or factor is None else inner * factor
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        inner = _value(node.operand)
        return -inner if inner is not None and isinstance(node.op, ast.USub) else inner
    if isinstance(node, ast.BinOp):
        left, right = _value(node.left), _value(node.right)
        if left is None or right is None:
            return None
        if isinstance(node.op, ast.Add | ast.Sub):
            return left + right if isinstance(node.op, ast.Add) else left - right
        if isinstance(node.op, ast.Mult | ast.Div):
            return left * right if isinstance(node.op, ast.Mult) else left / right
    return None


def _line_end(code: str, position: int) -> int:
    """The end of the line in which a statement begins; brackets may extend over several lines."""
    while True:
        found = _STOP.search(code, position)
        if found is None:
            return len(code)
        if found[0] in "\n\r":
            return found.start()
        close = closing(code, found.start())
        position = found.end() if close is None else close + 1


def _line(code: str, position: int, end: int) -> Iterator[Statement]:
    while code[position:end].strip():
        header = _HEADER.match(code, position, end)
        if header is None:
            last = _END.search(code, position, end)
            stop = last.start() if last else end
            if code[position:stop].strip():
                yield _simple(code, position, stop)
            position = stop
            if last is None:
                return
            continue
        at = header.end() - len(header[0].lstrip())
        position = header.end()
        if header["end"]:
            yield Statement(header["end"], at, position, end)
            if header["end"] != "end":
                return
            continue
        start, position = position, _colon(code, position, end)
        word = "def" if header["routine"] else header["block"]
        yield Statement(word, at, start, position, header["name"] or "")


def _colon(code: str, position: int, end: int) -> int:
    """The position after the colon that ends the head of a block."""
    while True:
        found = _COLON.search(code, position, end)
        if found is None or found[0] in "\n\r":
            return end
        if found[0] == ":":
            return found.end()
        close = closing(code, found.start())
        position = found.end() if close is None else close + 1


def _simple(code: str, position: int, end: int) -> Statement:
    at, end = trimmed(code, position, end)
    assigned = _ASSIGNED.match(code, position, end)
    if assigned is None:
        return Statement("plain", at, at, end)
    index = (assigned["index"] or "").strip("[] ")
    return Statement("assign", at, assigned.end(), end, assigned["name"], index)
