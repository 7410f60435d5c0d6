"""Every reader of files as a function of bytes, its seeds, and how they are mutated.

Answers have to be finite.
"""

import io
import json
import random
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import h5py
import numpy as np
from mutations import BINARY, TEXT, mutated, mutated_archive

from calibtool.calibration import Calibration, identify, train
from calibtool.compensation.stream import StreamOptions, StreamReport, compensate_stream
from calibtool.controller import read_controller_model
from calibtool.equivalent.training import TrainingOptions
from calibtool.errors import InputError
from calibtool.evaluation.study import Definition, Study, StudyTable, parse_definition
from calibtool.evaluation.study.journal import SCHEMA as JOURNAL
from calibtool.evaluation.study.journal import Journal
from calibtool.evaluation.study.study_table import COLUMNS, COUNTS, TEXTS, failed, parse_csv
from calibtool.joint_and_pose_columns import joints_from_header, poses_from_header
from calibtool.measurement.importing import (
    ColumnMap,
    JointFile,
    Stated,
    parse_column_map,
    read_table,
)
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.programs.formats import PROGRAM_FORMATS, detected, read_program
from calibtool.programs.frames import read_frames
from calibtool.programs.motions import ProgramText
from calibtool.programs.numbers import rewritten
from calibtool.robot.catalogue import load_robot
from calibtool.robot.denavit_hartenberg import DhConvention
from calibtool.robot.robot import Robot
from calibtool.robot.source import parse_source, source_from_urdf
from calibtool.storage import read_any, read_study, to_bytes
from calibtool.storage.file_checks import with_digest
from calibtool.storage.studies import study_to_bytes
from calibtool.tables import read_tables

HERE = Path(__file__).resolve().parent
CORPUS = HERE / "corpus"


@dataclass(frozen=True)
class Reader:
    """seeds: valid files; mutate: one input from a generator; read: the reader, which may raise
    CalibtoolError only.
    """

    seeds: Callable[[], Sequence[bytes]]
    mutate: Callable[[random.Random, Sequence[bytes]], bytes]
    read: Callable[[bytes], object]


