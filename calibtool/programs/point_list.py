"""Joint positions as a program of a controller: a motion, a rest and a comment for each."""

import re
from collections.abc import Callable, Sequence
from pathlib import PurePath
from typing import NamedTuple

import numpy as np

from calibtool.errors import UsageError
from calibtool.programs.formats import coupling_of, detected
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

_REST = 2.0  # s of waiting at every position, for the instrument
_AXES = 6  # number of axes in the positions of KUKA and ABB


class Row(NamedTuple):
    """One position: joint values as the controller shows them, deg or mm, and its comment."""

    number: int
    values: list[float]
    comment: str


Writer = Callable[[str, Sequence[Row], Robot], str]  # of a program of some name


def point_list(
    path: str, robot: Robot, q: Array, comments: Sequence[Sequence[str]] | None = None
) -> str:
    """A program with joint positions q (N, n), rad or m, in the language of the file's suffix.

    comments: texts of every row. The joint values are those of the controller. Raises UsageError
    for an unknown suffix, or for an arm with joints that the language cannot express.
    """
    writer = _writer(path)
    language = detected("", path)
    assert language is not None
    coupling = coupling_of(robot, language, None)
    shown = np.linalg.solve(coupling, q.T).T
    factors = np.array([robot.display_unit(j)[0] for j in range(robot.n)])
    texts = comments or [()] * len(q)
    rows = [
        Row(k + 1, [float(v) + 0.0 for v in np.round(values, 6)], _plain(", ".join(text)))
        for k, (values, text) in enumerate(zip(shown * factors, texts, strict=True))
    ]
    name = re.sub(r"\W", "_", PurePath(path).stem, flags=re.ASCII)[:24] or "plan"
    name = name if name[0].isalpha() else f"p{name}"
    return writer(name, rows, robot)


def check_suffix(path: str) -> None:
    """UsageError for a suffix of no language that can be written."""
    _writer(path)


def _fanuc(name: str, rows: Sequence[Row], robot: Robot) -> str:
    units = ["mm" if slides else "deg" for slides in robot.prismatic]
    motions, positions = [], []
    for row in rows:
        step = 3 * (row.number - 1)
        text = row.comment or f"row {row.number}"
        motions += [
            f"{step + 1:4d}:  !{text[:32]} ;",
            f"{step + 2:4d}:J P[{row.number}] 20% FINE    ;",
            f"{step + 3:4d}:  WAIT   {_REST:.2f}(sec) ;",
        ]
        joints = [f"J{i + 1}={v:12.6f} {units[i]}" for i, v in enumerate(row.values)]
        lines = [",\t".join(joints[i : i + 3]) for i in range(0, len(joints), 3)]
        body = ",\n\t".join(lines)
        positions.append(f"P[{row.number}]{{\n   GP1:\n\tUF : 0, UT : 1,\n\t{body}\n}};")
    head = f"/PROG  {name.upper()}\n/ATTR\nDEFAULT_GROUP\t= 1,*,*,*,*;\n/MN"
    return "\n".join([head, *motions, "/POS", *positions, "/END", ""])


def _kuka(name: str, rows: Sequence[Row], robot: Robot) -> str:
    _room(robot, "KRL")
    lines = [f"DEF {name}( )", "BAS(#INITMOV, 0)", "BAS(#VEL_PTP, 20)"]
    for row in rows:
        axes = ", ".join(f"A{i + 1} {value:.6f}" for i, value in enumerate(row.values))
        lines += [f"; {row.comment or f'row {row.number}'}", f"PTP {{{axes}}}"]
        lines += [f"WAIT SEC {_REST:.1f}"]
    return "\n".join([*lines, "END", ""])


def _abb(name: str, rows: Sequence[Row], robot: Robot) -> str:
    _room(robot, "RAPID")
    none = ",".join(["9E9"] * 6)
    lines = [f"MODULE {name}", f"  PROC {name}_rows()"]
    for row in rows:
        values = [f"{value:.6f}" for value in row.values] + ["0"] * (_AXES - len(row.values))
        lines += [f"    ! {row.comment or f'row {row.number}'}"]
        lines += [f"    MoveAbsJ [[{','.join(values)}],[{none}]]\\NoEOffs,v200,fine,tool0;"]
        lines += [f"    WaitTime {_REST:.1f};"]
    return "\n".join([*lines, "  ENDPROC", "ENDMODULE", ""])


def _ur(name: str, rows: Sequence[Row], robot: Robot) -> str:
    if any(robot.prismatic) or robot.n != _AXES:
        raise UsageError(f"{robot.name}: URScript moves arms of six revolute joints")
    lines = [f"def {name}():"]
    for row in rows:
        joints = ", ".join(f"{np.deg2rad(value):.9f}" for value in row.values)
        lines += [f"  # {row.comment or f'row {row.number}'}", f"  movej([{joints}], a=0.5, v=0.4)"]
        lines += [f"  sleep({_REST:.1f})"]
    return "\n".join([*lines, "end", f"{name}()", ""])


_WRITERS: dict[str, Writer] = {".ls": _fanuc, ".src": _kuka, ".mod": _abb, ".script": _ur}


def _writer(path: str) -> Writer:
    suffix = PurePath(path).suffix.lower()
    if suffix not in _WRITERS:
        raise UsageError(
            f"{path}: a program of rows is .ls (FANUC), .src (KUKA), .mod (ABB) or .script (UR)"
        )
    return _WRITERS[suffix]


def _room(robot: Robot, language: str) -> None:
    if robot.n > _AXES:
        raise UsageError(
            f"{robot.name}: {robot.n} joints; {language} positions have room for {_AXES}"
        )


def _plain(text: str) -> str:
    """Text of a comment without characters that end the line."""
    return re.sub(r"[^\w .,:+-]", "_", text)
