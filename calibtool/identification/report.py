"""Report of an identification: parameters with uncertainties, and the most correlated ones."""

from dataclasses import dataclass

import numpy as np

from calibtool.identification.identification import Identification, Posterior
from calibtool.tables import format_table

AT_PRIOR = 0.99  # a standard deviation above this part of the tolerance: the data said nothing


@dataclass(frozen=True)
class ParameterRow:
    """One parameter: value ± std in `unit`, tolerance, and the part of the prior's width (0 to 1)
    that the data removed.

    name: as in formulas; id: in ASCII; family: description, None for the set-up.
    """

    name: str
    id: str
    family: str | None
    unit: str
    value: float
    std: float
    tolerance: float
    determined: float

    @property
    def at_prior(self) -> bool:
        """Whether these configurations do not determine the parameter."""
        return self.std > AT_PRIOR * self.tolerance


def parameter_rows(identification: Identification) -> list[ParameterRow]:
    """All parameters of a complete model in mm and mrad; wind-up at the joint's largest torque."""
    posterior = identification.posterior
    if posterior is None:
        return []
    theta = identification.state.vector(posterior.parameters)
    std, prior = posterior.std, posterior.prior_std
    factors, units = posterior.parameters.display()
    families = posterior.parameters.family_words
    return [
        ParameterRow(
            name=name,
            id=posterior.parameters.ids[i],
            family=families[i],
            unit=units[i],
            value=float(theta[i] * factors[i]),
            std=float(std[i] * factors[i]),
            tolerance=float(prior[i] * factors[i]),
            determined=float(max(1.0 - (std[i] / prior[i]) ** 2, 0.0)),
        )
        for i, name in enumerate(posterior.parameters.names)
    ]


def parameter_table(identifications: list[tuple[str, Identification]]) -> str:
    """Every parameter of named identifications as a CSV text; `determined` from 0 to 1."""
    header = ["calibration", "parameter", "value", "std", "tolerance", "unit", "determined"]
    rows = [
        [
            name,
            row.id,
            *(f"{value:.9g}" for value in (row.value, row.std, row.tolerance)),
            row.unit,
            f"{row.determined:.6f}",
        ]
        for name, identification in identifications
        for row in parameter_rows(identification)
    ]
    return format_table(header, rows)


def strongest_correlations(posterior: Posterior, count: int = 5) -> list[tuple[str, str, float]]:
    """Pairs of parameters that the data can hardly tell apart, largest correlation first."""
    std = np.sqrt(np.diag(posterior.covariance))
    correlation = posterior.covariance / np.outer(std, std)
    rows, columns = np.triu_indices(len(correlation), k=1)
    order = np.argsort(-np.abs(correlation[rows, columns]))[:count]
    names = posterior.parameters.names
    return [
        (names[rows[k]], names[columns[k]], float(correlation[rows[k], columns[k]])) for k in order
    ]
