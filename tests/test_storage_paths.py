"""read and write: the command line's files by their paths, whole or not at all."""

import errno
from pathlib import Path

import pytest

import calibtool
from calibtool.errors import InputError, UsageError
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.storage import to_bytes

MEASUREMENTS = simulate(load_robot("planar-3r"), Simulation(configurations=3, workspace="full"))


def test_what_was_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "m.h5"
    calibtool.write(MEASUREMENTS, path)
    again = calibtool.read(str(path))
    assert again.q.tolist() == MEASUREMENTS.q.tolist()
    assert path.read_bytes() == to_bytes(MEASUREMENTS)
    assert [p.name for p in tmp_path.iterdir()] == ["m.h5"]


def test_an_existing_file_is_kept_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "m.h5"
    path.write_text("precious")
    with pytest.raises(UsageError, match=r"exists already.*force=True"):
        calibtool.write(MEASUREMENTS, path)
    assert path.read_text() == "precious"
    calibtool.write(MEASUREMENTS, path, force=True)
    assert calibtool.read(path).robot.name == "planar-3r"


def test_what_cannot_be_written_or_read_is_reported(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be written"):
        calibtool.write(MEASUREMENTS, tmp_path / "nowhere" / "m.h5")
    with pytest.raises(UsageError, match="no such file"):
        calibtool.read(tmp_path / "m.h5")
    (tmp_path / "t.csv").write_text("j1_deg\n1\n")
    with pytest.raises(InputError, match=r"t\.csv: not an HDF5 file"):
        calibtool.read(tmp_path / "t.csv")
    with pytest.raises(InputError, match="directory"):
        calibtool.read(tmp_path)


def test_a_failure_while_writing_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("calibtool.atomic_output.os.fsync", full)
    with pytest.raises(UsageError, match=r"m\.h5: cannot be written: No space left on device"):
        calibtool.write(MEASUREMENTS, tmp_path / "m.h5")
    assert list(tmp_path.iterdir()) == []
