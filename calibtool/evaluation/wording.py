"""Names of the quantities of an evaluation: `after` is used only for what was measured."""

from dataclasses import dataclass

from calibtool.evaluation.compare import Evaluation, Kind
from calibtool.evaluation.proof import Before

OPTIMISERS = {"lm": "Levenberg–Marquardt", "gd": "gradient descent"}
REGULARISATIONS = {
    "bayes": "with Bayesian regularisation",
    "early-stopping": "with early stopping",
}


@dataclass(frozen=True)
class Words:
    """Names of the quantities of an evaluation.

    how            what was compared, for headings
    before, after  heading of the nominal robot's column and of a calibration's
    remark         one sentence that describes the errors
    """

    how: str
    before: str
    after: str
    remark: str


_COMPENSATED = Words(
    how="driven to corrected joints, simulated without noise",
    before="before, simulated",
    after="after, simulated",
    remark="The actual robot of the simulation was driven to the corrected joints and observed "
    "without noise.",
)
_PREDICTED = Words(
    how="expected after correction: measured minus predicted",
    before="nominal robot",
    after="expected after correction",
    remark="The arm was not driven to corrected joints. Errors are the differences between "
    "measured and predicted target points, which is what to expect after correction; they contain "
    "the noise of the measurement.",
)
_MEASURED = Words(
    how="commanded against measured",
    before="before, measured",
    after="after, measured",
    remark="The arm was driven to the corrected joints. Errors are the differences between "
    "measured and commanded target points; they contain the noise of the measurement.",
)
_AFTER_ALONE = Words(
    how=_MEASURED.how,
    before="expected before correction",
    after=_MEASURED.after,
    remark=f"{_MEASURED.remark} Nothing was measured before the correction: that column is what "
    "the model expects.",
)


def words(kind: Kind, before: Before | None) -> Words:
    """Names for an evaluation of a kind.

    before: how the errors before the correction were obtained, for kind `measured`; otherwise None.
    """
    if kind == "measured":
        return _MEASURED if before == "measured" else _AFTER_ALONE
    return _COMPENSATED if kind == "compensated" else _PREDICTED


def outcome_sentence(evaluation: Evaluation, name: str, before: str, after: str) -> str:
    """Sentence that a calibration reduces the mean error; before, after: text with units."""
    if evaluation.kind == "predicted":
        return (
            f"After correction by {name} a mean position error of {after} is to be expected, "
            f"instead of {before} without."
        )
    if evaluation.kind == "compensated":
        return f"{name} brings the mean position error from {before} to {after} in simulation."
    expected = "" if evaluation.before == "measured" else "the expected "
    return (
        f"{name} brought the mean position error from {expected}{before} to {after}, measured on "
        "the arm."
    )