def text_of(data: bytes) -> str:
    """As the command line does: what is not UTF-8 is bad data before any reader sees it."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        raise InputError("not a UTF-8 text file") from None


def corpus(folder: str) -> Sequence[bytes]:
    return [path.read_bytes() for path in sorted((CORPUS / folder).iterdir())]


def _text(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    return mutated(rng, seeds, TEXT)


@cache
def arm() -> Robot:
    return load_robot("planar-3r")


@cache
def six() -> Robot:
    return load_robot("ur5")


@cache
def measurements(robot: str = "planar-3r") -> Measurements:
    made = load_robot(robot)
    simulated = simulate(made, Simulation(seed=1, configurations=12))
    return replace(simulated, provenance={"command": "calibtool simulate", "note": "µm"})


@cache
def calibrations(robot: str = "planar-3r") -> tuple[Calibration, ...]:
    data = measurements(robot)
    return (
        identify(data, "nominal"),
        identify(data, "local-poe"),
        train(data, "nominal", TrainingOptions(restarts=1, hidden=2, validation=0.5)),
    )


# --- HDF5 -----------------------------------------------------------------------------------------


def _stored(contents: Sequence[Measurements | Calibration]) -> Sequence[bytes]:
    """Without the digest, which would refuse every change before the HDF5 library sees it."""
    return [without_digest(to_bytes(one)) for one in contents]


def without_digest(data: bytes) -> bytes:
    """The HDF5 file alone."""
    return data[:-82]


def edited(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """An HDF5 file whose contents are wrong: a dataset or an attribute of another type, shape or
    value, or missing.
    """
    buffer = io.BytesIO(rng.choice(seeds))
    with h5py.File(buffer, "r+") as file:
        paths: list[str] = []
        file.visit(paths.append)
        for _ in range(rng.choice((1, 1, 2))):
            path = rng.choice(paths)
            if path not in file:
                continue
            item = file[path]
            if item.attrs and rng.random() < 0.4:
                item.attrs[rng.choice(list(item.attrs))] = _strange(rng, None)
            elif rng.random() < 0.2:
                del file[path]
            elif isinstance(item, h5py.Dataset):
                values = _strange(rng, item[()])
                del file[path]
                file[path] = values
    return buffer.getvalue()


def _strange(rng: random.Random, values: object) -> object:
    choices: list[object] = [
        *(
            np.nan,
            np.inf,
            -1,
            0,
            2**62,
            1e300,
            "x",
            "",
            b"\xff\xfe",
            True,
            h5py.Empty("f8"),
            [],
            [1.0],
            np.zeros((0, 3)),
        ),
        *(
            np.zeros((2, 2, 2, 2)),
            np.array([1 + 2j]),
            np.array([(1, 2.0)], dtype="i4,f8"),
            ["a", "b"],
            "9" * 5000,
        ),
    ]
    if (
        isinstance(values, np.ndarray)
        and values.dtype.kind in "fiu"
        and values.size
        and rng.random() < 0.7
    ):
        changed = values.astype(float)
        big = changed * np.where(np.abs(changed) < 1e100, 1e200, 1.0)
        changed.flat[rng.randrange(values.size)] = rng.choice(
            (np.nan, np.inf, -1.0, 0.0, 1e300, -1e300, 1e-320, 7.5)
        )
        return rng.choice(
            (changed, big, changed[:-1], changed[..., None], changed.T, np.zeros_like(changed))
        )
    return rng.choice(choices)


def _hdf5(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    data = edited(rng, seeds) if rng.random() < 0.2 else mutated(rng, seeds, BINARY)
    return with_digest(data) if rng.random() < 0.3 else data  # anybody can seal a file


def _read_hdf5(data: bytes) -> None:
    found = read_any(io.BytesIO(data), "file.h5")
    q = measurements().q[:2]
    if isinstance(found, Measurements):
        assert np.isfinite(found.q).all()
        assert found.robot.n == found.q.shape[1]
    elif found.robot.n == q.shape[1]:
        with np.errstate(all="ignore"):
            found.forward(q)


# --- tables ---------------------------------------------------------------------------------------


def _rows(data: bytes) -> None:
    """What `compensate` reads, without its inverse kinematics."""
    for table in read_tables(io.StringIO(text_of(data), newline=None), "rows.csv"):
        for found in (joints_from_header(table, arm()), poses_from_header(table)):
            assert found is None or np.isfinite(found[0]).all()


def _objects(data: bytes) -> None:
    """Joints as objects, corrected and written."""
    lines = io.StringIO(text_of(data), newline=None)
    list(
        compensate_stream(
            calibrations()[1], lines, "rows", StreamOptions(), StreamReport(), "ndjson"
        )
    )


def _sound(found: Measurements) -> None:
    assert np.isfinite(found.q).all()
    assert not np.isinf(found.points).any()
    assert found.rotations is None or np.isfinite(found.rotations).all()


def _imported(data: bytes) -> None:
    _sound(read_table(data, "table", arm(), stated=Stated("mm", "deg", None)).measurements)


def _points(data: bytes) -> None:
    joints = JointFile(
        b"name,j1_deg,j2_deg,j3_deg\np1,1,2,3\np2,4,5,6\np3,7,8,9\n", "joints.csv", "name"
    )
    read = read_table(
        data,
        "points",
        arm(),
        format="spatial-analyzer",
        stated=Stated("mm", None, None),
        joints=joints,
    )
    _sound(read.measurements)


def _mapped(data: bytes) -> None:
    columns: ColumnMap = parse_column_map(text_of(data), "map.toml")
    header = "A;B;C;x;y;z;x2;y2;z2;T;clock\n"
    _sound(
        read_table(
            header + "1;2;3;4;5;6;7;8;9;20;1\n2;3;4;5;6;8;7;9;9;20;2\n", "t.csv", arm(), columns
        ).measurements
    )


def workbooks() -> Sequence[bytes]:
    """Workbooks of small tables, with numbers, shared texts, dates and empty cells."""
    import openpyxl

    found = []
    for path in sorted((CORPUS / "import").glob("*.csv")):
        book = openpyxl.Workbook()
        for line in path.read_text(encoding="utf-8").splitlines():
            cells = line.split(",")
            book.active.append(
                [float(c) if c.replace(".", "").lstrip("-").isdigit() else c or None for c in cells]
            )
        out = io.BytesIO()
        book.save(out)
        found.append(out.getvalue())
    return found


def _workbook(data: bytes) -> None:
    _sound(
        read_table(
            data, "w.xlsx", arm(), format="excel", stated=Stated("mm", "deg", None)
        ).measurements
    )


# --- robots ---------------------------------------------------------------------------------------


def _check_robot(robot: Robot) -> None:
    assert np.isfinite(robot.chain.placements).all()
    assert np.isfinite(robot.lower).all()
    assert np.isfinite(robot.upper).all()
    assert np.isfinite(robot.mechanism.forward(robot.workspace("full").home[None])).all()


def _description(data: bytes) -> None:
    _check_robot(
        Robot.from_source(parse_source(text_of(data), arm().source.urdf_text, "robot.toml"))
    )


def _urdf(data: bytes) -> None:
    _check_robot(Robot.from_source(source_from_urdf(text_of(data), "robot.urdf")))


def _controller(dh: DhConvention | None) -> Callable[[bytes], object]:
    """The model of a ur5's controller, from any file."""

    def read(data: bytes) -> None:
        model = read_controller_model(text_of(data), "model", six(), dh)
        assert np.isfinite([model.position, model.orientation]).all()
        assert np.isfinite(model.mechanism.forward(six().workspace("full").home[None])).all()

    return read


