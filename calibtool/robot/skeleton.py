"""A mechanism as one line through its joints, for pictures."""

import numpy as np

from calibtool.robot.mechanism import Frames
from calibtool.robot.se3 import Array


def skeleton(frames: Frames, placed_on: tuple[int, ...]) -> Array:
    """Origins on a line that runs along every link, in K_0, m: (N, s, 3).

    The line goes from the base through every joint, before and after its motion, to the tool. With
    closed loops it also goes along the branches without the tool, to their cut frames and back.
    placed_on: the joint of each of `Frames.placed`.
    """
    before, after = frames.placed[:, :, :3, 3], frames.after[:, :, :3, 3]
    base, last = np.zeros((len(before), 3)), len(placed_on) - 1
    children = {
        carrier: [k for k, own in enumerate(placed_on) if own == carrier] for carrier in placed_on
    }
    to_tool, carrier = {last}, placed_on[last]
    while carrier >= 0:
        to_tool.add(carrier)
        carrier = placed_on[carrier]
    points: list[Array] = [base]

    def follow(carrier: int, home: Array) -> None:
        for k in sorted(children.get(carrier, []), key=lambda k: k in to_tool):
            points.append(before[:, k])
            if k < after.shape[1]:
                points.append(after[:, k])
                follow(k, after[:, k])
                if k not in to_tool:
                    points.append(before[:, k])
            if k not in to_tool:
                points.append(home)

    follow(-1, base)
    return np.stack(points, axis=1)
