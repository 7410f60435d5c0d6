"""A serial chain from constant placements between joints that turn about z, or slide along it."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from calibtool.robot.orientation import of_fixed_angles
from calibtool.robot.se3 import Array, translation

if TYPE_CHECKING:
    from calibtool.robot.robot import Robot

_MOST = 0.75  # of its length: a chain that is not shortened to this part keeps its frames
_STROKE = 1e3  # m: stands for no limit of a slide; the limits are those of the nominal robot


class Step(NamedTuple):
    """A constant placement: x y z in m, then roll pitch yaw in rad about the fixed axes x, y, z."""

    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)


def chain_urdf(
    steps: Sequence[Sequence[Step]],
    prismatic: Sequence[bool],
    name: str,
    limits: Mapping[int, tuple[float, float]] | None = None,
    axes: Sequence[Sequence[float]] | None = None,
) -> str:
    """The URDF of T(q) = Π_j steps_j · J_j(q_j) · steps_{n+1}, from the link `base` to `tool0`.

    J_j is a turn about axis j (3,), z unless given, or, where prismatic, a slide along it.
    steps: n + 1 products of placements, the last one behind the last joint. limits: (lower, upper)
    in rad or m by the number of the joint, from 0; where there are none a joint turns without end.
    """
    parts, link, fixed = [], "base", 0

    def joint(called: str, kind: str, child: str, step: Step, more: str = "") -> None:
        nonlocal link
        xyz, rpy = (" ".join(repr(float(value)) for value in values) for values in step)
        parts.append(
            f'<joint name="{called}" type="{kind}">'
            f'<parent link="{link}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/>{more}</joint><link name="{child}"/>\n'
        )
        link = child

    for j, (before, slides) in enumerate(zip(steps, [*prismatic, None], strict=True), start=1):
        # All placements but the last one of a product need a link of their own.
        *first, last = before or [Step()]
        for step in first:
            fixed += 1
            joint(f"fixed_{fixed}", "fixed", f"frame_{fixed}", step)
        if slides is None:
            joint("flange", "fixed", "tool0", last)
            break
        axis = " ".join(repr(float(value)) for value in (axes[j - 1] if axes else (0, 0, 1)))
        more, known = f'<axis xyz="{axis}"/>', (limits or {}).get(j - 1)
        if known is not None:
            low, high = (repr(float(value)) for value in known)
            more += f'<limit lower="{low}" upper="{high}" effort="0" velocity="0"/>'
        turning = "continuous" if known is None else "revolute"
        joint(f"joint_{j}", "prismatic" if slides else turning, f"link_{j}", last, more)
    return f'<robot name="{name}">\n<link name="base"/>\n{"".join(parts)}</robot>\n'


def near_frames(steps: Sequence[Sequence[Step]]) -> list[list[Step]]:
    """The same chain with the frame of each z axis at the point nearest to the previous frame.

    The common normal of nearly parallel axes is far away, so that distances to it are no lengths of
    links. A chain that does not become shorter by this is not changed.
    """
    moved, before, lengths, shift = [], 0.0, 0.0, 0.0
    for k, product in enumerate(steps):
        placement = _product([Step((0.0, 0.0, shift)), *product])
        along = float(placement[:3, 2] @ placement[:3, 3]) if k < len(steps) - 1 else 0.0
        moved.append([Step((0.0, 0.0, shift)), *product, Step((0.0, 0.0, -along))])
        before += float(np.linalg.norm(_product(product)[:3, 3]))
        lengths += float(np.linalg.norm(placement[:3, 3] - placement[:3, 2] * along))
        shift = along
    return moved if lengths < _MOST * before else [list(product) for product in steps]


def _product(steps: Sequence[Step]) -> Array:
    """A product of placements (4, 4)."""
    result = np.eye(4)
    for xyz, rpy in steps:
        step = translation(xyz)
        step[:3, :3] = of_fixed_angles(np.array([rpy]))[0]
        result = result @ step
    return result


def chain_of(steps: Sequence[Sequence[Step]], prismatic: Sequence[bool], name: str) -> "Robot":
    """The robot of `chain_urdf`, its slides without limits.

    Raises InputError with `name` for a chain that cannot be built.
    """
    from calibtool.robot.robot import Robot
    from calibtool.robot.source import source_from_urdf

    limits = {j: (-_STROKE, _STROKE) for j, slides in enumerate(prismatic) if slides}
    urdf = chain_urdf(steps, prismatic, "controller", limits)
    return Robot.from_source(source_from_urdf(urdf, name))
