"""A serial chain from constant placements between joints that turn about z, or slide along it."""

from collections.abc import Sequence
from typing import NamedTuple

from calibtool.robot.description import source_from_urdf
from calibtool.robot.robot import Robot

_STROKE = 1e3  # m: no limit of a slide; the controller's limits are the nominal robot's


class Step(NamedTuple):
    """A constant placement: x y z in m, then roll pitch yaw in rad about the fixed axes x, y, z."""

    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)


def chain_of(steps: Sequence[Sequence[Step]], prismatic: Sequence[bool], name: str) -> Robot:
    """The robot T(q) = Π_j steps_j · J_j(q_j) · steps_{n+1}.

    J_j is a turn about z or, where prismatic, a slide along it.
    steps: n + 1 products of placements, the last one behind the last joint. Raises InputError with
    `name` for a chain that cannot be built.
    """
    parts, links = [], 0

    def joint(kind: str, step: Step, more: str = "") -> None:
        nonlocal links
        xyz, rpy = (" ".join(repr(float(value)) for value in values) for values in step)
        parts.append(
            f'<joint name="joint{links}" type="{kind}">'
            f'<parent link="link{links}"/><child link="link{links + 1}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/>{more}</joint><link name="link{links + 1}"/>'
        )
        links += 1

    limit = f'<limit lower="{-_STROKE}" upper="{_STROKE}" effort="0" velocity="0"/>'
    for before, slides in zip(steps, [*prismatic, None], strict=True):
        for step in before:
            joint("fixed", step)
        if slides is not None:
            kind, limited = ("prismatic", limit) if slides else ("continuous", "")
            joint(kind, Step(), f'<axis xyz="0 0 1"/>{limited}')
    urdf = f'<robot name="controller"><link name="link0"/>{"".join(parts)}</robot>'
    return Robot.from_source(source_from_urdf(urdf, name))
