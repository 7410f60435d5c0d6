"""calibtool evaluate: the JSON contract, methods side by side, limits, signed errors; stdout
carries data only.
"""

import re
from pathlib import Path
from shutil import copy

import numpy as np
import pytest
from commandline import (
    Files,
    answer,
    contents,
    measured_table,
    only_line,
    refused,
    rows_of,
    run,
    stored,
    write_table,
)

STATISTICS = {"mean", "std", "rms", "p95", "max"}
REDUCTIONS = {
    f"{quantity}_{s}" for quantity in ("position", "orientation") for s in ("mean", "max", "std")
}


@pytest.fixture
def real(files: Files) -> tuple[str, str]:
    """Measurements without a truth, and a calibration made from them."""
    measured_table(files.measurements, "t.csv")
    run("import", "t.csv", "--robot", "planar-3r", "-o", "real.h5")
    run("identify", "real.h5", "-o", "real-poe.h5")
    Path("t.csv").unlink()
    return "real.h5", "real-poe.h5"


# --- JSON -----------------------------------------------------------------------------------------


def test_keys_of_the_contract(files: Files) -> None:
    value = answer("evaluate", files.network, files.paper, "--on", files.fresh)
    assert set(value) == {
        "schema",
        "schema_version",
        "robot",
        "configurations",
        "kind",
        "methods",
        "uncorrectable",
    }
    assert (value["schema"], value["schema_version"]) == ("calibtool/evaluation", 1)
    assert (value["robot"], value["configurations"], value["kind"]) == (
        "planar-3r",
        30,
        "compensated",
    )
    assert set(value["uncorrectable"]) == {"configurations", "position_mm", "orientation_mrad"}
    assert value["uncorrectable"]["configurations"] == 30  # three joints take no pose exactly
    for method in value["methods"]:
        assert set(method) == {"name", "position_mm", "orientation_mrad", "reduction_percent"}
        assert set(method["position_mm"]) == set(method["orientation_mrad"]) == STATISTICS
        assert set(method["reduction_percent"]) == REDUCTIONS


def test_nominal_comes_first_and_reduces_nothing(files: Files) -> None:
    value = answer("evaluate", files.network, files.paper, files.local_poe, "--on", files.fresh)
    assert [method["name"] for method in value["methods"]] == [
        "nominal",
        "network",
        "paper",
        "local-poe",
    ]
    assert set(value["methods"][0]["reduction_percent"].values()) == {0.0}


def test_two_files_of_the_same_stem_both_appear(files: Files) -> None:
    for folder, path in (("a", files.paper), ("b", files.local_poe)):
        Path(folder).mkdir()
        copy(path, f"{folder}/c.h5")
    methods = answer("evaluate", "a/c.h5", "b/c.h5", "--on", files.fresh)["methods"]
    apart = answer("evaluate", files.paper, files.local_poe, "--on", files.fresh)["methods"]
    assert [method["name"] for method in methods] == ["nominal", "c", "c"]
    assert [m["position_mm"] for m in methods] == [m["position_mm"] for m in apart]


def test_a_calibration_from_stdin_is_called_stdin(files: Files) -> None:
    data = Path(files.paper).read_bytes()
    value = answer("evaluate", "-", files.local_poe, "--on", files.fresh, stdin=data)
    assert [method["name"] for method in value["methods"]] == ["nominal", "stdin", "local-poe"]


def test_measurements_from_stdin(files: Files) -> None:
    value = answer("evaluate", files.paper, "--on", "-", stdin=Path(files.fresh).read_bytes())
    assert value == answer("evaluate", files.paper, "--on", files.fresh)


@pytest.mark.parametrize("robot", ["planar-3r", "ur5"])
def test_statistics_are_consistent(files: Files, robot: str) -> None:
    given = [files.paper, files.network, "--on", files.fresh]
    if robot == "ur5":
        run("simulate", "ur5", "-n", 30, "-o", "six.h5")
        run("identify", "six.h5", "-o", "c.h5")
        given = ["c.h5", "--on", "six.h5"]
    value = answer("evaluate", *given)
    nominal = value["methods"][0]
    for method in value["methods"]:
        for quantity in ("position_mm", "orientation_mrad"):
            s = method[quantity]
            assert 0 < s["mean"] <= s["rms"] <= s["max"]
            assert s["p95"] <= s["max"]
            assert s["rms"] ** 2 == pytest.approx(s["mean"] ** 2 + s["std"] ** 2)
            for name in ("mean", "max", "std"):
                reduction = method["reduction_percent"][f"{quantity.split('_')[0]}_{name}"]
                whole = 100 * (1 - s[name] / nominal[quantity][name])
                if robot == "ur5":  # six joints: everything is correctable
                    assert reduction == pytest.approx(whole, abs=1e-9)
                elif method is not nominal and name == "mean":
                    assert reduction > whole


