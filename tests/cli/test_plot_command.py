"""calibtool plot: the two figures, as PNG and SVG."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from commandline import Files, refused, run


def looks_like(path: str) -> str:
    """The format of an image by its contents."""
    data = Path(path).read_bytes()
    if data.startswith(b"\x89PNG\r\n\x1a\n") and data.endswith(b"IEND\xaeB`\x82"):
        return "png"
    return ElementTree.fromstring(data).tag.removeprefix("{http://www.w3.org/2000/svg}")


@pytest.mark.parametrize("name", ["figure.png", "figure.svg", "FIGURE.SVG"])
def test_formats_of_the_training_curve(files: Files, name: str) -> None:
    result = run("plot", "training", files.network, "-o", name)
    assert looks_like(name) == name.lower().split(".")[1]
    assert result.stdout_bytes == b""
    assert result.stderr == ""


def test_errors_name_every_method(files: Files) -> None:
    run("plot", "errors", files.network, files.paper, "--on", files.fresh, "-o", "a.svg")
    text = Path("a.svg").read_text(encoding="utf-8")
    assert looks_like("a.svg") == "svg"
    assert all(f">{name}<" in text or f"<!-- {name} -->" in text for name in ("nominal", "network", "paper"))
    run("plot", "errors", files.network, "--on", files.fresh, "-o", "a.png")
    assert looks_like("a.png") == "png"


@pytest.mark.parametrize("image", ["png", "svg"])
def test_the_same_command_gives_the_same_bytes(files: Files, image: str) -> None:
    for name in ("a", "b"):
        run("plot", "training", files.network, "-o", f"{name}.{image}")
    assert Path(f"a.{image}").read_bytes() == Path(f"b.{image}").read_bytes()


def test_a_calibration_from_stdin(files: Files) -> None:
    run("plot", "training", "-", "-o", "a.png", stdin=Path(files.network).read_bytes())
    assert looks_like("a.png") == "png"


@pytest.mark.parametrize("name", ["figure.pdf", "figure", "png", "-"])
def test_other_formats_are_refused(files: Files, name: str) -> None:
    message = refused(2, "plot", "training", files.network, "-o", name)
    assert ".png" in message
    assert ".svg" in message


def test_errors_need_measurements(files: Files) -> None:
    assert "--on" in refused(2, "plot", "errors", files.network, "-o", "a.png")


def test_training_needs_a_network(files: Files) -> None:
    assert "local-poe" in refused(3, "plot", "training", files.local_poe, "-o", "a.png")
    run("plot", "training", files.network, files.local_poe, "-o", "a.png")


def test_unknown_figure(files: Files) -> None:
    assert "errors" in refused(2, "plot", "eror", files.network, "-o", "a.png")
    refused(2, "plot", "training", files.network)
