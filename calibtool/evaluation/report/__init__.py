"""One page about calibrations: what they reach, where, why, and how sure that is."""

from calibtool.evaluation.report.occasion import Occasion, parse_occasion
from calibtool.evaluation.report.report_page import html_report

__all__ = ["Occasion", "html_report", "parse_occasion"]
