"""What an identification tells people: its parameters with their uncertainty, and which of them the data mix up."""

from dataclasses import dataclass

import numpy as np

from calibtool.identification.model import Identification, Posterior
from calibtool.robot.model import Robot
from calibtool.robot.motion import largest_torque
from calibtool.robot.se3 import Array

AT_PRIOR = 0.99  # a standard deviation above this part of the tolerance: the data said nothing


@dataclass(frozen=True)
class ParameterRow:
    """One parameter in `unit`: value ± std, tolerance, how much of the prior's width the data removed (0 to 1)."""

    name: str
    unit: str
    value: float
    std: float
    tolerance: float
    determined: float

    @property
    def at_prior(self) -> bool:
        """Not observable from these configurations."""
        return self.std > AT_PRIOR * self.tolerance


def parameter_rows(robot: Robot, identification: Identification) -> list[ParameterRow]:
    """Every parameter of a complete model in mm and mrad; a wind-up at the joint's largest torque."""
    posterior = identification.posterior
    if posterior is None:
        return []
    theta = identification.state.vector(posterior.parameters)
    std, prior = posterior.std, posterior.prior_std
    factors, units = _display(robot, posterior)
    return [
        ParameterRow(
            name=name,
            unit=units[i],
            value=float(theta[i] * factors[i]),
            std=float(std[i] * factors[i]),
            tolerance=float(prior[i] * factors[i]),
            determined=float(1.0 - (std[i] / prior[i]) ** 2),
        )
        for i, name in enumerate(posterior.parameters.names)
    ]


def backlash_text(robot: Robot, backlash: Array) -> str:
    """Half widths (n,) of all joints for people: `0.104, 0.098 mrad`, with mm for prismatic ones."""
    units = ["mm" if prismatic else "mrad" for prismatic in robot.prismatic]
    if len(set(units)) == 1:
        return ", ".join(f"{value * 1e3:.3f}" for value in backlash) + f" {units[0]}"
    return ", ".join(f"{value * 1e3:.3f} {unit}" for value, unit in zip(backlash, units, strict=True))


def strongest_correlations(posterior: Posterior, count: int = 5) -> list[tuple[str, str, float]]:
    """Pairs of parameters that the data can hardly tell apart, largest correlation first."""
    correlation = posterior.covariance / np.outer(posterior.std, posterior.std)
    rows, columns = np.triu_indices(len(correlation), k=1)
    order = np.argsort(-np.abs(correlation[rows, columns]))[:count]
    names = posterior.parameters.names
    return [(names[rows[k]], names[columns[k]], float(correlation[rows[k], columns[k]])) for k in order]


def _display(robot: Robot, posterior: Posterior) -> tuple[Array, list[str]]:
    """Factor and unit in which people read each parameter."""
    factors = np.full(posterior.parameters.count, 1e3)
    units = []
    for i, name in enumerate(posterior.parameters.names):
        family, _, component = name.partition(".")
        if family.startswith("gravity"):
            factors[i] = 1e3 * largest_torque(robot)[int(family[7:]) - 1]
            units.append("mrad")
        elif family.startswith("backlash"):
            units.append("mm" if robot.prismatic[int(family[8:]) - 1] else "mrad")
        elif component:
            unit = "mrad" if component.startswith("r") else "mm"
            moves = family.startswith("ξ")
            per = "/m" if moves and robot.prismatic[int(family[1:]) - 1] else "/rad"
            units.append(unit + per if moves else unit)
        elif family.startswith("q"):
            units.append("mm" if robot.prismatic[int(family[1:]) - 1] else "mrad")
        else:
            units.append("mrad")
    return factors, units
