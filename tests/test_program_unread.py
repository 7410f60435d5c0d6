"""Programs in languages that are not read are told from tables of rows."""

import gzip

import pytest

from calibtool.programs.unread import unread_program


@pytest.mark.parametrize(
    ("head", "what"),
    [
        (gzip.compress(b"<URProgram/>", mtime=0), "give the .script"),
        (b'<?xml version="1.0"?>\n<URProgram name="x"/>', "give the .script"),
        (b" Program\n   Robot Program\n     MoveJ\n", "give the .script"),
        (b"/JOB\r\n//NAME WELD\r\n//POS\r\n", "Yaskawa"),
        (b".PROGRAM weld()\n  JMOVE #p1\n.END\n", "Kawasaki"),
        (b"%\nO0001 (PART)\nN10 G54 G90\n", "G-code"),
        (b"G1 X10 Y20\n", "G-code"),
        (b"PROGRAM weld\nVAR\n  p : POSITION\nBEGIN\n", "KAREL"),
        (b"\x00\x01\x02\x03" * 8, "a binary file"),
    ],
)
def test_what_it_is_and_what_to_give(head: bytes, what: str) -> None:
    assert what in (unread_program(head) or "")


@pytest.mark.parametrize(
    "head",
    [
        b"j1_deg,j2_deg\n1,2\n",
        b"x_mm y_mm z_mm\n1 2 3\n",
        b"G1,x_mm,y_mm,z_mm\n1,2,3,4\n",
        b"program,x_mm\n",
        "j1_deg\n1\n".encode("utf-16"),
        b"",
    ],
)
def test_tables_are_none(head: bytes) -> None:
    assert unread_program(head) is None
