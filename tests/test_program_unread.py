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
        (b"set_velj(30)\nmovej(posj(0,0,90,0,90,0))\n", "Doosan"),
        (b"from DRCF import *\nmovel([559,34,651,0,180,0], ref=DR_BASE)\n", "Doosan"),
        (b"movej([0, 0, 1, 0, 0, 0], vel=30, acc=30)\n", "Doosan"),
        (b"import urx\nrob = urx.Robot(ip)\nrob.movej([0,0,1,0,0,0], acc=1)\n", "Python"),
        (b"#!/usr/bin/env python\nfrom rtde import rtde\r\nmovej([0,0,1,0,0,0])\n", "Python"),
        (b"Function main\r\n  Go P1\r\nFend\r\n", "Epson"),
        (b"1 Mov P1\r\nP1=(+450.0,+0.0,+600.0,+180.0,+0.0,+180.0)(7,0)\r\n", "Mitsubishi"),
        (b"J1=(+0.00,+20.00,+90.00,+0.00,+70.00,+0.00)\n", "Mitsubishi"),
        (b"MOVEX A=1,AC=0,SM=0,M1J,P,(0, 90, 0, 0, 0, 0),S= 50\n", "Nachi"),
        (b'\'!TITLE "x"\nPROGRAM PRO1\n  TAKEARM\n', "Denso"),
        (b"Sub Main\n  TakeArm Keep = 0\n  Move P, P1\nEnd Sub\n", "Denso"),
        (b"Program File Format Version : 1.6  MechType: 364\n", "Hyundai"),
        (b"local p = {}\nMovJ(p)\n", "Dobot"),
        (b"movl([300,0,200,180,0,180], 0, 50)\n", "JAKA"),
        (b'PTP("JPP",{0,0,90,0,90,0},35,200,0,false)\n', "Techman"),
        (b'<?xml version="1.0"?>\n<Programs xmlns="x"><Program name="a">movej(p)', "Staubli"),
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
        b"def a():\n  posx = 1\n  movej([0,0,1,0,0,0], a=acc, v=vel)\nend\n",
        b"IMPORT E6POS XP1 IS /R1/b..XP1\nDEF a( )\nP1=(3+4)\nPTP XP1\nEND\n",
        b"MODULE a\n  P1:=(1);\n  MoveJ p1,v100,fine,tool0;\nENDMODULE\n",
        b"/PROG  A\n/MN\n   1:J P[1] 100% FINE ;\n/POS\n",
        b"joint_names: [a, b]\npoints:\n- positions: [1, 2]\n",
    ],
)
def test_tables_and_programs_that_are_read_are_none(head: bytes) -> None:
    assert unread_program(head) is None
