"""Laws of the files: what is written is read, to the last bit, whatever parts there are."""

import io
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace

import numpy as np
from cases import examples
from hypothesis import given
from hypothesis import strategies as st
from strategies import calibrated, configurations, robots, seeds, simulated

from calibtool.calibration import Calibration
from calibtool.calibration.calibration import CrossValidation
from calibtool.calibration.frame import ChosenFrame
from calibtool.compensation.decimals import DECIMALS, decimal_rows
from calibtool.equivalent.optimisers import History
from calibtool.equivalent.training import TrainingReport
from calibtool.evaluation.study.study_table import (
    COLUMNS,
    COUNTS,
    TEXTS,
    StudyTable,
    parse_csv,
    rounded,
)
from calibtool.identification.identification import Flagged, Posterior
from calibtool.identification.parameters import Parameters
from calibtool.joint_and_pose_columns import joints_from_header
from calibtool.measurement.measurements import Measurements
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import exp6, readonly
from calibtool.storage import read_any, read_study, to_bytes
from calibtool.storage.studies import study_to_bytes
from calibtool.tables import parse_table

texts = st.text(
    st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1, max_size=20
)
words = st.text(
    st.characters(categories=["L", "N", "P", "S"]) | st.just(" "), min_size=1, max_size=20
)
provenances = st.dictionaries(texts.filter(lambda t: "/" not in t), texts, max_size=3)


def assert_same(a: object, b: object, place: str) -> None:
    """Equal in every field and bit; robots by their texts."""
    assert type(a) is type(b), f"{place}: {type(a).__name__} became {type(b).__name__}"
    if isinstance(a, Robot) and isinstance(b, Robot):
        assert (a.source.toml_text, a.source.urdf_text) == (
            b.source.toml_text,
            b.source.urdf_text,
        ), place
        assert np.array_equal(a.chain.placements, b.chain.placements), place
        assert np.array_equal([a.lower, a.upper], [b.lower, b.upper]), place
    elif isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        assert a.shape == b.shape, place
        assert np.array_equal(a, b, equal_nan=True), place
    elif is_dataclass(a):
        for field in fields(a):
            assert_same(getattr(a, field.name), getattr(b, field.name), f"{place}.{field.name}")
    elif isinstance(a, tuple) and isinstance(b, tuple):
        assert len(a) == len(b), place
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            assert_same(x, y, f"{place}[{i}]")
    elif isinstance(a, Mapping) and isinstance(b, Mapping):
        assert set(a) == set(b), place
        for key, value in a.items():
            assert_same(value, b[key], f"{place}[{key}]")
    else:
        assert a == b, place


def read_back(contents: Measurements | Calibration) -> Measurements | Calibration:
    return read_any(io.BytesIO(to_bytes(contents)), "drawn.h5")


@examples(15)
@given(robots(), seeds, *[st.booleans()] * 6, provenances)
def test_measurements_are_read_as_they_were_written(
    robot: Robot,
    seed: int,
    pose: bool,
    truth: bool,
    unseen: bool,
    frame: bool,
    targets: bool,
    apart: bool,
    provenance: dict,
) -> None:
    rng = np.random.default_rng(seed)
    data = simulated(robot, rng, int(rng.integers(1, 9)), pose=pose, frame=np.eye(4))
    points = data.points.copy()
    if unseen and not pose:
        points[rng.random(points.shape[:2]) < 0.4] = np.nan
        points[:, 0] = data.points[:, 0]
    setup = replace(data.setup, frame_known=frame, targets_known=targets)
    data = replace(data, points=readonly(points), setup=setup, provenance=provenance)
    data = data if truth else replace(data, truth=None)
    if apart:
        data = replace(data, commanded=readonly(robot.mechanism.forward(data.q + 1e-3)))
    assert_same(read_back(data), data, "measurements")


