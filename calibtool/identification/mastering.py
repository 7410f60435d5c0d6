"""Joint offsets as a controller's mastering screen takes them, by a stated gauge.

A turn of a joint's placement about its axis, ξ_j·ζ_j, does what its offset q_j does: nothing
measured tells them apart, and the fit splits them by their tolerances. The gauge: all of it is the
joint's offset, q_j + ξ_jᵀζ_j, and the placement keeps the rest.
"""

from dataclasses import dataclass

import numpy as np

from calibtool.identification.identification import Identification
from calibtool.identification.report import AT_PRIOR
from calibtool.robot.se3 import Array


@dataclass(frozen=True)
class Offset:
    """The offset of one joint: what is to be added to its joint value, ± its standard deviation,
    rad or m; whether the measurements tell it.
    """

    joint: int
    value: float
    std: float
    observable: bool
    prismatic: bool

    @property
    def text(self) -> str:
        """For people, in degrees or mm."""
        factor, unit = (1e3, "mm") if self.prismatic else (180.0 / np.pi, "deg")
        unseen = "" if self.observable else " (not observable here)"
        value = f"{self.value * factor:+.4f} ± {self.std * factor:.4f} {unit}"
        return f"offset of joint {self.joint}: {value}{unseen}"

    def as_json(self) -> dict[str, object]:
        """Units in the keys."""
        factor, unit = (1e3, "mm") if self.prismatic else (180.0 / np.pi, "deg")
        return {
            "joint": self.joint,
            f"offset_{unit}": self.value * factor,
            f"std_{unit}": self.std * factor,
            "observable": self.observable,
        }


def mastering(identification: Identification) -> list[Offset]:
    """The offset of every joint by the gauge; none where no offset was identified."""
    posterior = identification.posterior
    if posterior is None or "offsets" not in posterior.parameters.orders:
        return []
    robot, parameters = identification.errors.robot, posterior.parameters
    weights = _gauge(identification)
    values = weights @ identification.state.vector(parameters)
    std = np.sqrt(np.einsum("jp,pq,jq->j", weights, posterior.covariance, weights))
    prior = np.sqrt((weights**2) @ posterior.prior_std**2)
    joints = next(part for part in parameters.parts if part.family.id == "offsets").elements
    return [
        Offset(
            int(j) + 1,
            float(values[k]),
            float(std[k]),
            bool(std[k] <= AT_PRIOR * prior[k]),
            bool(robot.prismatic[j]),
        )
        for k, j in enumerate(joints)
    ]


def _gauge(identification: Identification) -> Array:
    """What of every parameter is an offset of each joint: (joints, p)."""
    posterior = identification.posterior
    assert posterior is not None
    robot, parameters = identification.errors.robot, posterior.parameters
    parts = {part.family.id: part for part in parameters.parts}
    offsets = parts["offsets"].elements
    weights = np.zeros((len(offsets), parameters.count))
    start = parameters.blocks["offsets"].start
    weights[np.arange(len(offsets)), start + np.arange(len(offsets))] = 1.0
    if "placements" in parts and robot.chain.tree is None:
        start = parameters.blocks["placements"].start
        for column, element in enumerate(parts["placements"].elements):
            joint, component = divmod(int(element), 6)
            for k in np.flatnonzero(offsets == joint):
                weights[k, start + column] = robot.chain.twists[joint, component]
    return weights
