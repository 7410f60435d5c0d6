"""Encodings, lines round the header, one point per line, dates: one table in many forms is one
table.
"""

import numpy as np
import pytest

from calibtool.errors import InputError
from calibtool.measurement.importing import Imported, JointFile, Stated, read_table
from calibtool.measurement.importing.dates import is_date, seconds
from calibtool.robot.catalogue import load_robot

ARM = load_robot("planar-3r")
RNG = np.random.default_rng(3)
Q = RNG.uniform(-90, 90, (6, 3)).round(3)
POINTS = RNG.uniform(-900, 900, (6, 2, 3)).round(3)
MM = Stated("mm", "deg")
HEADER = "Achse 1 [°];Achse 2 [°];Achse 3 [°];P1 X;P1 Y;P1 Z;P2 X;P2 Y;P2 Z"
ROWS = [";".join(f"{v:g}" for v in [*q, *p.ravel()]) for q, p in zip(Q, POINTS, strict=True)]
TEXT = "\n".join([HEADER, *ROWS]) + "\n"


def read(data: bytes | str, joints: JointFile | None = None, **options: object) -> Imported:
    return read_table(data, "t.csv", ARM, stated=MM, joints=joints, **options)


def check(found: Imported) -> None:
    assert np.allclose(np.rad2deg(found.measurements.q), Q, atol=1e-12)
    assert np.allclose(found.measurements.points * 1e3, POINTS, atol=1e-9)


@pytest.mark.parametrize(
    ("encoding", "mark", "note"),
    [
        ("utf-8", b"", None),
        ("utf-8", b"\xef\xbb\xbf", None),
        ("utf-16", b"", None),
        ("utf-16-le", b"", None),
        ("utf-16-be", b"", None),
        ("utf-32", b"", None),
        ("cp1252", b"", "cp1252"),
        ("cp850", b"", "cp850"),
        ("mac_roman", b"", "mac_roman"),
    ],
)
def test_encodings_are_found(encoding: str, mark: bytes, note: str | None) -> None:
    found = read(mark + TEXT.encode(encoding))
    check(found)
    told = [f"t.csv: not UTF-8, read as {note}; --encoding says otherwise"] if note else []
    assert found.understood.remarks == told
    check(read(TEXT.encode(encoding), encoding=encoding))


@pytest.mark.parametrize(
    "before",
    [
        ["Tracker;SN 0815", "Export;26.11.2026", "", ""],
        ["# made by hand", "# second line, with commas, and more"],
        ["Report", "Name;Value", "Temperature;21.4", "Humidity;40"],
        ["Instrument: AT960; Serial: 1234; Units: mm", "=========="],
    ],
)
def test_lines_before_the_header_are_not_used(before: list[str]) -> None:
    found = read("\n".join([*before, HEADER, *ROWS]))
    check(found)
    assert found.understood.remarks == [
        f"t.csv: the header is line {len(before) + 1}, the lines before it are not used"
    ]
    assert list(found.understood.lines) == list(range(len(before) + 2, len(before) + 8))


def test_a_bad_cell_below_a_preamble_is_named_by_its_line() -> None:
    bad = ROWS[2].replace(ROWS[2].split(";")[4], "n/a")
    with pytest.raises(InputError, match=r"^t\.csv:5: column 'P1 Y' holds 'n/a'"):
        read("\n".join(["Tracker;x", HEADER, *ROWS[:2], bad, *ROWS[3:]]))


def test_a_header_behind_a_comment_sign_and_units_below_the_names() -> None:
    check(read("\n".join([f"# {HEADER}", *ROWS])))
    names = "J1;J2;J3;X1;Y1;Z1;X2;Y2;Z2"
    units = "deg;deg;deg;mm;mm;mm;mm;mm;mm"
    for line in (units, ";".join(f"[{unit}]" for unit in units.split(";"))):
        found = read_table("\n".join(["Log 7", names, line, *ROWS]), "t.csv", ARM)
        check(found)