@examples(15)
@given(robots(), seeds, *[st.booleans()] * 5, st.integers(0, 3), provenances)
def test_calibrations_are_read_as_they_were_written(
    robot: Robot,
    seed: int,
    posterior: bool,
    flagged: bool,
    training: bool,
    validation: bool,
    known: bool,
    members: int,
    provenance: dict,
) -> None:
    rng = np.random.default_rng(seed)
    made = calibrated(robot, rng)
    base = replace(
        made.base, setup=replace(made.base.setup, frame_known=known, targets_known=known)
    )
    if posterior:
        parameters = Parameters.of(
            robot, base.setup, twists=int(known), harmonics=members, gravity=int(not known)
        )
        p = parameters.count
        root = rng.normal(size=(p, p))
        base = replace(
            base,
            errors=base.errors.having(harmonics=rng.normal(size=(robot.n, 2 * members))),
            posterior=Posterior(
                parameters, rng.random(p), root @ root.T, 1.1, 3.3, -1e3, rng.random(p)
            ),
            unobservable=tuple(parameters.names[:members]),
        )
    if flagged:
        rows = np.arange(members)
        cluster = "joint 1" if known else None
        base = replace(
            base,
            flagged=Flagged(
                rows, rng.random(members), rng.random(members), cluster, dropped=training
            ),
        )
    made = replace(made, base=base, networks=made.networks * members, provenance=provenance)
    if training:
        history = History(rng.random(5), np.full(5, np.nan), 4, "settled")
        report = TrainingReport(
            history,
            np.arange(7),
            np.arange(members),
            rng.random(2),
            1.5,
            3.0,
            "tanh",
            "task",
            "lm",
            "bayes",
            4,
        )
        made = replace(made, training=report)
    if validation:
        made = replace(made, validation=CrossValidation(5, -3.2, 0.1))
    if members % 2 and not known:
        poses = (readonly(exp6(1e-2 * rng.normal(size=6))) for _ in "AB")
        made = replace(made, frame=ChosenFrame("taught" if training else "fitted", *poses))
    after = read_back(made)
    assert_same(after, made, "calibration")
    q = configurations(robot, 3, rng)
    assert np.array_equal(after.forward(q), made.forward(q))


def cells(column: str) -> st.SearchStrategy:
    """What may stand in a column of a study: a name or message, a count, a number of nine
    digits, nothing.
    """
    if column in TEXTS:
        return words.filter(lambda text: text.strip()[:1] not in "=@+-")  # see test_tables
    filled = (
        st.integers(0, 2**63 - 1) if column in COUNTS else st.floats(-1e300, 1e300).map(rounded)
    )
    return filled if COLUMNS.index(column) <= COLUMNS.index("status") else st.none() | filled


@examples(40)
@given(words, st.lists(st.tuples(*map(cells, COLUMNS[1:])), min_size=1, max_size=4))
def test_studies_are_read_as_they_were_written(key: str, rows: list[tuple]) -> None:
    table = StudyTable(key, tuple((key, *row) for row in rows))
    assert_same(parse_csv(table.as_csv(), "drawn.csv"), table, "CSV")
    assert_same(
        read_study(io.BytesIO(study_to_bytes(table, "{}")), "drawn.h5").table, table, "HDF5"
    )


@examples(40)
@given(robots(), seeds, st.booleans())
def test_joint_positions_are_read_as_they_were_written(robot: Robot, seed: int, si: bool) -> None:
    """In every unit that a table may have, to half of the last decimal, or to 14 digits where
    numbers are large.
    """
    units = [
        ("m" if si else "mm") if prismatic else ("rad" if si else "deg")
        for prismatic in robot.prismatic
    ]
    factors = np.array(
        [{"m": 1.0, "mm": 1e-3, "rad": 1.0, "deg": np.pi / 180}[unit] for unit in units]
    )
    q = configurations(robot, 5, np.random.default_rng(seed))
    decimals = [DECIMALS[unit] for unit in units]
    assert len(set(decimals)) == 1
    lines = [
        ",".join(f"j{j}_{unit}" for j, unit in enumerate(units, 1)),
        *decimal_rows(q / factors, decimals[0]),
    ]
    found = joints_from_header(parse_table("\n".join(lines), "drawn.csv"), robot, "serial")
    assert found is not None
    large = np.abs(q / factors).max(axis=1, keepdims=True) > (9.9 if si else 999.0)
    digits = np.where(large, 5e-14, 4e-16)  # of double precision otherwise
    assert (np.abs(found[0] - q) <= 0.5 * 10.0 ** -decimals[0] * factors + digits * np.abs(q)).all()
