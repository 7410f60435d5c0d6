"""calibtool demo: the whole way on the built-in robot."""

from pathlib import Path
from typing import Annotated

import typer

from calibtool.cli.evaluate import show_evaluation
from calibtool.cli.files import STREAM, message, write_output
from calibtool.cli.options import Force, Seed
from calibtool.cli.provenance import provenance
from calibtool.errors import UsageError


def demo(
    output: Annotated[
        str, typer.Option("-o", "--output", metavar="DIR", help="Folder for the results.")
    ] = "demo",
    sample: Annotated[
        bool,
        typer.Option("--sample", help="Instead: copy the sample of the pages into the folder."),
    ] = False,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Run the whole way once, on a simulated robot.

    On the FANUC M-1000iA: files, table, report, plots and C code in one folder. --sample copies a
    tracker's files, targets and a program to try the commands on.

    Example: calibtool demo -o demo
    """
    if not output:
        raise UsageError("-o: the folder has no name")
    if output == STREAM:
        raise UsageError("demo writes a folder; give -o DIR")
    folder = Path(output)
    if folder.is_file():
        raise UsageError(f"{output}: is a file; give the name of a folder")
    if folder.is_dir() and any(folder.iterdir()) and not force:
        raise UsageError(
            f"{output}: exists already and is not empty; choose another name, or add --force"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{output}: cannot be made: {error.strerror or error}") from None

    def write(name: str, contents: bytes | str) -> None:
        write_output(str(folder / name), contents, True)

    if sample:
        from calibtool.robot.shipped import shipped

        for path in sorted((shipped("data") / "sample").iterdir()):
            if path.suffix in (".csv", ".ls"):
                write(path.name, path.read_text(encoding="utf-8"))
                message(f"  {folder / path.name}")
        return
    from calibtool.demo import REPORT, run_demo

    result = run_demo(seed, provenance(seed), write, message)
    show_evaluation(result)
    message(f"Everything is in {folder}:")
    seen = [
        folder / REPORT,
        *sorted(path for path in folder.iterdir() if path.suffix in (".png", ".svg")),
    ]
    for path in sorted(path for path in folder.iterdir() if path not in seen):
        message(f"  {path}")
    message("To look at:")  # last, next to the prompt
    for path in seen:
        message(f"  {path}")
