"""Programs of one text, and single poses, for the tests of programs."""

from collections.abc import Callable

import numpy as np

from calibtool.programs.branches import Controller, solve
from calibtool.programs.configurations import Configuration
from calibtool.programs.formats import read_program
from calibtool.programs.motions import Program, ProgramText
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array


def reader(name: str) -> Callable[[str, Robot], Program]:
    """Reads a text in the language called `name`."""
    return lambda text, robot: read_program(name, [ProgramText("program", text)], robot)


def solve_pose(
    controller: Controller,
    T_base_tool: Array,
    configuration: Configuration | None,
    q_near: Array | None,
) -> Array | str:
    """Joint positions (n,) for one pose (4, 4), or why there are none."""
    near = controller.home if q_near is None else q_near
    strict = np.ones(1, dtype=bool)
    answers = solve(controller, T_base_tool[None], near[None], [configuration], strict)
    row: Array = answers.q[0]
    return answers.why[0] or row
