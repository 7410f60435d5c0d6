"""One page about calibrations: what they reach, where, why, and how sure that is."""

from calibtool.evaluation.report.page import html_report

__all__ = ["html_report"]
