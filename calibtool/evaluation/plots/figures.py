"""The figures by name, with the data that each needs."""

from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

from calibtool.calibration import Calibration
from calibtool.errors import UsageError, near_names
from calibtool.evaluation.acceptance import Limit
from calibtool.evaluation.compare import Evaluation, judged_rows
from calibtool.evaluation.observed import noise_of_errors
from calibtool.evaluation.plots import calibration_figures, error_figures
from calibtool.evaluation.plots.style import WIDTH_MM, ImageFormat, styled, to_bytes
from calibtool.measurement.measurements import Measurements


@dataclass(frozen=True, eq=False)
class Subject:
    """What figures and reports are made from.

    calibrations  with their names
    measurements  on which they are judged, None where they are not
    evaluation    their errors there
    limits        acceptance limits to draw
    """

    calibrations: list[tuple[str, Calibration]]
    measurements: Measurements | None = None
    evaluation: Evaluation | None = None
    limits: tuple[Limit, ...] = ()

    @property
    def evaluated(self) -> Evaluation:
        """The errors on the measurements. UsageError where there are none."""
        if self.evaluation is None:
            raise UsageError("this figure needs measurements to judge on")
        return self.evaluation


def _with_evaluation(subject: Subject) -> tuple[Measurements, Evaluation]:
    evaluation = subject.evaluated
    assert subject.measurements is not None
    return judged_rows(subject.measurements), evaluation


def _vectors(subject: Subject, width_mm: float) -> Figure:
    judged, evaluation = _with_evaluation(subject)
    return error_figures.vectors(
        evaluation, judged.robot.mechanism.forward(judged.q)[:, :3, 3], width_mm
    )


def _coverage(subject: Subject, width_mm: float) -> Figure:
    judged, _ = _with_evaluation(subject)
    return calibration_figures.coverage(subject.calibrations, judged.robot, judged.q, width_mm)


def _floors(subject: Subject) -> dict[str, float | None]:
    """What the noise of the measurement alone gives, in mm and mrad."""
    measurements, evaluation = subject.measurements, subject.evaluation
    if measurements is None or evaluation is None or evaluation.kind == "compensated":
        return {}
    return {
        key: None if value is None else value * 1e3
        for key, value in noise_of_errors(measurements).items()
    }


# The figures by name; those that need measurements raise UsageError without them.
FIGURES: dict[str, Callable[[Subject, float], Figure]] = {
    "errors": lambda s, w: error_figures.errors(s.evaluated, w, _floors(s)),
    "distribution": lambda s, w: error_figures.distribution(s.evaluated, s.limits, w, _floors(s)),
    "vectors": _vectors,
    "training": lambda s, w: calibration_figures.training(s.calibrations, w),
    "motions": lambda s, w: calibration_figures.motions(s.calibrations, w),
    "parameters": lambda s, w: calibration_figures.parameters(s.calibrations, w),
    "observability": lambda s, w: calibration_figures.observability(s.calibrations, w),
    "coverage": _coverage,
    "iso9283": lambda s, w: error_figures.pose_test(s.evaluated, w),
}


def draw(
    kind: str,
    subject: Subject,
    image: ImageFormat,
    width_mm: float = WIDTH_MM,
    *,
    letters: bool = False,
) -> bytes:
    """The figure called `kind`, as the bytes of a picture of this width.

    letters: text of an SVG stays text, in the reader's font, on no background: for a page.
    UsageError for an unknown figure, or one that needs measurements without them; InputError where
    the subject has nothing of the kind to show.
    """
    if kind not in FIGURES:
        raise UsageError(f"unknown figure '{kind}'; {near_names(kind, FIGURES)}")
    with styled():
        return to_bytes(FIGURES[kind](subject, width_mm), image, letters=letters)
