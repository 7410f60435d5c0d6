"""calibtool identify: a base model, and what these measurements could tell."""

import hashlib
from pathlib import Path

import h5py
import numpy as np
import pytest
from commandline import Files, answer, contents, refused, run, write_table

LOCAL = ["--model", "local-poe"]


def test_report_goes_to_stderr_and_the_file_where_it_is_asked(files: Files) -> None:
    result = run("identify", files.measurements, *LOCAL, "-o", "c.h5")
    assert result.stdout_bytes == b""
    assert result.stderr.startswith("local-poe model of planar-3r, 40 configurations")
    assert "rank 18 of 24" in result.stderr
    assert Path("c.h5").read_bytes() == Path(files.local_poe).read_bytes()


def test_the_file_goes_to_stdout_by_default(files: Files) -> None:
    expected = Path(files.local_poe).read_bytes()
    assert run("identify", files.measurements, *LOCAL).stdout_bytes == expected
    assert run("identify", files.measurements, *LOCAL, "-o", "-").stdout_bytes == expected


def test_json_makes_no_file_unless_one_is_named(files: Files) -> None:
    value = answer("identify", files.measurements, *LOCAL)
    assert contents(Path.cwd()) == {}
    assert answer("identify", files.measurements, *LOCAL, "-o", "c.h5") == value
    assert Path("c.h5").read_bytes() == Path(files.local_poe).read_bytes()
    assert run("identify", files.measurements, *LOCAL, "--json").stderr == ""


def test_keys_of_the_json(files: Files) -> None:
    value = answer("identify", files.measurements, *LOCAL)
    assert value["schema"] == "calibtool/identification"
    assert value["schema_version"] == 1
    assert value["robot"] == "planar-3r"
    assert value["configurations"] == 40
    base = value["base"]
    assert base["model"] == "local-poe"
    assert len(base["singular_values"]) == base["parameters"]
    assert base["unobservable"] == []
    assert 0 < base["residual_rms_mm"] < 1


def test_json_and_the_file_cannot_share_stdout(files: Files) -> None:
    message = refused(2, "identify", files.measurements, "--json", "-o", "-")
    assert "--json" in message
    assert "-o" in message


@pytest.mark.parametrize(
    ("name", "revolute", "prismatic"), [("planar-3r", 3, 0), ("scara", 3, 1), ("ur10", 6, 0)]
)
def test_number_of_identifiable_parameters(name: str, revolute: int, prismatic: int) -> None:
    """A serial arm has 4 parameters per revolute joint, 2 per prismatic one and 6 of the tool,
    whatever its model.
    """
    run("simulate", name, "-n", 25, "-o", "m.h5")
    base = answer("identify", "m.h5", *LOCAL)["base"]
    assert base["rank"] == base["observable_rank"] == 4 * revolute + 2 * prismatic + 6
    assert base["parameters"] == 6 * (revolute + prismatic + 1)


def test_what_cannot_be_observed_is_reported() -> None:
    """Only joint 1 moves: joints 2 and 3 cannot be told apart."""
    write_table("at.csv", ["j1_deg", "j2_deg", "j3_deg"], [[5 * k, 60, 20] for k in range(20)])
    run("simulate", "planar-3r", "--at", "at.csv", "-o", "m.h5")
    base = answer("identify", "m.h5", *LOCAL)["base"]
    assert base["rank"] < base["observable_rank"] == 18
    assert len(base["unobservable"]) == base["observable_rank"] - base["rank"]
    result = run("identify", "m.h5", *LOCAL, "-o", "c.h5")
    missing = base["observable_rank"] - base["rank"]
    assert f"warning: {missing} combinations of parameters cannot be" in result.stderr


def test_too_few_configurations(files: Files) -> None:
    run("simulate", "fanuc-m1000ia", "-n", 3, "-o", "m.h5")
    message = refused(4, "identify", "m.h5", *LOCAL, "-o", "c.h5")
    assert "3 configurations" in message
    assert "at least 5" in message  # 30 parameters, and a rigid tool shows six things at a time
    assert refused(4, "identify", "m.h5", *LOCAL, "--json") == message
    assert files.folder.is_dir()


def test_as_many_as_it_asks_for_are_enough() -> None:
    run("simulate", "fanuc-m1000ia", "-n", 5, "-o", "m.h5")
    assert answer("identify", "m.h5", *LOCAL)["configurations"] == 5