def test_a_robot_without_errors_has_none() -> None:
    exact = ["--length-error-mm", 0, "--angle-error-mrad", 0, "--noise-mm", 0]
    run("simulate", "planar-3r", "-n", 15, *exact, "-o", "m.h5")
    run("identify", "m.h5", "-o", "c.h5")
    for method in answer("evaluate", "c.h5", "--on", "m.h5")["methods"]:
        assert method["position_mm"]["max"] < 1e-6
        assert method["orientation_mrad"]["max"] < 1e-6


def test_nominal_errors_are_those_of_the_simulated_robot(files: Files) -> None:
    """The arm measured without noise where it was commanded: the mean of its targets is off
    as the table says.
    """
    q = stored(files.fresh, "measurements/joint_positions")
    Path("at.csv").write_text(
        "j1_rad,j2_rad,j3_rad\n" + "\n".join(",".join(map(repr, row)) for row in q.tolist())
    )
    exact = ["--length-error-mm", 0, "--angle-error-mrad", 0]
    run("simulate", "planar-3r", "--at", "at.csv", "--noise-mm", 0, *exact, "-o", "drawing.h5")
    run(
        "simulate",
        "planar-3r",
        "--at",
        "at.csv",
        "--noise-mm",
        0,
        "--same-robot",
        files.fresh,
        "-o",
        "actual.h5",
    )
    points = "measurements/points"
    # Displacement of the targets' centroid: that of the tool point, less the lever arm of 50 mm
    # times a few mrad.
    left = (stored("actual.h5", points) - stored("drawing.h5", points)).mean(axis=1) * 1e3
    table = rows_of(run("evaluate", files.paper, "--on", files.fresh, "-o", "-").stdout)
    rows = [row for row in table if row["method"] == "nominal"]
    stated = np.array([[float(row[f"d{axis}_mm"]) for axis in "xyz"] for row in rows])
    turn = np.array([[float(row[f"r{axis}_mrad"]) for axis in "xyz"] for row in rows]) * 1e-3
    heading = q.sum(axis=1)
    lever = 50 * np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=-1)
    np.testing.assert_allclose(stated + np.cross(turn, lever), left, atol=2e-3)


# --- for people -----------------------------------------------------------------------------------


def test_the_table_for_people_goes_to_stderr(files: Files) -> None:
    result = run("evaluate", files.network, files.paper, "--on", files.fresh)
    assert result.stdout_bytes == b""
    assert "planar-3r, 30 configurations" in result.stderr
    lines = result.stderr.splitlines()
    value = answer("evaluate", files.network, files.paper, "--on", files.fresh)
    for method in value["methods"]:
        row = next(line.split() for line in lines if line.split()[:1] == [method["name"]])
        turned = [line.split() for line in lines if line.split()[:1] == [method["name"]]][1]
        assert float(row[1]) == pytest.approx(method["position_mm"]["mean"], rel=5e-3)
        assert float(row[4]) == pytest.approx(method["position_mm"]["max"], rel=5e-3)
        assert float(turned[4]) == pytest.approx(method["orientation_mrad"]["max"], rel=5e-3)
        lowered = method["reduction_percent"]["position_max"]
        if method["name"] != "nominal":
            assert row[5] == f"{'−' if lowered > 0 else '+'}{abs(lowered):.1f}"


def test_what_no_joint_can_correct_is_reported(files: Files) -> None:
    stderr = run("evaluate", files.network, "--on", files.fresh).stderr
    beyond = answer("evaluate", files.network, "--on", files.fresh)["uncorrectable"]
    found = re.search(r"30 poses are out of the joints' reach: at best ([0-9.]+) mm", stderr)
    assert float(found[1]) == pytest.approx(beyond["position_mm"]["mean"], rel=5e-3)


