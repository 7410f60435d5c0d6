"""All figures of `plot` and the report: for print, colour-blind safe, the same bytes every time."""

from calibtool.evaluation.plots.arm_picture import draw_arm
from calibtool.evaluation.plots.figures import FIGURES, Subject, draw
from calibtool.evaluation.plots.study_figures import draw_study
from calibtool.evaluation.plots.style import WIDTH_MM, ImageFormat, image_format

__all__ = [
    "FIGURES",
    "WIDTH_MM",
    "ImageFormat",
    "Subject",
    "draw",
    "draw_arm",
    "draw_study",
    "image_format",
]
