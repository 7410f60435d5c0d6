"""DH tables as papers and programs write them: one arm under many headers, and what is refused."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calibtool.errors import InputError
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

# a mm, alpha deg, d mm, theta deg of three joints, of which the second has an offset
ROWS = [(40.0, -90.0, 345.0, 0.0), (445.0, 0.0, 0.0, -90.0), (40.0, 90.0, 20.0, 30.0)]
Q = np.random.default_rng(0).uniform(-1.5, 1.5, (10, 3))


def expected() -> Array:
    """Poses (N, 4, 4) of Q by the matrices of Denavit and Hartenberg themselves."""
    poses = np.tile(np.eye(4), (len(Q), 1, 1))
    for j, (a, alpha, d, theta) in enumerate(ROWS):
        for k, q in enumerate(Q[:, j]):
            t, al = np.deg2rad(theta) + q, np.deg2rad(alpha)
            c, s, ca, sa = np.cos(t), np.sin(t), np.cos(al), np.sin(al)
            poses[k] = poses[k] @ [
                [c, -s * ca, s * sa, a * c * 1e-3],
                [s, c * ca, -c * sa, a * s * 1e-3],
                [0, sa, ca, d * 1e-3],
                [0, 0, 0, 1],
            ]
    return poses


@pytest.fixture
def read(tmp_path: Path) -> Callable[[str], Robot]:
    def reading(text: str) -> Robot:
        (tmp_path / "arm.csv").write_text(text)
        return load_robot(str(tmp_path / "arm.csv"))

    return reading


def table(header: str, *rows: str) -> str:
    return "\n".join([header, *rows])


PLAIN = [f"{j},{a},{alpha},{d},{theta}" for j, (a, alpha, d, theta) in enumerate(ROWS, 1)]
SAID = [f"{row},standard" for row in PLAIN]


@pytest.mark.parametrize(
    "text",
    [
        table("joint,a_mm,alpha_deg,d_mm,theta_deg,convention", *SAID),
        table("Link,a [mm],alpha [deg],d [mm],theta [deg],Convention", *SAID),
        table("i,a (mm),α (°),d (mm),θ (°),convention", *(f"{row},DH" for row in PLAIN)),
        table(
            "i;a [mm];α [°];d [mm];θ [°];convention",
            *(row.replace(",", ";").replace(".", ",") for row in SAID),
        ),
        table(
            "joint,type,a_mm,alpha_rad,d_m,theta_rad,convention",
            "1,R,40,-pi/2,0.345,0,standard",
            "2,R,445,0,0,-0.5*pi,standard",
            "3,revolute,40,π/2,0.02,pi/6,standard",
        ),
        table(
            "joint,a_mm,alpha_deg,d_mm,theta_deg,offset_deg,name,convention",
            "1,40,-90,345,0,0,waist,standard",
            "2,445,0,0,0,-90,shoulder,standard",
            "3,40,90,20,10,20,elbow,standard",
        ),
        table(
            "joint,a_mm,alpha_deg,d_mm,theta_deg,theta_offset_rad,d_offset_m,beta_deg,convention",
            "1,40,-90,300,0,0,0.045,0,standard",
            "2,445,0,0,0,-pi/2,0,0,standard",
            "3,40,90,20,30,0,0,0,standard",
        ),
    ],
)
def test_one_arm_under_many_headers(text: str, read: Callable[[str], Robot]) -> None:
    np.testing.assert_allclose(read(text).mechanism.forward(Q), expected(), atol=1e-12)


@pytest.mark.parametrize(
    ("column", "cells", "why"),
    [
        ("beta_deg", ("0", "0.2", "0"), "the column 'beta_deg' is not known"),
        ("scale", ("pi", "0", "0"), "the column 'scale' is not known"),
        ("offset_deg", ("0", "q2", "0"), "column 'offset_deg' holds 'q2'"),
        ("type", ("R", "R", "S"), "type 's'; expected revolute or prismatic"),
    ],
)
def test_what_would_be_another_geometry_is_refused(
    column: str, cells: tuple[str, ...], why: str, read: Callable[[str], Robot]
) -> None:
    header = f"joint,a_mm,alpha_deg,d_mm,theta_deg,convention,{column}"
    with pytest.raises(InputError, match=why):
        read(table(header, *(f"{row},{cell}" for row, cell in zip(SAID, cells, strict=True))))


def test_numbers_without_units_and_pi_in_degrees_are_refused(read: Callable[[str], Robot]) -> None:
    with pytest.raises(InputError, match=r"no DH parameters; expected .* a_mm alpha_deg"):
        read(table("joint,a,alpha,d,theta,convention", *SAID))
    with pytest.raises(InputError, match="holds 'pi/2'; expected a number"):
        read(table("joint,a_mm,alpha_deg,d_mm,theta_deg,convention", "1,40,pi/2,345,0,standard"))