# --- studies --------------------------------------------------------------------------------------


@cache
def study() -> Study:
    return Study.of(Definition(robots=["planar-3r"], runs=3))


def studied() -> StudyTable:
    """Made-up results of three runs, one of them failed."""
    rows = [
        tuple(
            "planar-3r" if c in TEXTS else run + 1 if c in COUNTS else 0.125 * run for c in COLUMNS
        )
        for run in (1, 2)
    ]
    return StudyTable(
        "planar-3r", (*rows, failed(rows[0][: COLUMNS.index("status")], "no solution"))
    )


def _journal(data: bytes) -> None:
    """The journal of a study, as it is continued; what cannot be believed is refused, the
    rest makes a table.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "s.csv.journal"
        path.write_bytes(data)
        with Journal(path, study()) as journal:
            StudyTable(study().key, journal.rows()).as_csv()


def journals() -> Sequence[bytes]:
    start = json.dumps({"schema": JOURNAL, "study": study().key})
    rows = studied().rows
    return [
        "\n".join(
            [start, *(json.dumps({"run": k, "rows": [row]}) for k, row in enumerate(rows)), ""]
        ).encode()
    ]


# --- programs -------------------------------------------------------------------------------------


def _program(program_format: str) -> Callable[[bytes], object]:
    def read(data: bytes) -> None:
        text = data.decode("latin-1")
        detected(text, "program")
        for target in read_program(program_format, [ProgramText("program", text)], six()).literals:
            assert np.isfinite(target.values).all()
            rewritten(text, target.numbers, target.values)

    return read


READERS: dict[str, Reader] = {
    "hdf5-measurements": Reader(lambda: _stored([measurements()]), _hdf5, _read_hdf5),
    "hdf5-calibration": Reader(lambda: _stored(calibrations()), _hdf5, _read_hdf5),
    "csv": Reader(lambda: corpus("csv"), _text, _rows),
    "ndjson": Reader(lambda: corpus("ndjson"), _text, _objects),
    "import": Reader(lambda: corpus("import"), _text, _imported),
    "spatial-analyzer": Reader(lambda: corpus("spatial-analyzer"), _text, _points),
    "xlsx": Reader(workbooks, mutated_archive, _workbook),
    "column-map": Reader(lambda: corpus("column-map"), _text, _mapped),
    "study-definition": Reader(
        lambda: corpus("study-definition"),
        _text,
        lambda data: parse_definition(text_of(data), "study.toml"),
    ),
    "study-csv": Reader(
        lambda: [studied().as_csv().encode()],
        _text,
        lambda data: parse_csv(text_of(data), "s.csv").as_csv(),
    ),
    "study-journal": Reader(journals, _text, _journal),
    "hdf5-study": Reader(
        lambda: [without_digest(study_to_bytes(studied(), "{}"))],
        _hdf5,
        lambda data: read_study(io.BytesIO(data), "s.h5").table.as_csv(),
    ),
    "robot-toml": Reader(lambda: corpus("robot-toml"), _text, _description),
    "urdf": Reader(lambda: corpus("urdf"), _text, _urdf),
    "frames-toml": Reader(
        lambda: corpus("frames-toml"), _text, lambda data: read_frames(text_of(data), "frames.toml")
    ),
    "ur-yaml": Reader(lambda: corpus("ur-yaml"), _text, _controller(None)),
    "ur-conf": Reader(lambda: corpus("ur-conf"), _text, _controller(None)),
    "dh-table": Reader(lambda: corpus("dh-table"), _text, _controller("standard")),
    **{
        name: Reader(lambda name=name: corpus(name), _text, _program(name))
        for name in PROGRAM_FORMATS
    },
}


def case(name: str, seeds: Sequence[bytes], seed: int, index: int) -> bytes:
    """The input number `index` of a reader; the first ones are the seeds themselves."""
    if index < len(seeds):
        return seeds[index]
    return READERS[name].mutate(random.Random(f"{name} {seed} {index}"), seeds)
