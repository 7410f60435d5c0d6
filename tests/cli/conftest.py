"""Fixtures for the command line: an empty working folder for every test, and small files made once
by the commands.
"""

from pathlib import Path

import pytest
from commandline import Files, example_of, run
from typer.testing import Result


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Every test starts in an empty folder of its own."""
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


# A network on local POE that is always there: the default trains one and may leave it out.
EARLY = ["--base", "local-poe", "--regularisation", "early-stopping"]


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """planar-3r: measurements, fresh (the same robot), local-poe, paper, network; fanuc-m1000ia:
    six-…; ur10: ten.
    """
    folder = tmp_path_factory.mktemp("files")

    def path(name: str) -> str:
        return str(folder / f"{name}.h5")

    run("simulate", "planar-3r", "-n", 40, "-o", path("measurements"))
    run(
        "simulate", "planar-3r", "-n", 30, "--same-robot", path("measurements"), "-o", path("fresh")
    )
    run("identify", path("measurements"), "--model", "local-poe", "-o", path("local-poe"))
    run("train", path("measurements"), "--base", "nominal", "--restarts", 1, "-o", path("paper"))
    run("train", path("measurements"), "--restarts", 1, *EARLY, "-o", path("network"))
    run("simulate", "fanuc-m1000ia", "-n", 40, "-o", path("six-measurements"))
    run(
        "simulate",
        "fanuc-m1000ia",
        "-n",
        30,
        "--same-robot",
        path("six-measurements"),
        "-o",
        path("six-fresh"),
    )
    run("train", path("six-measurements"), "--restarts", 1, *EARLY, "-o", path("six-network"))
    run("simulate", "ur10", "-n", 30, "-o", path("ten"))
    return Files(folder)


@pytest.fixture(scope="session")
def demo_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """The demo, run once as its help says: its folder, and what it printed."""
    folder = tmp_path_factory.mktemp("demo")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        result = run(*example_of("demo"))
    return folder / "demo", result
