"""A command with a group of options behaves as one with the same options written out."""

from dataclasses import dataclass
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from calibtool.cli.option_groups import with_groups

Size = Annotated[float, typer.Option("--size-mm", min=0, help="A size.")]
Names = Annotated[list[str] | None, typer.Option("--name", help="Repeatable.")]


@dataclass(frozen=True)
class Group:
    size_mm: Size = 0.5
    name: Names = None


def grouped(*, file: Annotated[str, typer.Argument()], group: Group, force: bool = False) -> None:
    typer.echo((file, group.size_mm, group.name or [], force))


def written_out(
    file: Annotated[str, typer.Argument()],
    size_mm: Size = 0.5,
    name: Names = None,
    force: bool = False,
) -> None:
    typer.echo((file, size_mm, name or [], force))


def output(command: object, *arguments: str) -> tuple[int, str]:
    app = typer.Typer()
    app.command(name="command")(command)  # type: ignore[arg-type, type-var]
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, result.output


@pytest.mark.parametrize(
    "arguments",
    [
        ("a",),
        ("a", "--size-mm", "2", "--force"),
        ("a", "--name", "x", "--name", "y"),
        ("--help",),
        ("a", "--size-mm", "-1"),
        ("a", "--other"),
        (),
    ],
)
def test_it_is_the_same_command(arguments: tuple[str, ...]) -> None:
    assert output(with_groups(grouped), *arguments) == output(written_out, *arguments)


def test_values_reach_their_group() -> None:
    assert output(with_groups(grouped), "a", "--name", "x") == (0, "('a', 0.5, ['x'], False)\n")
