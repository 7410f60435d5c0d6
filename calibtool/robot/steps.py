"""A serial chain from constant placements between joints that turn about z, or slide along it."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from calibtool.robot.model import Robot

_STROKE = 1e3  # m: no limit of a slide; the controller's limits are the nominal robot's


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


def chain_of(steps: Sequence[Sequence[Step]], prismatic: Sequence[bool], name: str) -> "Robot":
    """The robot of `chain_urdf`, its slides without limits.

    Raises InputError with `name` for a chain that cannot be built.
    """
    from calibtool.robot.description import source_from_urdf
    from calibtool.robot.model import Robot

    limits = {j: (-_STROKE, _STROKE) for j, slides in enumerate(prismatic) if slides}
    urdf = chain_urdf(steps, prismatic, "controller", limits)
    return Robot.from_source(source_from_urdf(urdf, name))
