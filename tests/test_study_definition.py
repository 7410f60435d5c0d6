"""A study's definition and the runs that follow from it."""

import pytest

from calibtool.errormodel.families import ERROR_KINDS
from calibtool.errors import InputError, UsageError
from calibtool.evaluation.study import Definition, Study, parse_definition

PLAN = """
robots = ["planar-3r", "scara"]
runs = 3
configurations = [20, 40]
noise_mm = 0.1
errors = ["geometric", "gear,geometric"]
methods = ["complete", "nominal"]
"""


def study(**keys: object) -> Study:
    return Study.of(Definition().changed({"robots": "planar-3r", "runs": 3, **keys}))


def test_a_plan_is_the_product_of_its_lists() -> None:
    made = Study.of(parse_definition(PLAN, "plan.toml"))
    runs = [made.run(index) for index in range(made.count)]
    assert len(set(runs)) == len(runs) == 2 * 2 * 2 * 3
    assert {run.errors for run in runs} == {"geometric", "geometric,gear"}
    assert made.definition.methods == ["nominal", "complete"]
    assert [robot.workspace for robot in made.robots] == ["bench", "bench"]


def test_combinations_share_their_robots_and_numbers_do_not() -> None:
    made = study(configurations=[20, 40], error_scale=[1, 2])
    seeds = [
        {made.run(i).seed for i in range(made.count) if made.run(i).number == number}
        for number in (1, 2, 3)
    ]
    assert all(len(same) == 1 for same in seeds)
    assert len(set.union(*seeds)) == 3
    assert max(set.union(*seeds)) < 2**53


def test_more_runs_start_with_the_same_ones() -> None:
    few, many = study(runs=2), study(runs=50)
    assert [few.run(i) for i in range(2)] == [many.run(i) for i in range(2)]


@pytest.mark.parametrize(
    "change",
    [
        {"runs": 4},
        {"seed": 1},
        {"noise_mm": 0.1},
        {"robots": "scara"},
        {"methods": "complete"},
        {"fresh": 0},
    ],
)
def test_the_key_tells_studies_apart(change: dict[str, object]) -> None:
    assert study().key == study().key
    assert study(**change).key != study().key


def test_scales_multiply_every_size() -> None:
    once, twice = (Definition().scales("geometric,gear", factor) for factor in (1.0, 2.0))
    for name in ("length", "angle", "warmth"):
        assert getattr(twice, name) == 2 * getattr(once, name) > 0
    assert set(twice.sizes) == set(once.sizes)
    for kind, size in once.sizes.items():
        assert twice.sizes[kind] == 2 * size > 0
    assert once.length == pytest.approx(0.5e-3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("runs = 0", "runs"),
        ("run = 5", "unknown key 'run'; did you mean runs"),
        ('methods = ["complet"]', "did you mean complete"),
        ('errors = "geer"', "did you mean gear"),
        ("noise_mm = [-1]", "noise_mm"),
        ("noise_mm = [nan]", "noise_mm"),
        ("configurations = []", "configurations"),
        ("runs = ", "not valid TOML"),
    ],
)
def test_a_wrong_plan_is_bad_data_with_its_key(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        parse_definition(text, "plan.toml")
    assert str(caught.value).startswith("plan.toml: ")


def test_a_wrong_option_is_named() -> None:
    with pytest.raises(UsageError, match=r"^--noise-mm: .*"):
        Definition().changed({"noise_mm": ["much"]})
    with pytest.raises(UsageError, match="no robot"):
        Study.of(Definition())
    with pytest.raises(UsageError, match="did you mean planar-3r"):
        study(robots="planar-3")
    with pytest.raises(UsageError, match="no workspace"):
        study(workspace="moon")
    with pytest.raises(UsageError, match="at most"):
        study(runs=2_000_000)


def test_all_errors_are_every_kind_in_its_order() -> None:
    assert Definition(errors=["all"]).errors == [",".join(ERROR_KINDS)]
    assert Definition(errors=["gear,geometric", "geometric, gear", "all"]).errors == [
        "geometric,gear",
        ",".join(ERROR_KINDS),
    ]
