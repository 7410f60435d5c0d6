"""The errors as arrows in 3-D for the page: tool positions and errors of every method."""

import json

import numpy as np

from calibtool.evaluation.compare import judged_rows
from calibtool.evaluation.plots import Subject
from calibtool.evaluation.plots.error_figures import magnification
from calibtool.measurement.sampling import spread_rows

_ARROWS = 400


def error_scene(subject: Subject) -> str:
    """A JSON object: `positions` (k, 3) of the tool in K_0, m, and `methods` with their `errors`
    (k, 3), m, and the `factor` by which they are drawn; `start` is that of the least mean error.
    """
    assert subject.measurements is not None
    rows = judged_rows(subject.measurements)
    chosen = spread_rows(len(rows), _ARROWS)
    position = rows.robot.mechanism.forward(rows.q)[:, :3, 3]
    extent = max(float(np.ptp(position, axis=0).max()), 1e-3)
    methods, least = [], []
    for each in subject.evaluated.methods:
        error = each.position.mean(axis=1)
        least.append(float(each.position_size.mean()))
        methods.append(
            {
                "name": each.name,
                "factor": magnification(extent, error),
                "errors": np.round(error[chosen], 7).tolist(),
            }
        )
    scene = {
        "positions": np.round(position[chosen], 4).tolist(),
        "methods": methods,
        "start": int(np.argmin(least)),
    }
    text = json.dumps(scene, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace("&", "\\u0026")
