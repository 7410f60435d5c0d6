"""Checks on import: errors in measurements that are found before anything is
estimated from them.
"""

from calibtool.measurement.auxiliary import AuxiliaryReadings
from calibtool.measurement.checks.design import design_findings
from calibtool.measurement.checks.finding import Finding
from calibtool.measurement.checks.measuring_process import condition_findings
from calibtool.measurement.checks.nominal_fit import (
    nominal_findings,
    nominal_fit,
    orientation_finding,
)
from calibtool.measurement.checks.target_distances import shape_findings
from calibtool.measurement.measurements import Measurements

__all__ = ["Finding", "check_measurements", "design_findings"]


def check_measurements(
    measurements: Measurements, auxiliary: AuxiliaryReadings | None = None
) -> list[Finding]:
    """All findings about measurements and their auxiliary readings, warnings first.

    Nothing is changed and nothing is raised; a check whose data are missing is skipped. Row numbers
    count from 1.
    """
    fit = nominal_fit(measurements, free=False)
    mistakes, wrong_rows = nominal_findings(measurements, fit)
    found = [*mistakes, *shape_findings(measurements, wrong_rows)]
    if not mistakes and (orientation := orientation_finding(measurements, fit)) is not None:
        found.append(orientation)
    found += condition_findings(measurements, fit, auxiliary or AuxiliaryReadings())
    repeats = any(
        finding.name == "repeatability" for finding in found
    )  # it counts the repeated rows too
    found += [
        finding
        for finding in design_findings(measurements.robot, measurements.q)
        if not (repeats and finding.name == "repeated_configurations")
    ]
    return sorted(found, key=lambda finding: finding.severity != "warning")
