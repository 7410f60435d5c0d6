"""Kinds that read lengths at one point of the tool."""

import numpy as np

from calibtool.measurement.kinds.kind import Kind

# Where the tool's point may be when a registration starts, m.
STARTS = 0.1 * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])


class ToolPoint(Kind):
    """d lengths, m, read at the set-up's only target."""

    of_points = False
