"""A few hundred mutated inputs per reader: an answer with finite numbers, or one line that
says what is wrong.

The long version, with limits of time and memory: benchmarks/fuzz.py. Findings: docs/reliability.md.
"""

import pytest
from readers import READERS, case
from watched import watched

from calibtool.errors import CalibtoolError

SLOW = {
    "hdf5-measurements",
    "hdf5-calibration",
    "urdf",
    "robot-toml",
    "xlsx",
    "hdf5-study",
    "study-journal",
}


@pytest.mark.parametrize("name", READERS)
def test_mutated_files_are_read_or_refused(name: str) -> None:
    seeds = READERS[name].seeds()
    messages: list[str] = []
    done: list[str] = []
    for index in range(100 if name in SLOW else 300):
        data = case(name, seeds, 0, index)
        try:
            with watched() as done:
                READERS[name].read(data)
        except CalibtoolError as error:
            messages.append(str(error))
        except Exception as error:
            pytest.fail(
                f"benchmarks/fuzz.py --reader {name} --first {index} --inputs 1: "
                f"{type(error).__name__}: {error}"
            )
        if index >= len(seeds):  # the first ones fill the caches: the robot that a file is read for
            assert not done, f"benchmarks/fuzz.py --reader {name} --first {index} --inputs 1"
    assert all(message and message.isprintable() for message in messages)


@pytest.mark.parametrize("name", READERS)
def test_the_seeds_themselves_reach_the_readers(name: str) -> None:
    seeds = READERS[name].seeds()
    assert seeds
    read = 0
    for data in seeds:
        try:
            READERS[name].read(data)
            read += 1
        except CalibtoolError:
            pass
    assert read >= len(seeds) / 2
