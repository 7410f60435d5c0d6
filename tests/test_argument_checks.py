"""Arguments of scripts are checked where they are given: a wrong name or number is an error, and
never means something else.
"""

from collections.abc import Callable

import numpy as np
import pytest

from calibtool import (
    BaseOptions,
    CompleteOptions,
    ErrorScales,
    Simulation,
    TrainingOptions,
    UsageError,
    compensate_joints,
    evaluate,
    identify,
    load_robot,
    simulate,
)
from calibtool.errors import check_choice, check_number


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: BaseOptions("complet"), "complete"),
        (lambda: CompleteOptions(loss_function="hubber"), "did you mean huber"),
        (lambda: CompleteOptions(orders={"harmonics": -1}), "harmonics: -1"),
        (lambda: ErrorScales(kinds=("geometri",)), "geometric"),
        (lambda: ErrorScales(length=-1e-3), "length"),
        (lambda: ErrorScales(sizes={"gear": np.nan}), "gear"),
        (lambda: Simulation(configurations=0, workspace="full"), "configurations: 0"),
        (lambda: Simulation(noise=np.inf, workspace="full"), "noise"),
        (lambda: Simulation(seed=-1, workspace="full"), "seed"),
        (lambda: TrainingOptions(loss="tsk"), "did you mean task"),
        (lambda: TrainingOptions(optimiser="adam"), "known: lm, gd"),
        (lambda: TrainingOptions(regularisation="early"), "early-stopping"),
        (lambda: TrainingOptions(hidden=0), "hidden nodes: 0"),
        (lambda: TrainingOptions(validation=1.0), "less than 1"),
        (lambda: TrainingOptions(restarts=0), "restarts"),
        (lambda: TrainingOptions(folds=1), "folds"),
    ],
)
def test_options_are_checked_when_they_are_made(made: Callable[[], object], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        made()


def test_a_wrong_name_never_means_another_method() -> None:
    robot = load_robot("planar-3r")
    measurements = simulate(robot, Simulation(configurations=12, workspace="full"))
    calibration = identify(measurements)
    with pytest.raises(UsageError, match="did you mean complete"):
        identify(measurements, "complet")
    with pytest.raises(UsageError, match="did you mean exact"):
        compensate_joints(calibration, measurements.q, "exct")
    with pytest.raises(UsageError, match="did you mean one-step"):
        evaluate([("c", calibration)], measurements, method="onestep")
    with pytest.raises(UsageError, match="did you mean refuse"):
        evaluate([("c", calibration)], measurements, outside="refus")


@pytest.mark.parametrize(
    ("value", "fits"),
    [(-1, False), (0, True), (0.999, True), (1, False), (np.nan, False), (np.inf, False)],
)
def test_numbers_are_at_least_and_below(value: float, fits: bool) -> None:
    if fits:
        check_number(value, "part", 0, below=1)
    else:
        with pytest.raises(UsageError, match=r"^part: "):
            check_number(value, "part", 0, below=1)


def test_a_choice_is_one_of_those_allowed() -> None:
    check_choice("b", ("a", "b"), "letter")
    with pytest.raises(UsageError, match=r"^letter: unknown 'c'; known: a, b$"):
        check_choice("c", ("a", "b"), "letter")
