"""The table of a study as CSV and HDF5, and its summary: numbers come back exactly, what is
missing stays missing.
"""

import io
import json

import h5py
import numpy as np
import pytest

from calibtool.errors import InputError
from calibtool.evaluation.plots.study_figures import study_figure
from calibtool.evaluation.study.statistics import study_contents, study_summary
from calibtool.evaluation.study.study_table import (
    COLUMNS,
    OK,
    Cell,
    StudyTable,
    failed,
    parse_csv,
    rounded,
)
from calibtool.storage import read_any, read_study
from calibtool.storage.studies import StudyFile, study_to_bytes


def head(run: int, method: str) -> tuple:
    return ("abc", "scara", "bench", "geometric+gear", 1.0, 0.05, 50, 100, run, 2**52 + run, method)


def table(runs: int = 21) -> StudyTable:
    """Largest errors of 0 … 20 mm for one method, a run without a result for the
    other, no orientation.
    """
    rows = []
    for run in range(runs):
        values = [rounded(value) for value in (run / 3, 0.1, 0.2, 0.3, float(run))]
        rows.append(
            (*head(run + 1, "nominal"), OK, 0, 0, *values, *[None] * 5, *[0.0] * 3, *[None] * 3)
        )
        rows.append(failed(head(run + 1, "complete"), 'not "observable", sorry'))
    return StudyTable("abc", tuple(rows))


def test_csv_comes_back_exactly() -> None:
    written = table()
    assert parse_csv(written.as_csv(), "t.csv") == written
    assert written.as_csv().splitlines()[0] == ",".join(COLUMNS)


def test_hdf5_comes_back_exactly_and_states_its_units() -> None:
    written = table()
    data = study_to_bytes(written, '{"runs": 2}')
    assert read_study(io.BytesIO(data), "t.h5") == StudyFile(written, {"runs": 2})
    assert data == study_to_bytes(written, '{"runs": 2}')
    with h5py.File(io.BytesIO(data)) as file:
        assert file["table/position_max_mm"].attrs["units"] == b"mm"
        assert np.isnan(file["table/orientation_max_mrad"][0])
        assert json.loads(file["definition"].asstr()[()]) == {"runs": 2}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n", "not a table of calibtool study"),
        ("", "not a table of calibtool study"),
        (table().as_csv()[:-40], "t.csv:43"),
        (table().as_csv().replace("abc", "xyz", 1), "2 studies"),
        (table().as_csv().replace(",0.05,", ",much,", 1), "t.csv:2"),
        (table().as_csv().replace(",0.05,", ",nan,", 1), "t.csv:2"),
    ],
)
def test_a_damaged_csv_is_bad_data(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        parse_csv(text, "t.csv")


@pytest.mark.parametrize("data", [b"", b"not HDF5", study_to_bytes(table(), "{}")[:3000]])
def test_a_damaged_hdf5_is_bad_data(data: bytes) -> None:
    with pytest.raises(InputError, match=r"t\.h5"):
        read_study(io.BytesIO(data), "t.h5")


def test_it_is_no_measurements_file() -> None:
    with pytest.raises(InputError, match=r"t\.h5: the table of a study"):
        read_any(io.BytesIO(study_to_bytes(table(), "{}")), "t.h5")


def test_columns_of_different_lengths_are_bad_data() -> None:
    buffer = io.BytesIO(study_to_bytes(table(), "{}").split(b"calibtool/sha256 ")[0])
    with h5py.File(buffer, "r+") as file:
        del file["table/position_max_mm"]
        file["table/position_max_mm"] = [1.0, 2.0]
    with pytest.raises(InputError, match="differ in length"):
        read_study(io.BytesIO(buffer.getvalue()), "t.h5")


def test_what_a_table_holds() -> None:
    contents = study_contents(table(), {"runs": 21})
    assert (contents["robots"], contents["methods"], contents["noise_mm"]) == (
        ["scara"],
        ["nominal", "complete"],
        [0.05],
    )
    assert (contents["runs"], contents["rows"], contents["finished"], contents["failed"]) == (
        21,
        42,
        21,
        21,
    )
    assert contents["reasons"] == {'not "observable", sorry': 21}
    nominal, complete = contents["medians"]
    assert (nominal["method"], nominal["position_max_mm"], nominal["orientation_max_mrad"]) == (
        "nominal",
        10.0,
        None,
    )
    assert complete["position_max_mm"] is None
    assert contents["definition"] == {"runs": 21}
    assert "definition" not in study_contents(table(), None)


def test_quantiles_over_the_runs() -> None:
    summary = study_summary(table())
    nominal, complete = summary["groups"]
    spread = nominal["position_mm"]["max"]
    assert spread == {"min": 0, "q05": 1, "q25": 5, "median": 10, "q75": 15, "q95": 19, "max": 20}
    assert nominal["orientation_mrad"]["max"] is None
    assert (nominal["runs"], nominal["failed"]) == (21, 0)
    assert (complete["runs"], complete["failed"], complete["position_mm"]["max"]) == (21, 21, None)
    assert (summary["rows"], summary["failed"]) == (42, 21)
    json.dumps(summary, allow_nan=False)


def test_boxes_are_named_after_what_tells_them_apart() -> None:
    """Ticks are the methods of one combination; of several, what differs between them, the
    methods being a legend.
    """

    def ticks(*changes: dict[str, Cell]) -> list[str]:
        rows = [
            dict(zip(COLUMNS, row, strict=True)) | change
            for change in changes
            for row in table(3).rows
        ]
        figure = study_figure(StudyTable("abc", tuple(tuple(row.values()) for row in rows)))
        assert bool(figure.legends) == (len(changes) > 1)
        return [tick.get_text() for tick in figure.axes[-1].get_xticklabels()]

    assert ticks({}) == ["nominal", "complete"]
    assert ticks({}, {"robot": "ur5"}) == ["scara", "ur5"]
    assert ticks({}, {"noise_mm": 0.1, "configurations": 20}) == [
        "noise 0.05 mm\n50 configurations",
        "noise 0.1 mm\n20 configurations",
    ]
    assert ticks({}, {"error_scale": 2.0}) == ["errors × 1", "errors × 2"]


def test_a_file_of_another_kind_or_a_newer_format_is_refused() -> None:
    for name, value, words in (
        ("schema", "other", "not one of calibtool"),
        ("schema_version", 99, "newer calibtool"),
    ):
        buffer = io.BytesIO(study_to_bytes(table(), "{}").split(b"calibtool/sha256 ")[0])
        with h5py.File(buffer, "r+") as file:
            file.attrs[name] = value
        with pytest.raises(InputError, match=words):
            read_study(io.BytesIO(buffer.getvalue()), "t.h5")