def test_json_leaves_stderr_empty(files: Files) -> None:
    assert run("evaluate", files.network, "--on", files.fresh, "--json").stderr == ""


def test_no_escape_codes_where_there_is_no_terminal(files: Files) -> None:
    assert "\x1b" not in run("evaluate", files.network, "--on", files.fresh).stderr


# --- signed errors --------------------------------------------------------------------------------


def test_signed_errors_in_a_file(files: Files) -> None:
    result = run("evaluate", files.network, files.paper, "--on", files.fresh, "-o", "errors.csv")
    assert result.stdout_bytes == b""
    assert "planar-3r" in result.stderr
    rows = rows_of(Path("errors.csv").read_text())
    axes = ["dx_mm", "dy_mm", "dz_mm", "rx_mrad", "ry_mrad", "rz_mrad"]
    assert list(rows[0]) == ["method", "configuration", *axes]
    assert [row["method"] for row in rows] == ["nominal"] * 30 + ["network"] * 30 + ["paper"] * 30
    assert [int(row["configuration"]) for row in rows] == [*range(1, 31)] * 3
    values = np.array([[float(row[axis]) for axis in axes] for row in rows])
    assert (values.min(axis=0) < 0).all()
    methods = answer("evaluate", files.network, files.paper, "--on", files.fresh)["methods"]
    for k, method in enumerate(methods):
        size = np.linalg.norm(values[30 * k : 30 * k + 30].reshape(30, 2, 3), axis=-1)
        for column, quantity in enumerate(("position_mm", "orientation_mrad")):
            assert size[:, column].mean() == pytest.approx(method[quantity]["mean"], rel=1e-6)
            assert size[:, column].max() == pytest.approx(method[quantity]["max"], rel=1e-6)


def test_signed_errors_on_stdout_and_nothing_else(files: Files) -> None:
    run("evaluate", files.network, "--on", files.fresh, "-o", "errors.csv")
    result = run("evaluate", files.network, "--on", files.fresh, "-o", "-")
    assert result.stdout == Path("errors.csv").read_text()
    assert "planar-3r" in result.stderr


def test_json_and_a_table_in_a_file(files: Files) -> None:
    answer("evaluate", files.network, "--on", files.fresh, "-o", "errors.csv")
    assert len(rows_of(Path("errors.csv").read_text())) == 60


def test_json_and_the_table_cannot_share_stdout(files: Files) -> None:
    assert "--json" in refused(
        2, "evaluate", files.network, "--on", files.fresh, "--json", "-o", "-"
    )


# --- real measurements ----------------------------------------------------------------------------


def test_real_measurements_are_predicted(real: tuple[str, str]) -> None:
    measurements, calibration = real
    value = answer("evaluate", calibration, "--on", measurements)
    assert value["kind"] == "predicted"
    nominal, fitted = value["methods"]
    assert fitted["position_mm"]["rms"] < nominal["position_mm"]["rms"]
    assert set(fitted["reduction_percent"]) == REDUCTIONS


def test_signed_errors_of_every_target(real: tuple[str, str]) -> None:
    measurements, calibration = real
    rows = rows_of(run("evaluate", calibration, "--on", measurements, "-o", "-").stdout)
    expected = [f"t{i}_d{axis}_mm" for i in (1, 2, 3) for axis in "xyz"]
    assert list(rows[0]) == ["method", "configuration", *expected, "rx_mrad", "ry_mrad", "rz_mrad"]


def test_a_moved_instrument(real: tuple[str, str]) -> None:
    """The tracker stands 100 mm further: only --refit-setup makes the old calibration fit the
    new measurements.
    """
    measurements, calibration = real
    run("simulate", "planar-3r", "-n", 30, "-o", "again.h5")
    table = rows_of(Path(measured_table("again.h5", "moved.csv")).read_text())
    moved = [
        {k: str(float(v) + 100 * (k.endswith("x_mm"))) for k, v in row.items()} for row in table
    ]
    Path("moved.csv").write_text(
        "\n".join([",".join(moved[0]), *(",".join(row.values()) for row in moved)])
    )
    run("import", "moved.csv", "--robot", "planar-3r", "-o", "moved.h5")
    before = answer("evaluate", calibration, "--on", "moved.h5")["methods"][1]["position_mm"][
        "mean"
    ]
    after = answer("evaluate", calibration, "--on", "moved.h5", "--refit-setup")["methods"][1][
        "position_mm"
    ]["mean"]
    assert before == pytest.approx(100, abs=5)
    assert after < 1
    assert Path(measurements).exists()


