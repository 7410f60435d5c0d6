"""SpatialAnalyzer's lists of points: every layout gives the same rows, and what is wrong is
named by its line.
"""

import numpy as np
import pytest

from calibtool.errors import InputError
from calibtool.measurement.importing.sources import read_source
from calibtool.measurement.importing.spatial_analyzer import looks_like_points, parse_points

CONFIGURATIONS, TARGETS = 5, 3
XYZ = np.random.default_rng(3).normal(0, 1e3, (CONFIGURATIONS, TARGETS, 3)).round(4)

NAMES = {  # Group Target of configuration k and target i, both from 1
    "names": lambda k, i: ("Main", f"p{k}_{i}"),
    "groups": lambda k, i: (f"p{k}", f"T{i}"),
    "order": lambda k, i: ("Main", f"T{i}"),
    "targets": lambda k, i: (f"T{i}", f"p{k}"),
}


def listed(layout: str, separator: str = ",", end: str = "") -> list[str]:
    """One line per target, configuration by configuration."""
    return [
        separator.join(["A", *NAMES[layout](k + 1, i + 1), *(f"{v:.4f}" for v in XYZ[k, i])]) + end
        for k in range(CONFIGURATIONS)
        for i in range(TARGETS)
    ]


@pytest.mark.parametrize("layout", ["names", "groups", "order", "targets"])
@pytest.mark.parametrize(
    ("separator", "end"), [(",", ""), (", ", ", 0.0, 19.05"), ("  ", "   0.0 19.05"), ("\t", "")]
)
def test_every_layout_and_separator_gives_a_row_per_configuration(
    layout: str, separator: str, end: str
) -> None:
    text = "\n".join(["// SpatialAnalyzer", "", *listed(layout, separator, end), "// end"])
    points = parse_points(text, "p.txt", layout if layout == "targets" else None)
    assert points.layout == layout
    values = points.table.numbers([column for triple in points.columns for column in triple])
    assert np.array_equal(values.reshape(XYZ.shape), XYZ)
    if layout != "order":
        assert points.table.texts("name") == [f"p{k + 1}" for k in range(CONFIGURATIONS)]


def test_one_target_needs_no_layout() -> None:
    text = "\n".join(f"A,Main,p{k},{k},{2 * k},{3 * k}" for k in range(1, 8))
    points = parse_points(text, "p.txt")
    assert (points.layout, points.targets) == ("single", ("t1",))
    assert np.array_equal(points.table.numbers(["t1 y"])[:, 0], np.arange(1, 8) * 2)


def test_targets_stand_in_the_order_of_their_numbers_wherever_their_lines_are() -> None:
    lines = listed("groups")
    mixed = [
        lines[3 * k + i] for k, order in enumerate([(2, 0, 1), (0, 1, 2), (1, 2, 0)]) for i in order
    ]
    points = parse_points("\n".join(mixed), "p.txt")
    assert points.targets == ("T1", "T2", "T3")
    values = points.table.numbers([column for triple in points.columns for column in triple])
    assert np.array_equal(values.reshape(3, 3, 3), XYZ[:3])


@pytest.mark.parametrize("layout", ["names", "groups", "order"])
def test_a_target_that_lacks_is_empty_in_its_row(layout: str) -> None:
    lines = listed(layout)
    del lines[4]  # the second target of the second configuration
    points = parse_points("\n".join(lines), "p.txt")
    seen = ~np.isnan(
        np.stack([points.table.optional_numbers(c)[:, 0] for c in points.columns], axis=1)
    )
    assert np.argwhere(~seen).tolist() == [[1, 1]]
    assert points.table.place(1) == "p.txt:4"


def test_a_repeated_target_is_named_with_both_lines() -> None:
    lines = listed("groups")
    lines.insert(7, lines[1])
    with pytest.raises(
        InputError, match=r"^p\.txt:8: target 'T2' of configuration 'p1' stands in line 2 already"
    ):
        parse_points("\n".join(lines), "p.txt")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("A,p1,T1,1,2", r"^p\.txt:2: 5 columns; expected Collection Group Target x y z"),
        ("A,p1,T9,1,2,z", r"^p\.txt:2: z holds 'z'; expected a number"),
        ("A,p1,T9,1,nan,3", r"^p\.txt:2: y holds 'nan'; expected a number"),
        ("A,p1,T9,,2,3", r"^p\.txt:2: x holds ''; expected a number"),
    ],
)
def test_a_bad_line_is_named(line: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_points("\n".join([listed("groups")[0], line]), "p.txt")


def test_names_that_do_not_fit_together_are_refused() -> None:
    lines = listed("names")
    lines[5] = lines[5].replace("p2_3", "check")
    with pytest.raises(
        InputError,
        match=r"^p\.txt:6: target 'check' does not end in a number as 'p1_1' does; .*--layout",
    ):
        parse_points("\n".join(lines), "p.txt")


def test_more_targets_than_configurations_are_a_misunderstanding() -> None:
    """p_1 … p_20 of one target, or one group per target, are not one configuration
    of twenty targets.
    """
    one = "\n".join(f"A,Main,p_{k},{k},0,0" for k in range(20))
    with pytest.raises(InputError, match=r"read as 1 configurations of 20 targets; .*--layout"):
        parse_points(one, "p.txt")
    assert len(parse_points(one, "p.txt", "single").table) == 20
    with pytest.raises(InputError, match=r"read as 3 configurations of 5 targets"):
        parse_points("\n".join(listed("targets")), "p.txt")


def test_groups_of_one_name_in_two_collections_are_two_configurations() -> None:
    points = parse_points("A,p1,T1,1,0,0\nB,p1,T1,2,0,0\n", "p.txt")
    assert points.table.texts("name") == ["A::p1", "B::p1"]


def test_a_list_of_points_is_distinguished_from_a_table() -> None:
    assert looks_like_points("// comment\nA p1 T1 1 2 3\n")
    assert looks_like_points("1,2,T1,1,2,3")
    assert not looks_like_points("j1_deg,j2_deg,j3_deg,x_mm,y_mm,z_mm\n1,2,3,4,5,6\n")
    assert not looks_like_points("1 2 3 4 5 6\n")
    assert not looks_like_points("")
    assert read_source(b"A,p1,T1,1,2,3\r\nA,p2,T1,1,2,3\r\n", "p.txt").format == "spatial-analyzer"


def test_semicolons_between_cells_leave_the_comma_to_decimals() -> None:
    text = "A;G;p1_1;1,5;-2,25;3\nA;G;p1_2;4,5;5;6\nA;G;p2_1;7;8;9,125\nA;G;p2_2;1;2;3\n"
    assert looks_like_points(text)
    table = parse_points(text, "p.txt").table
    assert [list(map(float, row[1:])) for row in table.rows] == [
        [1.5, -2.25, 3, 4.5, 5, 6],
        [7, 8, 9.125, 1, 2, 3],
    ]
