"""Checks on import, which find problems of measurements before anything is estimated from them."""

from calibtool.measurement.auxiliary import AuxiliaryReadings
from calibtool.measurement.checks.clocks import clock_finding
from calibtool.measurement.checks.design import design_findings
from calibtool.measurement.checks.finding import Finding, rows_off
from calibtool.measurement.checks.kind_checks import kind_findings
from calibtool.measurement.checks.lonely_places import lonely_places
from calibtool.measurement.checks.measuring_process import condition_findings
from calibtool.measurement.checks.nominal_findings import nominal_findings, orientation_finding
from calibtool.measurement.checks.nominal_fit import nominal_fit
from calibtool.measurement.checks.target_distances import shape_findings
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.streams import JointStream

__all__ = ["Finding", "check_measurements", "design_findings", "rows_off"]


def check_measurements(
    measurements: Measurements,
    auxiliary: AuxiliaryReadings | None = None,
    stream: JointStream | None = None,
) -> list[Finding]:
    """All findings about measurements and their auxiliary readings, warnings first.

    stream: the stream of joints, where the joints were taken from one at the stamps of the points.
    Nothing is changed or raised. A check without the data that it needs finds nothing. Row numbers
    count from 1.
    """
    if measurements.kind not in ("points", "pose"):
        return kind_findings(measurements)
    fit = nominal_fit(measurements, free=False)
    mistakes, wrong_rows = nominal_findings(measurements, fit)
    found = [*lonely_places(measurements), *mistakes, *shape_findings(measurements, wrong_rows)]
    if not mistakes and (orientation := orientation_finding(measurements, fit)) is not None:
        found.append(orientation)
    found += condition_findings(measurements, fit, auxiliary or AuxiliaryReadings())
    if (clocks := clock_finding(measurements, stream)) is not None:
        found.append(clocks)
    # it counts the repeated rows too
    repeats = any(finding.name == "repeatability" for finding in found)
    found += [
        finding
        for finding in design_findings(measurements.robot, measurements.q)
        if not (repeats and finding.name == "repeated_configurations")
    ]
    return sorted(found, key=lambda finding: finding.severity != "warning")
