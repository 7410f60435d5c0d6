"""calibtool robots: the catalogue, or one robot."""

from typing import Annotated

import typer

from calibtool.cli.files import write_stdout
from calibtool.cli.options import Json
from calibtool.cli.show import lines, print_json


def robots(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="A robot of the catalogue, or a path.")] = None,
    json: Json = False,
) -> None:
    """List the carried robots, or show one.

    For one robot: joints with limits and axes, targets, workspaces, virtual joints, sources of its numbers.

    Example: calibtool robots fanuc-m1000ia
    """
    from calibtool.robot.catalogue import load_robot, robot_names
    from calibtool.summary import robot_entry, robot_summary

    if name is not None:
        summary = robot_summary(load_robot(name))
        if json:
            print_json(summary)
        else:
            write_stdout(("\n".join(lines(summary)) + "\n").encode())
        return
    entries = [robot_entry(load_robot(each)) for each in robot_names()]
    if json:
        print_json({"schema": "calibtool/robots", "schema_version": 1, "robots": entries})
    else:
        for entry in entries:
            write_stdout(f"{entry['name']:<18} {entry['joints']}  {entry['title']}\n".encode())