# --- acceptance limits ----------------------------------------------------------------------------


def test_a_limit_that_is_met(files: Files) -> None:
    result = run(
        "evaluate", files.six_network, "--on", files.six_fresh, "--require", "position_max_mm=1000"
    )
    assert "above the limit" not in result.stderr


def test_a_limit_that_is_missed(files: Files) -> None:
    """Exit code 5 and one line; the report is there all the same, for people and as JSON."""
    start = ["evaluate", files.network, "--on", files.fresh, "--require", "position_max_mm=0.001"]
    lines = run(*start, code=5).stderr.splitlines()
    assert any(line.split()[:1] == ["nominal"] for line in lines)
    assert [line for line in lines if "above the limit" in line] == lines[-1:]
    assert lines[-1].startswith("network: position max ")
    assert "0.001 mm" in lines[-1]

    result = run(*start, "--json", "-o", "errors.csv", code=5)
    assert only_line(result.stderr) == lines[-1]
    assert result.stdout == run("evaluate", files.network, "--on", files.fresh, "--json").stdout
    assert len(rows_of(Path("errors.csv").read_text())) == 60


def test_nominal_need_not_meet_the_limit(files: Files) -> None:
    methods = answer("evaluate", files.six_network, "--on", files.six_fresh)["methods"]
    nominal, calibrated = (method["position_mm"]["max"] for method in methods)
    limit = f"position_max_mm={(nominal + calibrated) / 2}"
    assert calibrated < nominal
    run("evaluate", files.six_network, "--on", files.six_fresh, "--require", limit)


@pytest.mark.parametrize("statistic", sorted(STATISTICS))
@pytest.mark.parametrize(("quantity", "unit"), [("position", "mm"), ("orientation", "mrad")])
def test_limits_on_either_side_of_what_is_found(
    files: Files, quantity: str, unit: str, statistic: str
) -> None:
    found = answer("evaluate", files.paper, "--on", files.fresh)["methods"][1][
        f"{quantity}_{unit}"
    ][statistic]
    for factor, code in ((1.001, 0), (0.999, 5)):
        limit = f"{quantity}_{statistic}_{unit}={found * factor}"
        run("evaluate", files.paper, "--on", files.fresh, "--require", limit, code=code)


def test_of_several_limits_each_counts(files: Files) -> None:
    start = ["evaluate", files.paper, "--on", files.fresh, "--require", "position_max_mm=100"]
    run(*start, "--require", "orientation_max_mrad=100")
    run(*start, "--require", "orientation_max_mrad=0.001", code=5)


def test_a_limit_on_what_is_not_measured(files: Files) -> None:
    points = stored(files.measurements, "measurements/points")[:, 0]
    q = stored(files.measurements, "measurements/joint_positions")
    rows = [",".join(map(repr, row)) for row in np.hstack([q, points]).tolist()]
    Path("t.csv").write_text("\n".join(["j1_rad,j2_rad,j3_rad,x_m,y_m,z_m", *rows]))
    run("import", "t.csv", "--robot", "planar-3r", "-o", "m.h5")
    run("identify", "m.h5", "-o", "c.h5")
    value = answer("evaluate", "c.h5", "--on", "m.h5")
    assert [method["orientation_mrad"] for method in value["methods"]] == [None, None]
    result = run(
        "evaluate", "c.h5", "--on", "m.h5", "--json", "--require", "orientation_max_mrad=1", code=5
    )
    assert "orientation" in only_line(result.stderr)


WRONG_LIMITS = (
    "nonsense position_max_mm position_max_mm= position_max_mm=a position_max_mm=-1 "
    "position_max_mm=nan position_max=1 position_max_mrad=1 position_maximum_mm=1 "
    "orientation_max_mm=1 position_max_mm=1=2"
)


