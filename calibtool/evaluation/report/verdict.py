"""The verdict: effect of every calibration, limits, and cautions."""

from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from calibtool.calibration import Calibration
from calibtool.evaluation.acceptance import broken_limits
from calibtool.evaluation.metrics import pose_statistics
from calibtool.evaluation.plots import Subject
from calibtool.evaluation.report.content import Change, Judgement, Verdict, number
from calibtool.evaluation.wording import brought, words
from calibtool.robot.se3 import Array

_WORDS = {
    "mean": "mean",
    "std": "standard deviation",
    "rms": "rms",
    "p95": "95th percentile",
    "max": "largest",
}


@dataclass(frozen=True)
class Headline:
    """One sentence, and whether it is good (True), bad (False) or neutral (None)."""

    text: str
    good: bool | None


def verdicts(subject: Subject) -> list[Verdict]:
    """One per calibration, from the numbers of `evaluate --json`."""
    assert subject.evaluation is not None
    entries = cast("list[dict[str, Any]]", subject.evaluation.as_json()["methods"])
    nominal, *others = entries
    return [
        Verdict(entry["name"], _changes(nominal, entry), _judgements(subject, k))
        for k, entry in enumerate(others, 1)
    ]


def headline(subject: Subject, found: list[Verdict]) -> Headline:
    """The outcome in one sentence: the limits where there are any, otherwise the calibration with
    the least mean error.
    """
    best = min(found, key=lambda verdict: verdict.changes[0].after_value)
    change = best.changes[0]
    lowered = change.after_value < change.before_value
    assert subject.evaluation is not None
    outcome = brought(subject.evaluation, best.name, change.before, change.after)
    if not lowered:
        outcome = (
            f"No calibration lowers the mean position error: {change.before} without, "
            f"{change.after} with {best.name}."
        )
    if not subject.limits:
        return Headline(outcome, None if lowered else False)
    passed = [verdict.name for verdict in found if verdict.met]
    failed = [verdict.name for verdict in found if not verdict.met]
    limits = "the limit" if len(subject.limits) == 1 else f"the {len(subject.limits)} limits"
    if not passed:
        return Headline(
            f"Not met: {_listed(failed)} {_verb(failed, 'miss')} {limits}. {outcome}", False
        )
    but = f"; {_listed(failed)} {_verb(failed, 'do')} not" if failed else ""
    return Headline(
        f"Met: {_listed(passed)} {_verb(passed, 'keep')} {limits}{but}. {outcome}", True
    )


def cautions(subject: Subject, judged: Array) -> list[str]:
    """Cautions that weaken the numbers; judged (N, n) joint positions."""
    evaluation = subject.evaluation
    assert evaluation is not None
    result = []
    for k, (name, calibration) in enumerate(subject.calibrations, 1):
        seen = _also_in_training(calibration, judged)
        if seen:
            result.append(
                f"{seen} of the {len(judged)} judged configurations were used to make {name}: a "
                "fit shows less error there than anywhere else."
            )
        found = evaluation.results[k]
        if found.marked:
            result.append(
                f"{found.marked} corrections by {name} leave a part of the error, or all of it."
            )
        if found.outside:
            result.append(
                f"{found.outside} judged configurations are unlike those of the training of {name}."
            )
    return result


def remarks(subject: Subject) -> list[str]:
    """What the numbers are."""
    evaluation = subject.evaluation
    assert evaluation is not None
    result = [words(evaluation.kind, evaluation.before).remark]
    if evaluation.proof is not None:
        expected = pose_statistics(evaluation.proof.expected)["position_mm"]
        assert expected is not None
        result.append(
            f"Expected after correction: {number(expected['mean'], 'mm')} on average, at most "
            f"{number(expected['max'], 'mm')}, without noise."
        )
    if evaluation.uncorrectable is not None:
        stays = pose_statistics(evaluation.uncorrectable)["position_mm"]
        assert stays is not None
        result.append(
            f"{len(evaluation.uncorrectable.position)} poses are out of the actual "
            f"robot's reach: there {number(stays['mean'])} mm on average stay whatever the method. "
            "The change in percent is of the part that the joints can correct."
        )
    return result


def _changes(nominal: dict[str, Any], entry: dict[str, Any]) -> list[Change]:
    changes = []
    for quantity, unit in (("position", "mm"), ("orientation", "mrad")):
        before, after = nominal[f"{quantity}_{unit}"], entry[f"{quantity}_{unit}"]
        if before is None or after is None:
            continue
        for statistic in ("mean", "max"):
            reduction = entry["reduction_percent"][f"{quantity}_{statistic}"]
            changes.append(
                Change(
                    what=f"{_WORDS[statistic]} {quantity} error",
                    before_value=before[statistic],
                    after_value=after[statistic],
                    unit=unit,
                    reduction="–"
                    if reduction is None
                    else f"{-reduction:+.1f} %".replace("-", "−"),
                )
            )
    return changes


def _judgements(subject: Subject, k: int) -> list[Judgement]:
    """Every limit against the k-th method, by the rule that sets the exit code of `evaluate`."""
    assert subject.evaluation is not None
    method, test = subject.evaluation.methods[k], subject.evaluation.pose_tests[k]
    result = []
    for limit in subject.limits:
        found = limit.found(method, test)
        what = (
            f"{limit.quantity} error"
            if limit.quantity in ("position", "orientation")
            else limit.quantity.upper()
        )
        asked = f"{_WORDS[limit.statistic]} {what} at most {limit.value:g} {limit.unit}"
        result.append(
            Judgement(
                asked,
                "not measured" if found is None else number(found, limit.unit),
                not broken_limits([method], [limit], [test]),
            )
        )
    return result


def _also_in_training(calibration: Calibration, q: Array) -> int:
    known = {row.tobytes() for row in np.round(calibration.q, 9) + 0.0}
    return sum(row.tobytes() in known for row in np.round(q, 9) + 0.0)


def _verb(names: list[str], plural: str) -> str:
    """The verb for one name or several."""
    if len(names) > 1:
        return plural
    return {"miss": "misses", "do": "does", "keep": "keeps"}[plural]


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
