"""Tables as cameras, ball-bars, probes and trackers write them: each is what it says it is."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibtool.errors import InputError
from calibtool.measurement.importing import Imported, Stated, read_table
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot

ARM = load_robot("ur5")
ROWS = 30
JOINTS = [f"j{i}_deg" for i in range(1, 7)]
STATED = Stated("mm", "deg")
_CACHE: dict[tuple[str, int], Measurements] = {}


def seen(instrument: str, places: int = 1) -> Measurements:
    key = instrument, places
    if key not in _CACHE:
        simulation = Simulation(3, ROWS, "full", instrument=instrument, places=places)
        _CACHE[key] = simulate(ARM, simulation)
    return _CACHE[key]


def read(
    header: list[str], rows: list[list[object]], stated: Stated = STATED, separator: str = ","
) -> Imported:
    cells = [[c if isinstance(c, str) else f"{c:.7f}" for c in row] for row in rows]
    text = "\n".join(separator.join(line) for line in [header, *cells])
    board = any("rvec" in name.lower() or "rodrigues" in name.lower() for name in header)
    return read_table(text, "t.csv", ARM, stated=stated, board=board)


def degrees(measured: Measurements) -> list[list[float]]:
    found: list[list[float]] = np.rad2deg(measured.q).tolist()
    return found


@pytest.mark.parametrize(
    "header",
    [
        ["tx", "ty", "tz", "rvec_x", "rvec_y", "rvec_z"],
        ["x", "y", "z", "Rodrigues X", "Rodrigues Y", "Rodrigues Z"],
        ["tvec_x", "tvec_y", "tvec_z", "rvecx", "rvecy", "rvecz"],
    ],
)
def test_a_rotation_vector_of_a_camera_needs_no_convention(header: list[str]) -> None:
    board = seen("board")
    assert board.rotations is not None
    turns = Rotation.from_matrix(board.rotations).as_rotvec()
    rows = [
        [*q, *(1e3 * p), *v]
        for q, p, v in zip(degrees(board), board.points[:, 0], turns, strict=True)
    ]
    found = read([*JOINTS, *header], rows, Stated("mm")).measurements
    assert found.kind == "board"
    assert np.allclose(found.points, board.points, atol=1e-9)
    assert found.rotations is not None
    assert np.allclose(found.rotations, board.rotations, atol=1e-6)


@pytest.mark.parametrize(
    "names",
    [
        ["Length (mm)"],
        ["Länge [mm]"],
        ["Abstand mm"],
        ["Ball bar"],
        ["L1_mm", "L2_mm", "L3_mm"],
        ["Encoder 1", "Encoder 2", "Encoder 3"],
        ["Seil 1 [mm]", "Seil 2 [mm]", "Seil 3 [mm]"],
        ["cable_1_mm", "cable_2_mm", "cable_3_mm"],
    ],
)
def test_wires_and_ball_bars_under_their_names(names: list[str]) -> None:
    wires = seen("distance", len(names))
    assert wires.values is not None
    rows = [[*q, *(1e3 * v)] for q, v in zip(degrees(wires), wires.values, strict=True)]
    found = read([*JOINTS, *names], rows).measurements
    assert found.kind == "distance"
    assert found.values is not None
    assert np.allclose(found.values, wires.values, atol=1e-9)


@pytest.mark.parametrize(
    ("label", "value"),
    [
        ("plane", "z_mm"),
        ("Ebene", "Messuhr [mm]"),
        ("Face", "Height (mm)"),
        ("Surface", "Dial gauge"),
        ("Fläche", "Höhe [mm]"),
        ("Plane ID", "Deviation (mm)"),
        ("Plane", None),
    ],
)
def test_probes_on_planes_with_and_without_a_gauge(label: str, value: str | None) -> None:
    planes = seen("plane", 3)
    assert planes.place is not None
    assert planes.values is not None
    beside = [[f"P{g}"] for g in planes.place]
    heights = planes.values if value else np.zeros_like(planes.values)
    if value:
        beside = [[*b, 1e3 * v[0]] for b, v in zip(beside, planes.values, strict=True)]
    rows = [[*q, *b] for q, b in zip(degrees(planes), beside, strict=True)]
    found = read([*JOINTS, label, *([value] if value else [])], rows).measurements
    assert found.kind == "plane"
    assert len(found.places) == 3
    assert found.values is not None
    assert np.allclose(found.values, heights, atol=1e-9)


@pytest.mark.parametrize(
    ("label", "value", "radius"),
    [
        ("Sphere ID", "Deviation (mm)", True),
        ("ball", "gap_mm", True),
        ("Kugel", "Abstand [mm]", False),
        ("sphere", "radius (mm)", False),
        ("Kugel", None, True),
    ],
)
def test_probes_on_spheres(label: str, value: str | None, radius: bool) -> None:
    spheres = seen("sphere", 2)
    assert spheres.values is not None
    assert spheres.place is not None
    rows: list[list[object]] = [
        [*q, f"S{g}"] for q, g in zip(degrees(spheres), spheres.place, strict=True)
    ]
    if value:
        rows = [
            [*row, 1e3 * v[0] + 80.0 * (not radius)]
            for row, v in zip(rows, spheres.values, strict=True)
        ]
    found = read([*JOINTS, label, *([value] if value else [])], rows).registered().measurements
    assert found.kind == "sphere"
    assert found.setup.spheres is not None
    if radius:
        assert np.abs(found.setup.spheres[:, 3] - 0.08).max() < 5e-3
    else:
        assert not found.setup.spheres[:, 3].any()


@pytest.mark.parametrize(
    "header",
    [
        ["Point ID", "X (mm)", "Y (mm)", "Z (mm)", "Date", "Time"],
        ["PtName", "XCoord", "YCoord", "ZCoord", "HzAngle", "VtAngle", "Distance"],
        [
            "Object Name",
            "Measured X",
            "Measured Y",
            "Measured Z",
            "Nominal X",
            "Nominal Y",
            "Nominal Z",
        ],
        ["Frame", "Sub Frame", "Tool:X", "Tool:Y", "Tool:Z"],
        ["Name", "X", "Y", "Z", "RMS"],
    ],
)
def test_points_of_trackers_and_motion_capture(header: list[str]) -> None:
    points = simulate(ARM, Simulation(3, ROWS, "full"))
    first = next(k for k, name in enumerate(header) if "X" in name)
    rows = []
    for k, (q, p) in enumerate(zip(degrees(points), points.points[:, 0], strict=True)):
        beside: list[object] = ["26.11.2026" if n == "Date" else f"10:00:{k:02d}" for n in header]
        beside[:first] = [f"P{k}"] * first
        beside[first : first + 3] = (1e3 * p).tolist()
        if "Time" not in header:
            beside[first + 3 :] = [12.5 + k] * (len(header) - first - 3)
        rows.append([*beside, *q])
    found = read([*header, *JOINTS], rows).measurements
    assert found.kind == "points"
    assert np.allclose(found.points[:, 0], points.points[:, 0], atol=1e-9)


def test_a_sphere_has_one_length_and_sockets_need_points() -> None:
    rows: list[list[object]] = [[*[0.0] * 6, "S1", 1.0, 2.0]] * 3
    with pytest.raises(InputError, match="on spheres one length is measured per row"):
        read([*JOINTS, "sphere", "L1_mm", "L2_mm"], rows)
    rows = [[*[0.0] * 6, "G1", "2"]] * 3
    with pytest.raises(InputError, match="no measured points"):
        read([*JOINTS, "placement", "socket"], rows)