@pytest.mark.parametrize("limit", ["", *WRONG_LIMITS.split()])
def test_a_limit_that_cannot_be_read(files: Files, limit: str) -> None:
    message = refused(
        2, "evaluate", files.network, "--on", files.fresh, "--require", limit, "-o", "errors.csv"
    )
    assert message.startswith(f"--require {limit}: expected position_S_mm=VALUE")


# --- methods and files ----------------------------------------------------------------------------


def test_exact_and_one_step(files: Files) -> None:
    exact, one = (
        answer("evaluate", files.six_network, "--on", files.six_fresh, "--method", method)[
            "methods"
        ]
        for method in ("exact", "one-step")
    )
    assert exact[0] == one[0]
    assert exact[1] != one[1]
    assert one[1]["position_mm"]["mean"] == pytest.approx(exact[1]["position_mm"]["mean"], rel=0.2)
    assert answer("evaluate", files.six_network, "--on", files.six_fresh)["methods"] == exact


def test_rows_near_a_singularity_are_counted_in_a_warning(files: Files) -> None:
    """Joint 5 at zero lines joints 4 and 6 up."""
    header = "j1_deg,j2_deg,j3_serial_deg,j4_deg,j5_deg,j6_deg"
    Path("at.csv").write_text(f"{header}\n0,10,-10,0,0,0\n0,10,-10,0,-70,0\n")
    run(
        "simulate",
        "fanuc-m1000ia",
        "--at",
        "at.csv",
        "--same-robot",
        files.six_measurements,
        "-o",
        "m.h5",
    )
    result = run("evaluate", files.six_network, "--on", "m.h5", "--json")
    assert result.stderr.startswith("warning: six-network: 1 of 2 configurations")
    assert result.stderr.count("\n") == 1


def test_calibration_of_another_robot(files: Files) -> None:
    message = refused(3, "evaluate", files.local_poe, files.six_network, "--on", files.fresh)
    assert "'six-network'" in message
    assert "fanuc-m1000ia" in message
    assert "planar-3r" in message


def test_it_changes_no_input(files: Files) -> None:
    before = contents(files.folder)
    run("evaluate", files.network, files.paper, "--on", files.fresh)
    assert contents(files.folder) == before


# --- what is not like the training, or not measured -----------------------------------------------


def test_rows_unlike_the_training_are_counted(files: Files) -> None:
    run(
        "simulate",
        "planar-3r",
        "-n",
        40,
        "--workspace",
        "full",
        "--same-robot",
        files.measurements,
        "-o",
        "far.h5",
    )
    warning = "network: {} of 40 configurations {} unlike the training's"
    shown = run("evaluate", files.network, "--on", "far.h5").stderr
    assert any(
        warning.format(count, "is" if count == 1 else "are") in shown for count in range(1, 41)
    )
    message = refused(4, "evaluate", files.network, "--on", "far.h5", "--outside", "refuse")
    assert message.startswith("network: ")


def test_positions_alone_are_shown_without_orientation(files: Files) -> None:
    """One target three times at every configuration: no turn in the table, nor in the
    test after ISO 9283.
    """
    q, points = (
        stored(files.ten, "measurements/joint_positions"),
        stored(files.ten, "measurements/points"),
    )
    header = [*(f"j{k}_rad" for k in range(1, 7)), "x_m", "y_m", "z_m"]
    write_table("t.csv", header, np.repeat(np.hstack([q, points[:, 0]]), 3, axis=0).tolist())
    run("import", "t.csv", "--robot", "ur10", "-o", "m.h5")
    run("identify", "m.h5", "--model", "local-poe", "-o", "c.h5")
    lines = [line.strip() for line in run("evaluate", "c.h5", "--on", "m.h5").stderr.splitlines()]
    assert len([line for line in lines if line.startswith("nominal")]) == 1
    assert not any("mrad" in line for line in lines)
    stacked = [line.split()[1:] for line in lines if line.startswith("RP")]
    assert [value for row in stacked for value in row] == ["0"] * 8


def test_rows_of_the_training_are_named(files: Files) -> None:
    """On them a fit looks better than it is."""
    seen = run("evaluate", files.network, "--on", files.measurements).stderr
    assert "warning: network: 40 of 40 configurations were used to make it" in seen.replace(
        "\n  ", " "
    )
    assert "were used to make it" not in run("evaluate", files.network, "--on", files.fresh).stderr
