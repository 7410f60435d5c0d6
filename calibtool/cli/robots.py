"""calibtool robots: the catalogue, one robot, and the check of a description."""

from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.files import check_output, message, write_output, write_stdout, wrote
from calibtool.cli.input_files import RobotOptions, say_doubts
from calibtool.cli.options import Force, Json
from calibtool.cli.printing import print_json, print_summary
from calibtool.errors import UsageError

if TYPE_CHECKING:
    from calibtool.robot.robot import Robot


def robots(
    *,
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="A built-in robot, or the path of a description."),
    ] = None,
    check: Annotated[
        bool,
        typer.Option(
            "--check", help="Check the description: reach, singularities, what can be identified."
        ),
    ] = False,
    picture: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Draw the arm at its home; FILE ends in .png or .svg."),
    ] = None,
    described: RobotOptions,
    json: Json = False,
    force: Force = False,
) -> None:
    """List the built-in robots, show one, or check a description.

    Of one robot: joints with limits and axes, targets, workspaces, virtual joints, sources of its
    numbers. --check takes your own robot.toml, folder or URDF and warns of possible problems; a
    wrong description ends with exit code 3.

    Example: calibtool robots fanuc-m1000ia
    """
    if name is None:
        options = {"check": check, "picture": picture, **vars(described)}
        if option := next((each for each, value in options.items() if value), None):
            raise UsageError(f"--{option} needs a robot: a NAME, or the path of a description")
        _list(json)
        return
    if picture is not None:
        check_output(picture, force)
        from calibtool.evaluation.plots import image_format

        image_format(picture)
    robot = described.load_unchecked(name)
    if check:
        _check(robot, name, json)
    else:
        from calibtool.summary import robot_summary

        _show(robot_summary(robot), json)
        say_doubts(robot)
    if picture is not None:
        from calibtool.evaluation.plots import draw_arm, image_format

        write_output(picture, draw_arm(robot, image_format(picture)), force)
        wrote(picture, f"picture of {robot.name}")


def _list(json: bool) -> None:
    from calibtool.robot.catalogue import load_robot, robot_names
    from calibtool.summary import robot_entry

    entries = [robot_entry(load_robot(each)) for each in robot_names()]
    if json:
        print_json({"schema": "calibtool/robots", "schema_version": 1, "robots": entries})
        return
    for entry in entries:
        write_stdout(f"{entry['name']:<18} {entry['joints']:<8}  {entry['title']}\n".encode())


def _check(robot: "Robot", name: str, json: bool) -> None:
    from calibtool.evaluation.robot_check import check_robot

    found = check_robot(robot, name)
    value = found.as_json()
    _show(value if json else {key: each for key, each in value.items() if key != "warnings"}, json)
    for warning in found.warnings:
        message(f"warning: {warning}")


def _show(value: dict[str, object], json: bool) -> None:
    if json:
        print_json(value)
    else:
        print_summary(value)
