"""The verdict: effect of every calibration, limits, and cautions."""

from dataclasses import dataclass
from typing import Any, cast

from calibtool.calibration.guard import also_in_training
from calibtool.evaluation.acceptance import broken_limits
from calibtool.evaluation.compare import judged_rows
from calibtool.evaluation.metrics import pose_statistics
from calibtool.evaluation.observed import noise_of_errors
from calibtool.evaluation.plots import Subject
from calibtool.evaluation.report.content import Change, Judgement, Verdict, number
from calibtool.evaluation.wording import outcome_sentence, words
from calibtool.identification.sufficiency import few_rows
from calibtool.measurement.checks import design_findings
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
    entries = cast("list[dict[str, Any]]", subject.evaluated.as_json()["methods"])
    nominal, *others = entries
    noise = _noise(subject)
    judged = None if subject.measurements is None else judged_rows(subject.measurements).q
    return [
        Verdict(
            entry["name"],
            _changes(nominal, entry, noise),
            _judgements(subject, k),
            judged is None or not also_in_training(subject.calibrations[k - 1][1], judged),
        )
        for k, entry in enumerate(others, 1)
    ]


def headline(subject: Subject, found: list[Verdict]) -> Headline:
    """The outcome in one sentence: the limits where there are any, otherwise the calibration with
    the least mean error. A single calibration without a title is called "the calibration".
    """
    best = min(found, key=lambda verdict: verdict.changes[0].after_value)
    change = best.changes[0]
    lowered = change.after_value < change.before_value
    alone = len(found) == 1
    called = "the calibration" if alone else best.name
    outcome = outcome_sentence(subject.evaluated, called, change.before, change.after)
    outcome = outcome[0].upper() + outcome[1:] if alone else outcome
    if not lowered:
        outcome = (
            f"No calibration lowers the mean position error: {change.before} without, "
            f"{change.after} with {called}."
        )
    if not subject.limits:
        return Headline(outcome, None if lowered else False)
    names = {verdict.name: called if alone else verdict.name for verdict in found}
    passed = [names[verdict.name] for verdict in found if verdict.met]
    failed = [names[verdict.name] for verdict in found if not verdict.met]
    count = len(subject.limits)
    limits = "the limit" if count == 1 else "both limits" if count == 2 else f"all {count} limits"
    if not passed:
        missed = "the limit" if count == 1 else "the limits"
        return Headline(
            f"Not met: {_listed(failed)} {_verb(failed, 'miss')} {missed}. {outcome}", False
        )
    if not any(verdict.met and verdict.proven for verdict in found):
        return Headline(
            f"Not proven: {_listed(passed)} {_verb(passed, 'keep')} {limits}, but on rows that "
            f"were used for the fit. Judge on others. {outcome}",
            None,
        )
    but = f"; {_listed(failed)} {_verb(failed, 'do')} not" if failed else ""
    return Headline(
        f"Met: {_listed(passed)} {_verb(passed, 'keep')} {limits}{but}. {outcome}", True
    )


def cautions(subject: Subject, judged: Array) -> list[str]:
    """Cautions that weaken the numbers; judged (N, n) joint positions."""
    evaluation = subject.evaluated
    result = []
    if subject.measurements is not None:
        result += [f"On import of the judged rows: {f}." for f in subject.measurements.findings]
    for k, (name, calibration) in enumerate(subject.calibrations, 1):
        few = few_rows(calibration.base, calibration.configurations)
        result += [] if few is None else [f"{name}: {few}."]
        result += [
            f"{name}, rows of the training: {finding.message}."
            for finding in design_findings(calibration.robot, calibration.q)
        ]
        seen = also_in_training(calibration, judged)
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
    """Sentences that explain the numbers."""
    evaluation = subject.evaluated
    result = [words(evaluation.kind, evaluation.before).remark]
    assumed = subject.calibrations[0][1].robot.source.description.assumed
    if assumed is not None:
        result.append(f"The robot is {assumed}.")
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


def _changes(
    nominal: dict[str, Any], entry: dict[str, Any], noise: dict[str, float | None]
) -> list[Change]:
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
                    noise="–" if (own := noise[quantity]) is None else number(own * 1e3, unit),
                )
            )
    return changes


def _noise(subject: Subject) -> dict[str, float | None]:
    """Errors that noise alone causes, m and rad; None where the errors contain no noise."""
    if subject.measurements is None or subject.evaluated.kind == "compensated":
        return {"position": None, "orientation": None}
    return noise_of_errors(subject.measurements)


def _judgements(subject: Subject, k: int) -> list[Judgement]:
    """Every limit against the k-th method, by the rule that sets the exit code of `evaluate`."""
    method, test = subject.evaluated.methods[k], subject.evaluated.pose_tests[k]
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


def _verb(names: list[str], plural: str) -> str:
    """The verb for one name or several."""
    if len(names) > 1:
        return plural
    return {"miss": "misses", "do": "does", "keep": "keeps"}[plural]


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
