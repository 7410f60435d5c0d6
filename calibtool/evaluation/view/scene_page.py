"""The scene as one HTML file that needs nothing else: no server, no network, no library."""

import json
from collections.abc import Sequence

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from calibtool.evaluation.view.scene import Scene
from calibtool.evaluation.view.solids import Solid
from calibtool.robot.se3 import Array


def page_of(scene: Scene, magnify: float, pieces: Sequence[Solid] = ()) -> str:
    """A page with the scene on a canvas: drag to turn, wheel to zoom, sliders for configuration
    and magnification.

    magnify: initial magnification. pieces: shape of the arm (`solids`); lines if there are none.
    Coordinates are rounded to 1 µm, errors are kept to 0.1 µm; the same scene gives the same text.
    """
    environment = Environment(
        loader=PackageLoader("calibtool.evaluation.view"),
        undefined=StrictUndefined,
        autoescape=True,
    )
    data = {
        "arm": _numbers(scene.arm, 6),
        "nominal": _numbers(scene.nominal, 6),
        "error": _numbers(scene.found - scene.nominal, 7),
        "size_mm": _numbers(scene.error_rms * 1e3, 4),
        "solids": [
            {
                "vertices": _numbers(piece.vertices, 4),
                "faces": piece.faces.tolist(),
                "colour": _numbers(piece.colour, 2),
                "placements": _numbers(piece.placements.reshape(len(scene), 12), 4),
            }
            for piece in pieces
        ],
    }
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return environment.get_template("scene.html.j2").render(
        robot=scene.robot.name,
        meaning=scene.meaning,
        count=len(scene),
        magnify=f"{magnify:g}",
        data=text,
    )


def _numbers(values: Array, digits: int) -> object:
    """Nested lists, None for what was not seen."""
    numbers = np.round(values, digits).astype(object)
    numbers[np.isnan(values)] = None
    return numbers.tolist()
