"""The journal: finished runs survive, and nothing of another study or program is touched."""

import errno
import os
from pathlib import Path

import pytest

from calibtool.errors import UsageError
from calibtool.evaluation.study import Definition, Study
from calibtool.evaluation.study.journal import Journal
from calibtool.evaluation.study.study_table import COLUMNS, COUNTS, TEXTS

STUDY = Study.of(Definition(robots=["planar-3r"], runs=5))
OTHER = Study.of(Definition(robots=["planar-3r"], runs=6))
ROWS = [
    tuple(text if column in TEXTS else count if column in COUNTS else value for column in COLUMNS)
    for text, count, value in (("a", 3, 0.1), ("b", 2**52, 1e-300))
]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "s.csv.journal"


def keep(path: Path, *indices: int) -> None:
    with Journal(path, STUDY) as journal:
        for index in indices:
            journal.add(index, ROWS)


def test_finished_runs_come_back_in_order(path: Path) -> None:
    keep(path, 3)
    keep(path, 1)
    with Journal(path, STUDY) as journal:
        assert set(journal.finished) == {1, 3}
        assert journal.rows() == (*ROWS, *ROWS)


def test_a_line_that_was_cut_off_is_dropped(path: Path) -> None:
    keep(path, 0, 1)
    whole = path.read_bytes()
    for cut in range(0, len(whole), 7):
        path.write_bytes(whole[:cut])
        with Journal(path, STUDY) as journal:
            assert len(journal.finished) == max(whole[:cut].count(b"\n") - 1, 0)
            journal.add(4, ROWS)
        with Journal(path, STUDY) as journal:
            assert journal.finished[4] == ROWS


def test_a_file_system_that_cannot_truncate_resumes_whole_lines(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As FUSE's FAT: only a line that was cut off would have to go."""
    keep(path, 0, 1)

    def fail(*_: object) -> None:
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(os, "ftruncate", fail)
    keep(path, 2)
    with Journal(path, STUDY) as journal:
        assert set(journal.finished) == {0, 1, 2}
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(UsageError, match="cannot be written"):
        Journal(path, STUDY)


def test_another_study_is_refused_and_kept(path: Path) -> None:
    keep(path, 0)
    before = path.read_bytes()
    with pytest.raises(UsageError, match="another study"):
        Journal(path, OTHER)
    assert path.read_bytes() == before
    with Journal(path, OTHER, discard=True) as journal:
        assert not journal.finished


@pytest.mark.parametrize(
    "data", [b"my notes", b"my\nnotes\n", b"\xff\xfe\n", b'{"schema": "calibtool/study-journal"}\n']
)
def test_what_is_no_journal_is_refused_and_kept(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    with pytest.raises(UsageError, match=str(path)):
        Journal(path, STUDY)
    assert path.read_bytes() == data


def test_a_damaged_line_is_named(path: Path) -> None:
    keep(path, 0, 1)
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines[:2], b"?" + lines[2][1:]]))
    with pytest.raises(UsageError, match=f"{path}:3: damaged"):
        Journal(path, STUDY)


def test_two_commands_cannot_share_one(path: Path) -> None:
    with Journal(path, STUDY), pytest.raises(UsageError, match="another calibtool"):
        Journal(path, STUDY)


def test_without_a_run_nothing_is_left_behind(path: Path) -> None:
    with Journal(path, STUDY):
        assert path.exists()
    assert not path.exists()


def test_a_full_disk_is_an_error_and_keeps_what_is_finished(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(path, 0)
    with Journal(path, STUDY) as journal:
        write = os.write

        def full(file: int, data: memoryview) -> int:
            if len(data) > 10:
                return write(file, data[:10])
            raise OSError(errno.ENOSPC, "No space left on device")

        with monkeypatch.context() as patch:
            patch.setattr(
                os, "write", lambda f, d: full(f, d) if len(d) == len(d.obj) else full(f, d[:5])
            )
            with pytest.raises(UsageError, match="No space left"):
                journal.add(1, ROWS)
    with Journal(path, STUDY) as journal:
        assert set(journal.finished) == {0}


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be written"):
        Journal(tmp_path / "none" / "s.journal", STUDY)


def test_in_memory(tmp_path: Path) -> None:
    with Journal(None, STUDY) as journal:
        journal.add(0, ROWS)
        assert journal.rows() == tuple(ROWS)
    assert not list(tmp_path.iterdir())
