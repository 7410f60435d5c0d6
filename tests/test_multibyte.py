"""Texts by bytes: what looks like a bracket and is half of a character, in every encoding that
controllers use.
"""

import pytest

from calibtool.programs.multibyte import beyond_ascii_blanked


def blanked(text: str, encoding: str) -> str:
    return beyond_ascii_blanked(text.encode(encoding).decode("latin-1"))


@pytest.mark.parametrize(
    ("name", "encoding"),
    [
        ("ゾーン", "cp932"),  # 83 5D: ]
        ("能力表", "cp932"),  # 94 5C, 95 5C: \
        ("ー", "cp932"),  # 81 5B: [
        ("ﾎｰﾑ", "cp932"),  # bytes of one character each, the last before the bracket
        ("ソ{ボ}", "cp932"),
        ("俓", "gbk"),  # 82 5D
        ("癧癨", "gbk"),  # B0 5D: a half-width character and ] in Shift JIS
        ("原点", "gbk"),
        ("Türe é", "latin-1"),
        ("é", "latin-1"),
        ("ゾーン 原点 Türe", "utf-8"),
    ],
)
def test_brackets_stay_and_halves_of_characters_go(name: str, encoding: str) -> None:
    """What is ASCII in the text is ASCII in the bytes, and nothing else is."""
    line = f"L P[1:{name}] 100% PR[2:{name}]"
    expected = "".join(c if c.isascii() else "?" * len(c.encode(encoding)) for c in line)
    assert blanked(line, encoding) == expected


def test_a_character_that_was_cut_in_two() -> None:
    """Comments end after so many bytes, in the middle of a character too."""
    line = "L P[1:ゾー".encode("cp932")[:-1] + b"] FINE"
    assert beyond_ascii_blanked(line.decode("latin-1")).endswith("] FINE")


def test_ascii_and_line_ends_stay() -> None:
    text = "a[1]\r\nb\rc\n\xe9\r"
    assert beyond_ascii_blanked(text) == "a[1]\r\nb\rc\n?\r"


def test_a_long_line_takes_linear_time() -> None:
    """A quadratic reader would take hours."""
    text = "[x]" * 400_000 + "\xe9"
    assert beyond_ascii_blanked(text) == "[x]" * 400_000 + "?"