def long_form(name: str, separator: str = ";") -> str:
    """One point per line under a pattern of configuration and target numbers from 1."""
    header = separator.join(["Point", "X", "Y", "Z", "Remark"])
    lines = [
        separator.join([name.format(c=c + 1, t=t + 1, T="AB"[t]), *map(str, POINTS[c, t]), "ok"])
        for c in range(6)
        for t in range(2)
    ]
    return "\n".join([header, *lines])


def joint_table(name: str | None) -> str:
    rows = [";".join(map(str, q)) for q in Q]
    if name is None:
        return "\n".join(["j1;j2;j3", *rows])
    return "\n".join(
        ["Pose;j1;j2;j3", *(f"{name.format(c=k + 1)};{row}" for k, row in enumerate(rows))]
    )


@pytest.mark.parametrize(
    ("points", "pose"),
    [
        ("P{c:03}_T{t}", "P{c:03}"),
        ("P{c:03}_T{t}", "p{c}"),
        ("{c}-{t}", "{c}"),
        ("SMR{t}.pose {c:02}", "Pose {c:02}"),
        ("Pose{c}:{T}", "{c}"),
        ("conf_{c}_ball_{T}", "conf_{c}_ball"),
        ("{c:04}{T}", "{c}"),
    ],
)
def test_one_point_per_line_by_the_names(points: str, pose: str) -> None:
    found = read(long_form(points), JointFile(joint_table(pose), "j.csv", "name"))
    check(found)
    assert "6 configurations of 2 targets" in found.understood.remarks[0]


@pytest.mark.parametrize("points", ["P{c}_T{t}", "{c}.{T}"])
def test_one_point_per_line_with_joints_by_row_order(points: str) -> None:
    check(read(long_form(points), JointFile(joint_table(None), "j.csv")))


@pytest.mark.parametrize(
    ("separator", "decimal"), [(";", ","), (",", "."), ("\t", "."), (" ", ".")]
)
@pytest.mark.parametrize("header", ["Feature Name{0}X{0}Y{0}Z", "Element{0}x{0}y{0}z", ""])
def test_points_below_the_names_of_measuring_programs_or_none(
    header: str, separator: str, decimal: str
) -> None:
    """Without a header, a name and three numbers are `name x y z`."""
    lines = [
        separator.join([f"P{c + 1}_{t + 1}", *(f"{v:.3f}".replace(".", decimal) for v in point)])
        for c, points in enumerate(POINTS)
        for t, point in enumerate(points)
    ]
    if header and separator == " ":
        header = header.replace("Feature ", "")
    text = "\n".join([*([header.format(separator)] if header else []), *lines])
    check(read(text, JointFile(joint_table(None), "j.csv")))


def test_one_point_per_line_with_the_joints_in_every_line() -> None:
    lines = ["config;target;j1;j2;j3;X;Y;Z"]
    for c in range(6):
        for t in range(2):
            lines.append(";".join(map(str, [f"c{c}", f"t{t}", *Q[c], *POINTS[c, t]])))
    check(read("\n".join(lines)))
    del lines[4]  # a target that was not seen
    found = read("\n".join(lines)).measurements
    assert np.isnan(found.points[1, 1]).all()
    assert np.isfinite(found.points).sum() == POINTS.size - 3


