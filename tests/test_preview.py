"""What `import --dry-run` shows: every part of a table that is used, in words."""

import numpy as np
from scipy.spatial.transform import Rotation
from test_importing import POSES, Q, csv, instrument, joint_cells, named, points_mm

from calibtool.measurement.importing import Imported, import_table, parse_column_map, read_table
from calibtool.measurement.importing.preview import preview
from calibtool.robot.catalogue import load_robot

UR5 = load_robot("ur5")


def lines(text: str, toml: str | None = None, **options: object) -> dict[str, list[str]]:
    """The preview by its keys."""
    column_map = None if toml is None else parse_column_map(toml, "map.toml")
    return keyed(import_table(text, "table.csv", UR5, column_map, **options))


def keyed(imported: Imported) -> dict[str, list[str]]:
    shown = preview(imported)
    found: dict[str, list[str]] = {}
    for line in shown.splitlines():
        found.setdefault(line[:15].strip(), []).append(line[16:])
    return found


def test_a_pose_and_everything_beside_it() -> None:
    angles = Rotation.from_matrix(POSES[:, :3, :3]).as_euler("xyz", degrees=True)
    cells = joint_cells() | named("", POSES[:, :3, 3] * 1e3)
    cells |= {f"{name}_deg": angles[:, k] for k, name in enumerate(("roll", "pitch", "yaw"))}
    cells |= {"time_s": np.arange(len(Q)), "temperature_c": np.full(len(Q), 20.0)} | named(
        "ref1_", np.ones((len(Q), 3))
    )
    shown = lines(csv(cells))
    assert shown["configurations"] == [f"{len(Q)}, 1 6-D pose each"]
    assert shown["position"] == ["x_mm, y_mm, z_mm [mm]"]
    assert shown["orientation"] == ["roll_deg, pitch_deg, yaw_deg [deg], extrinsic-xyz"]
    assert "mrad per coordinate (assumed" in shown["noise"][0]
    assert shown["beside"] == [
        "time stamps time_s [s]",
        "temperature temperature_c [C]",
        "1 reference points on the base",
    ]
    assert "not used" not in shown


def test_nominal_points_with_their_errors_and_a_known_place_on_the_tool() -> None:
    points = points_mm(np.array([[0.1, 0.0, 0.05]]))[:, 0]
    cells = joint_cells() | named("nominal_", points) | named("error_", np.zeros_like(points))
    toml = (
        '[[targets]]\nnominal = ["nominal_x_mm", "nominal_y_mm", "nominal_z_mm"]\n'
        'error = ["error_x_mm", "error_y_mm", "error_z_mm"]\nerror_is = "measured-minus-nominal"\n'
        'unit = "mm"\n'
        'on_tool_mm = [100.0, 0.0, 50.0]\n[instrument]\nframe = "base"\n[noise]\n'
        "position_mm = 0.02\n"
    )
    shown = lines(csv(cells, ";", ","), toml)
    assert shown["file"] == ["table.csv: table separated by semicolon, decimal comma"]
    assert shown["configurations"] == [f"{len(Q)}, 1 target each"]
    target = " ".join([*shown["target 1"], *shown[""]])  # it takes two lines
    assert target.startswith("nominal_x_mm + error_x_mm, ")
    assert "[mm], on the tool at 100 0 50 mm" in " ".join(target.split())
    assert shown["noise"] == ["0.02 mm per coordinate (stated)"]


def test_rows_too_few_to_place_the_instrument_are_reported() -> None:
    points = points_mm(np.array([[0.1, 0.0, 0.05]]), instrument())[:2, 0]
    text = csv({name: values[:2] for name, values in joint_cells().items()} | named("", points))
    shown = keyed(read_table(text, "table.csv", UR5))
    assert "2 configurations give 6 equations for 9 unknowns" in shown["nominal robot:"][0]