def test_it_finds_errors_that_its_model_can_express() -> None:
    """Gear-free, noise-free, and only link placements wrong: nothing is left."""
    run("simulate", "fanuc-m1000ia", "-n", 30, "--noise-mm", 0, "--errors", "thermal", "-o", "m.h5")
    assert answer("identify", "m.h5", *LOCAL)["base"]["residual_rms_mm"] < 1e-6


def test_provenance(files: Files) -> None:
    run("identify", files.measurements, "-o", "c.h5")
    provenance = answer("info", "c.h5")["provenance"]
    assert (
        provenance["sha256_measurements"]
        == hashlib.sha256(Path(files.measurements).read_bytes()).hexdigest()
    )
    assert provenance["command"] == f"calibtool identify {files.measurements}"


def test_files_describe_themselves(files: Files) -> None:
    """Every number carries units, a name, its frame and dimension labels; every group of the
    format is there.
    """
    for path, kind in ((files.measurements, "measurements"), (files.network, "calibration")):
        missing = []
        with h5py.File(path, "r") as file:
            assert file.attrs["schema"] == f"calibtool/{kind}".encode()
            assert file.attrs["schema_version"] == 1
            assert file.attrs["creator"] == b"calibtool"

            def look(name: str, item: object, missing: list[str] = missing) -> None:
                if isinstance(item, h5py.Dataset) and np.issubdtype(item.dtype, np.number):
                    missing += [
                        f"{name}: {a}"
                        for a in ("units", "long_name", "frame")
                        if a not in item.attrs
                    ]
                    missing += [
                        f"{name}: dimension {k}" for k, d in enumerate(item.dims) if not d.label
                    ]

            file.visititems(look)
        assert missing == []


def test_refit_moves_a_calibration_and_states_whether_it_still_helps(files: Files) -> None:
    """The same arm measured again, and another one: the calibration of the first is right
    for itself alone.
    """
    run("identify", files.six_measurements, "-o", "old.h5")
    refit = ["--refit", "base,tool", "--from", "old.h5"]
    verdict = answer("identify", files.six_fresh, *refit, "-o", "new.h5")["transfer"]
    assert verdict["still_helps"]
    assert verdict["calibrated_rms_mm"] < 0.2 * verdict["nominal_rms_mm"]
    assert (
        answer("info", "new.h5")["provenance"]["sha256_from"]
        == hashlib.sha256(Path("old.h5").read_bytes()).hexdigest()
    )
    run("simulate", "fanuc-m1000ia", "-n", 12, "--seed", 77, "-o", "other.h5")
    assert "no longer helps" in run("identify", "other.h5", *refit, "-o", "not.h5").stderr
    assert "--from" in refused(2, "identify", files.six_fresh, "--refit", "base")


def test_tolerances_are_those_asked_for(files: Files) -> None:
    options = ["--tolerance-mm", 2, "--tolerance-mrad", 3, "--fixed-tolerances"]
    rows = answer("identify", files.six_measurements, *options)["base"]["parameter_table"]
    assert {
        row["tolerance"] for row in rows if row["name"].startswith("ζ") and row["unit"] == "mm"
    } == {2.0}
    assert {
        row["tolerance"] for row in rows if row["name"].startswith("ζ") and row["unit"] == "mrad"
    } == {3.0}


def test_a_noisy_target_is_named_with_a_table_of_all(files: Files) -> None:
    run("simulate", "ur5", "-n", "80", "--errors", "geometric", "-o", "m.h5")
    quiet = run("identify", "m.h5", "-o", "quiet.h5")
    assert "times as noisy" not in quiet.stderr
    groups = answer("identify", "m.h5")["noise_groups"]
    assert [(group["kind"], group["name"]) for group in groups][:3] == [
        ("target", name) for name in "123"
    ]
    rng = np.random.default_rng(2)
    with h5py.File("m.h5", "r+") as file:
        points = file["measurements/points"]
        noisy = points[()]
        noisy[:, 1] += rng.normal(size=(80, 3)) * 0.2e-3
        points[...] = noisy
    found = run("identify", "m.h5", "-o", "noisy.h5").stderr
    assert "warning: target 2 is " in found
    assert "Residuals by target and axis" in found
    report = run("report", "noisy.h5", "--on", "m.h5", "-o", "page.html")
    assert report.exit_code == 0
    assert "target 2 is " in Path("page.html").read_text(encoding="utf-8")
