"""calibtool plot: every figure, as PNG, SVG and PDF."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from commandline import Files, refused, remarks, run


def looks_like(path: str) -> str:
    """The format of an image by its contents."""
    data = Path(path).read_bytes()
    if data.startswith(b"\x89PNG\r\n\x1a\n") and data.endswith(b"IEND\xaeB`\x82"):
        return "png"
    if data.startswith(b"%PDF-"):
        return "pdf"
    return ElementTree.fromstring(data).tag.removeprefix("{http://www.w3.org/2000/svg}")


@pytest.mark.parametrize("name", ["figure.png", "FIGURE.SVG", "figure.pdf"])
def test_formats_of_the_training_curve(files: Files, name: str) -> None:
    result = run("plot", "training", files.network, "-o", name)
    assert looks_like(name) == name.lower().split(".")[1]
    assert result.stdout_bytes == b""
    assert remarks(result) == ""


def test_errors_name_every_method(files: Files) -> None:
    run("plot", "errors", files.network, files.paper, "--on", files.fresh, "-o", "a.svg")
    text = Path("a.svg").read_text(encoding="utf-8")
    assert looks_like("a.svg") == "svg"
    assert all(
        f">{name}<" in text or f"<!-- {name} -->" in text
        for name in ("nominal", "network", "paper")
    )


@pytest.mark.parametrize("image", ["svg", "pdf"])
def test_the_same_command_gives_the_same_bytes(files: Files, image: str) -> None:
    for name in ("a", "b"):
        run("plot", "training", files.network, "-o", f"{name}.{image}")
    assert Path(f"a.{image}").read_bytes() == Path(f"b.{image}").read_bytes()


def test_a_calibration_from_stdin(files: Files) -> None:
    run("plot", "training", "-", "-o", "a.png", stdin=Path(files.network).read_bytes())
    assert looks_like("a.png") == "png"


@pytest.mark.parametrize("name", ["figure.eps", "figure", "png", "-"])
def test_other_formats_are_refused(files: Files, name: str) -> None:
    message = refused(2, "plot", "training", files.network, "-o", name)
    assert ".png" in message
    assert ".svg" in message


def test_errors_need_measurements(files: Files) -> None:
    assert "--on" in refused(2, "plot", "errors", files.network, "-o", "a.png")


def test_training_needs_a_network(files: Files) -> None:
    assert "local-poe" in refused(3, "plot", "training", files.local_poe, "-o", "a.png")
    run("plot", "training", files.network, files.local_poe, "-o", "a.png")


@pytest.mark.parametrize("kind", ["motions", "coverage"])
def test_the_other_figures(files: Files, kind: str) -> None:
    run("plot", kind, files.network, "--on", files.fresh, "-o", "a.png", "--width-mm", 85)
    assert looks_like("a.png") == "png"


def test_limits_are_drawn_into_the_distribution(files: Files) -> None:
    limit = "position_max_mm=2.5"
    run(
        "plot",
        "distribution",
        files.network,
        "--on",
        files.fresh,
        "-o",
        "a.svg",
        "--require",
        limit,
    )
    assert "max ≤ 2.5 mm" in Path("a.svg").read_text(encoding="utf-8")


def test_the_width_is_that_of_the_column(files: Files) -> None:
    for width in (85, 180):
        run("plot", "training", files.network, "-o", "a.svg", "--width-mm", width, "--force")
        root = ElementTree.parse("a.svg").getroot()
        assert float(root.attrib["width"].removesuffix("pt")) == pytest.approx(
            width / 25.4 * 72, abs=1e-3
        )
    refused(2, "plot", "training", files.network, "-o", "b.svg", "--width-mm", 5)


def test_figures_without_anything_to_show_state_why(files: Files) -> None:
    assert "local-poe.h5: " in refused(3, "plot", "motions", files.local_poe, "-o", "b.png")
    assert "uncertainty" in refused(3, "plot", "parameters", files.local_poe, "-o", "b.png")
    assert "ISO 9283" in refused(
        3, "plot", "iso9283", files.network, "--on", files.fresh, "-o", "b.png"
    )


def test_calibrations_of_different_robots_are_not_drawn_together(files: Files) -> None:
    refused(3, "plot", "observability", files.network, files.six_network, "-o", "b.png")


def test_unknown_figure(files: Files) -> None:
    assert "errors" in refused(2, "plot", "eror", files.network, "-o", "a.png")
    refused(2, "plot", "training", files.network)
