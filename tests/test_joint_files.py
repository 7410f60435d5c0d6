"""Joint values from a second file: partners by order, name and time; every row
without one is named.
"""

import numpy as np
import pytest

from calibtool.errors import InputError
from calibtool.measurement.importing.column_map import JoinColumns, TimeColumn
from calibtool.measurement.importing.joint_files import join_rows, times
from calibtool.tables import Table, parse_table


def table(name: str, header: str, rows: list[str]) -> Table:
    return parse_table("\n".join([header, *rows]), name)


def pairs(measured: Table, joints: Table) -> list[tuple[str, str]]:
    return list(zip(measured.texts("id"), joints.texts("id"), strict=True))


def test_row_order_needs_as_many_rows() -> None:
    a, b = table("a.csv", "id", ["1", "2"]), table("b.csv", "id", ["x", "y"])
    assert pairs(*join_rows(a, b, "index")[:2]) == [("1", "x"), ("2", "y")]
    with pytest.raises(InputError, match=r"^b\.csv: 3 rows, but a\.csv has 2 configurations"):
        join_rows(a, table("b.csv", "id", ["x", "y", "z"]), "index")


def test_names_find_their_partners_in_any_order_and_the_others_are_named() -> None:
    a = table("a.csv", "name,id", ["p3,1", "p1,2", "p9,3", "p1,4"])
    b = table("b.csv", "id,name", ["x,p1", "y,p2", "z,p3", "w,p4"])
    measured, joints, warnings = join_rows(a, b, "name")
    assert pairs(measured, joints) == [("1", "z"), ("2", "x"), ("4", "x")]
    assert measured.lines == [2, 3, 5]
    assert warnings == [
        "a.csv: 1 of 4 rows have no partner of that name in b.csv and are left out: line 4",
        "b.csv: 2 of 4 rows have no partner of that name in a.csv and are left out: line 3, 5",
    ]


def test_a_name_that_stands_twice_in_the_joint_file_is_refused() -> None:
    a, b = table("a.csv", "name", ["p1"]), table("b.csv", "name", ["p1", "p2", "p1"])
    with pytest.raises(InputError, match=r"^b\.csv:4: 'p1' stands in line 2 already"):
        join_rows(a, b, "name")


def test_names_under_other_headers() -> None:
    a, b = table("a.csv", "point,id", ["7,1"]), table("b.csv", "pose,id", ["6,x", "7,y"])
    measured, joints, _ = join_rows(a, b, "name", JoinColumns(measured="point", joints="pose"))
    assert pairs(measured, joints) == [("1", "y")]
    assert pairs(*join_rows(a, b, "name")[:2]) == [("1", "y")]  # by the columns that agree
    with pytest.raises(InputError, match=r"^a\.csv: no column 'name' to join by"):
        join_rows(a, table("b.csv", "bolt,part", ["7,1"]), "name")


def test_nearest_stamps_within_the_tolerance() -> None:
    a = table("a.csv", "time_s,id", ["10.04,1", "12.3,2", "13.96,3", ",4", "0,5", "99,6"])
    b = table(
        "b.csv", "id,time_ms", [f"{k},{1000 * k}" for k in (14, 13, 12, 11, 10)]
    )  # a log may run backwards
    measured, joints, warnings = join_rows(a, b, "time", tolerance_s=0.1)
    assert pairs(measured, joints) == [("1", "10"), ("3", "14")]
    assert [w for w in warnings if "the clock runs backwards" in w] == warnings[:2]
    assert warnings[2].endswith("within 0.1 s in b.csv and are left out: line 3, 5-7")
    assert warnings[3].endswith("line 3-5")
    assert len(warnings) == 4
    assert len(join_rows(a, b, "time", tolerance_s=0.31)[0]) == 3


def test_nearest_of_two_neighbours_is_the_brute_force_answer() -> None:
    rng = np.random.default_rng(0)
    log, stamps = rng.uniform(0, 10, 40), rng.uniform(-1, 11, 60)
    a = table("a.csv", "time_s,id", [f"{t!r},{i}" for i, t in enumerate(stamps.tolist())])
    b = table("b.csv", "time_s,id", [f"{t!r},{i}" for i, t in enumerate(log.tolist())])
    found = pairs(*join_rows(a, b, "time", tolerance_s=0.2)[:2])
    gap = np.abs(stamps[:, None] - log)
    assert found == [(str(i), str(gap[i].argmin())) for i in range(60) if gap[i].min() <= 0.2]


def test_no_partner_at_all_and_no_stamps() -> None:
    a, b = table("a.csv", "time_s", ["1"]), table("b.csv", "time_s", ["5"])
    with pytest.raises(InputError, match=r"^a\.csv: no row has a partner within 0\.1 s in b\.csv"):
        join_rows(a, b, "time")
    with pytest.raises(InputError, match=r"^b\.csv: no time stamps time_s, time_ms or time_iso"):
        join_rows(a, table("b.csv", "t", ["5"]), "time")
    with pytest.raises(InputError, match=r"\[join\] needs unit"):
        join_rows(a, b, "time", JoinColumns(measured="time_s", joints="time_s"))


def test_iso_stamps_count_seconds() -> None:
    column = TimeColumn(column="time_iso", unit="iso")
    found = times(
        table(
            "a.csv",
            "time_iso;n",
            ["1970-01-02T00:00:01.25Z;1", "1970-01-02 00:00:02,5;2", ";3", "1970-01-02T00:01;4"],
        ),
        column,
    )
    assert np.array_equal(found, [86401.25, 86402.5, np.nan, 86460.0], equal_nan=True)
    for bad in ("yesterday", "2024-05-31T14:07:09+02:00", "NaT", "2024-13-01T00:00:00", "2024"):
        with pytest.raises(InputError, match=r"^a\.csv:2: column 'time_iso' holds .*ISO 8601"):
            times(table("a.csv", "time_iso", [bad]), column)


def test_rows_without_a_name_are_nobody_s_partner() -> None:
    a, b = table("a.csv", "name,id", ["p1,1"]), table("b.csv", "name,id", [",x", "p1,y", ",z"])
    measured, joints, _ = join_rows(a, b, "name")
    assert pairs(measured, joints) == [("1", "y")]


def test_a_log_without_a_single_stamp_and_one_with_a_single_one() -> None:
    a = table("a.csv", "time_s,id", ["1,1", "2,2"])
    with pytest.raises(InputError, match=r"^b\.csv: no row has a time stamp"):
        join_rows(a, table("b.csv", "time_s,id", [",x", ",y"]), "time")
    measured, joints, _ = join_rows(a, table("b.csv", "time_s,id", ["2.05,x"]), "time")
    assert pairs(measured, joints) == [("2", "x")]