def test_a_list_of_single_points_keeps_its_rows() -> None:
    lines = ["Point;j1;j2;j3;X;Y;Z"]
    lines += [";".join(map(str, [f"p_{k}", *Q[k], *POINTS[k, 0]])) for k in range(6)]
    found = read("\n".join(lines)).measurements
    assert found.points.shape == (6, 1, 3)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("26.11.2026 10:00:13", "2026-11-26T10:00:13"),
        ("6.1.2026 9:05:07", "2026-01-06T09:05:07"),
        ("26.11.2026, 10:00", "2026-11-26T10:00:00"),
        ("2026-11-26 10:00:13", "2026-11-26T10:00:13"),
        ("2026-11-26T10:00:13Z", "2026-11-26T10:00:13"),
        ("2026/11/26 10:00:13", "2026-11-26T10:00:13"),
        ("11/26/2026 10:00:13 PM", "2026-11-26T22:00:13"),
        ("11/26/2026 12:00:13 am", "2026-11-26T00:00:13"),
        ("26/11/2026 10:00:13", "2026-11-26T10:00:13"),
    ],
)
def test_dates_as_people_write_them(text: str, expected: str) -> None:
    assert is_date(text)
    found, bad = seconds([text, "", text])
    assert bad is None
    assert found[0] == found[2] == np.datetime64(expected, "s").astype(int)
    assert np.isnan(found[1])


def test_fractions_of_seconds_and_dates_that_may_be_two() -> None:
    for text in ("26.11.2026 10:00:13,25", "2026-11-26 10:00:13.250"):
        assert seconds([text])[0][0] % 60 == 13.25
    assert seconds(["05/06/2026 10:00:00"])[1] == 0  # May or June
    assert seconds(["05/06/2026 10:00:00", "05/13/2026 10:00:00"])[1] is None
    for bad in ("26.13.2026 10:00:00", "2026", "26.11.2026 25:00:00", "2026-11-26"):
        assert seconds([bad])[1] == 0


def test_two_clocks_with_dates() -> None:
    stamps = [f"26.11.2026 10:00:{k:02}" for k in (10, 12, 14, 16, 18, 20)]
    points = "\n".join(
        ["Datum/Uhrzeit;X;Y;Z"]
        + [f"{s};{';'.join(map(str, p[0]))}" for s, p in zip(stamps, POINTS, strict=True)]
    )
    log = "\n".join(
        ["timestamp;j1;j2;j3"]
        + [
            f"2026-11-26 10:00:{k:02}.500;{';'.join(map(str, Q[0] + 0.1 * k))}"
            for k in range(5, 30)
        ]
    )
    found = read(points, JointFile(log, "log.csv", "time", 1.0))
    expected = Q[0] + 0.1 * (np.array([10, 12, 14, 16, 18, 20]) - 0.5)[:, None]
    assert np.allclose(np.rad2deg(found.measurements.q), expected, atol=1e-6)
    assert found.warnings == []
    assert found.stream is not None
    moved = found.with_clock_offset(0.25)
    assert np.allclose(np.rad2deg(moved.measurements.q), expected + 0.025, atol=1e-6)


def test_rows_that_compensate_could_not_reach_were_not_driven() -> None:
    lines = ["j1_deg;j2_deg;j3_deg;status;left_mm;x_mm;y_mm;z_mm"]
    for k in range(6):
        joints = ";;" if k == 2 else ";".join(map(str, Q[k]))
        status = "unreachable" if k == 2 else "ok"
        lines.append(f"{joints};{status};0.1;{';'.join(map(str, POINTS[k, 0]))}")
    found = read("\n".join(lines))
    assert np.allclose(np.rad2deg(found.measurements.q), np.delete(Q, 2, axis=0))
    assert found.warnings == [
        "t.csv: 1 rows have the status unreachable and no joints; left out: line 4"
    ]
    assert found.understood.remarks == []  # the columns of compensate are known


def test_the_minus_of_spreadsheets_in_other_languages_is_one() -> None:
    assert TEXT.count("-") > 10
    check(read(TEXT.replace("-", "\u2212")))


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ('{"j1_deg": 1.0}\n', "a JSON file"),
        ('[{"j1_deg": 1.0}]', "a JSON file"),
        ('<?xml version="1.0"?><points/>', "an XML or HTML file"),
        ("<html></html>", "an XML or HTML file"),
    ],
)
def test_what_is_no_table_is_refused_with_what_it_is(text: str, kind: str) -> None:
    with pytest.raises(InputError, match=f"{kind}; expected a table"):
        read(text)
