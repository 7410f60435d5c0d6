"""Files: what is written is read back to the byte, describes itself, and a damaged one is
refused with its name.
"""

import io
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import h5py
import numpy as np
import pytest
from cases import examples
from hypothesis import given
from hypothesis import strategies as st

from calibtool.calibration import Calibration, identify, train
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.families import ERROR_KINDS
from calibtool.errors import InputError
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.registration import register
from calibtool.measurement.setup import Setup
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.storage import read_any, read_calibration, read_measurements, to_bytes

PROVENANCE = {"command": "calibtool simulate ur5 --seed 1", "note": "µm, δζ", "seed": "1"}


@cache
def measurements(kind: str, name: str = "ur5") -> Measurements:
    robot = load_robot(name)
    simulation = Simulation(
        seed=1,
        configurations=15,
        scales=ErrorScales(kinds=ERROR_KINDS),
        unregistered="unregistered" in kind,
    )
    made = replace(simulate(robot, simulation), provenance=PROVENANCE)
    if "pose" in kind:
        assert made.truth is not None
        poses = made.truth.setup.T_instrument_base @ made.truth.actual.forward(made.q)
        setup = Setup(
            np.eye(4), np.zeros((1, 3)), np.eye(3), frame_known=False, targets_known=False
        )
        made = Measurements(
            robot, made.q, poses[:, None, :3, 3], poses[:, :3, :3], setup, 1e-5, 1e-4
        )
        made = replace(made, setup=register(made))
    return replace(made, truth=None) if "real" in kind else made


@cache
def calibration(kind: str, name: str = "ur5") -> Calibration:
    data = measurements(
        "unregistered" if "unregistered" in kind else "pose" if "pose" in kind else "registered",
        name,
    )
    base = "nominal" if "nominal" in kind else "local-poe"
    if "network" not in kind:
        made = identify(data, base)
    else:
        options = TrainingOptions(
            restarts=2, hidden=3, validation=0.0 if "all rows" in kind else 0.5
        )
        made = train(data, base, options)
    return replace(made, provenance=PROVENANCE)


MEASUREMENTS = ["registered", "unregistered", "pose", "real", "real unregistered"]
CALIBRATIONS = [
    "nominal",
    "local-poe",
    "nominal network",
    "local-poe network",
    "local-poe unregistered",
    "local-poe pose",
    "nominal network unregistered",
    "nominal network all rows",
]
NAMES = ["scara", "ur5", "panda", "gantry"]


def contents(kind: str, name: str = "ur5") -> Measurements | Calibration:
    return measurements(kind, name) if kind in MEASUREMENTS else calibration(kind, name)


def read(data: bytes, name: str = "file.h5") -> Measurements | Calibration:
    return read_any(io.BytesIO(data), name)


# --- round trips ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kind", [*MEASUREMENTS, *CALIBRATIONS])
def test_write_read_write_gives_the_same_bytes(kind: str, name: str) -> None:
    data = to_bytes(contents(kind, name))
    assert to_bytes(read(data)) == data


@pytest.mark.parametrize("kind", MEASUREMENTS)
def test_measurements_are_read_as_they_were(kind: str) -> None:
    before = measurements(kind)
    after = read_measurements(io.BytesIO(to_bytes(before)), "m.h5")
    assert np.array_equal(after.q, before.q)
    assert np.array_equal(after.points, before.points)
    assert (after.rotations is None) == (before.rotations is None)
    if before.rotations is not None:
        assert np.array_equal(after.rotations, before.rotations)
    assert after.kind == before.kind
    assert after.provenance == before.provenance
    assert (after.noise_position, after.noise_orientation) == (
        before.noise_position,
        before.noise_orientation,
    )
    assert (after.setup.frame_known, after.setup.targets_known) == (
        before.setup.frame_known,
        before.setup.targets_known,
    )
    assert np.array_equal(after.setup.T_instrument_base, before.setup.T_instrument_base)
    assert (after.truth is None) == (before.truth is None)
    if before.truth is not None and after.truth is not None:
        assert np.array_equal(
            after.truth.actual.forward(before.q), before.truth.actual.forward(before.q)
        )
        assert np.array_equal(after.truth.setup.targets, before.truth.setup.targets)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kind", CALIBRATIONS)
def test_a_calibration_predicts_the_same_after_reading(kind: str, name: str) -> None:
    before = calibration(kind, name)
    after = read_calibration(io.BytesIO(to_bytes(before)), "c.h5")
    q = measurements("registered", name).q
    assert np.array_equal(after.forward(q), before.forward(q))
    assert (after.network is None) == (before.network is None)
    assert after.base.model == before.base.model
    assert after.base.unobservable == before.base.unobservable
    assert after.equivalent == before.equivalent


def test_where_a_file_comes_from_survives_in_any_order() -> None:
    for order in (PROVENANCE, dict(reversed(PROVENANCE.items()))):
        data = to_bytes(replace(measurements("registered"), provenance=order))
        assert read(data).provenance == order
        assert to_bytes(read(data)) == data


def test_a_file_is_used_without_the_catalogue() -> None:
    # The robot is embedded: its description and URDF, as text.
    data = to_bytes(measurements("registered"))
    with h5py.File(io.BytesIO(data), "r") as file:
        assert file["robot/urdf"].asstr()[()] == load_robot("ur5").source.urdf_text
        assert file["robot/description"].asstr()[()] == load_robot("ur5").source.toml_text
    robot = read(data).robot
    q = measurements("registered").q
    assert np.array_equal(robot.mechanism.forward(q), load_robot("ur5").mechanism.forward(q))


def test_each_reader_takes_its_own_kind_only() -> None:
    a, b = to_bytes(measurements("registered")), to_bytes(calibration("nominal"))
    with pytest.raises(InputError, match=r"^m\.h5: holds measurements; expected a calibration"):
        read_calibration(io.BytesIO(a), "m.h5")
    with pytest.raises(InputError, match=r"^c\.h5: holds a calibration; expected measurements"):
        read_measurements(io.BytesIO(b), "c.h5")


# --- bytes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["registered", "pose", "local-poe network"])
def test_the_same_contents_give_the_same_bytes_without_time_stamps(kind: str) -> None:
    data = to_bytes(contents(kind))
    assert to_bytes(contents(kind)) == data
    with h5py.File(io.BytesIO(data), "r") as file:
        times: list[int] = []

        def note(_: str, item: object) -> None:
            if isinstance(item, h5py.Dataset):
                info = h5py.h5g.get_objinfo(item.id)
                times.append(info.mtime)

        file.visititems(note)
    assert times
    assert set(times) == {0}


def test_root_attributes_name_schema_version_and_creator() -> None:
    for kind, schema in (
        ("registered", "calibtool/measurements"),
        ("nominal", "calibtool/calibration"),
    ):
        with h5py.File(io.BytesIO(to_bytes(contents(kind))), "r") as file:
            assert file.attrs["schema"] == schema.encode()
            assert file.attrs["schema_version"] == 1
            assert file.attrs["creator"] == b"calibtool"
            assert file.attrs["creator_version"]


# --- self-description -----------------------------------------------------------------------------


def datasets(data: bytes) -> dict[str, tuple[bool, dict[str, object], list[str]]]:
    """Path → whether it holds text, attributes, and dimension labels."""
    found: dict[str, tuple[bool, dict[str, object], list[str]]] = {}

    def note(path: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            is_text = h5py.check_string_dtype(item.dtype) is not None
            found[path] = (is_text, dict(item.attrs), [dim.label for dim in item.dims])

    with h5py.File(io.BytesIO(data), "r") as file:
        file.visititems(note)
    return found


@pytest.mark.parametrize("kind", [*MEASUREMENTS, *CALIBRATIONS])
def test_every_dataset_of_numbers_carries_units_name_frame_and_labels(kind: str) -> None:
    numbers = {
        path: rest
        for path, (is_text, *rest) in datasets(to_bytes(contents(kind))).items()
        if not is_text
    }
    assert len(numbers) >= 4
    for path, (attributes, labels) in numbers.items():
        assert {"units", "long_name", "frame"} <= set(attributes), path
        assert attributes["units"], path
        assert attributes["long_name"], path
        assert all(labels), path


@pytest.mark.parametrize("kind", ["registered", "local-poe network"])
def test_datasets_of_text_are_described_too(kind: str) -> None:
    # docs/file-formats.md: every dataset carries units, long_name, its frame, and dimension labels.
    for path, (is_text, attributes, labels) in datasets(to_bytes(contents(kind))).items():
        if is_text:
            assert {"units", "long_name", "frame"} <= set(attributes), path
            assert all(labels), path


def test_units_and_frames_are_those_of_the_quantities() -> None:
    found = datasets(to_bytes(measurements("pose", "scara")))
    assert found["measurements/joint_positions"][1]["units"] == b"rad, rad, m, rad"
    assert found["measurements/points"][1]["units"] == b"m"
    assert found["measurements/points"][1]["frame"] == b"instrument"
    assert found["measurements/points"][2] == ["configuration", "target", "axis"]
    assert found["registration/targets"][1]["frame"] == b"tool"


# --- text -----------------------------------------------------------------------------------------


def texts_by_length(data: bytes) -> dict[str, bool]:
    """Path of every text, dataset or attribute → whether its length is fixed."""
    found: dict[str, bool] = {}

    def note(path: str, item: h5py.HLObject) -> None:
        for name in item.attrs:
            info = h5py.check_string_dtype(item.attrs.get_id(name).dtype)
            if (
                info is not None and name != "DIMENSION_LABELS"
            ):  # of variable length by the HDF5 standard; never read
                found[f"{path}@{name}"] = info.length is not None
        if (
            isinstance(item, h5py.Dataset)
            and (info := h5py.check_string_dtype(item.dtype)) is not None
        ):
            found[path] = info.length is not None

    with h5py.File(io.BytesIO(data), "r") as file:
        note("/", file)
        file.visititems(note)
    return found


def of_variable_length(data: bytes) -> bytes:
    """The same file with its texts as files of version 0.1 had them."""

    def change(file: h5py.File) -> None:
        for place in texts_by_length(data):
            path, _, name = place.partition("@")
            if name:
                file[path].attrs[name] = file[path].attrs[name].decode()
            else:
                values = file[path].asstr()[()]
                del file[path]
                file.create_dataset(path, data=values, dtype=h5py.string_dtype())

    return edited(data, change)


@pytest.mark.parametrize("kind", ["registered", "local-poe network"])
def test_no_text_is_of_variable_length(kind: str) -> None:
    """HDF5's global heap carries no checksums: a zeroed sector there is an endless loop in
    the HDF5 library.
    """
    found = texts_by_length(to_bytes(contents(kind)))
    assert {"robot/urdf", "robot@name", "/@schema", "provenance@command"} <= set(found)
    assert all(found.values()), [place for place, fixed in found.items() if not fixed]


@pytest.mark.parametrize("kind", ["registered", "local-poe network"])
def test_texts_of_variable_length_are_read_all_the_same(kind: str) -> None:
    data = to_bytes(contents(kind))
    old = of_variable_length(data)
    assert not any(texts_by_length(old).values())
    assert to_bytes(read(old, "old.h5")) == data


@pytest.mark.parametrize("command", ["", "ü" * 50_000, "gr\udcfcn.csv"])
def test_texts_of_any_length_and_from_any_file_name(command: str) -> None:
    data = to_bytes(replace(contents("registered"), provenance={"command": command}))
    expected = command.replace(
        "\udcfc", "\ufffd"
    )  # a byte that is no UTF-8, as file names may have
    assert read(data, "long.h5").provenance["command"] == expected


# --- damage ---------------------------------------------------------------------------------------


def edited(data: bytes, change: Callable[[h5py.File], None]) -> bytes:
    buffer = io.BytesIO(data[:-82])  # without the digest
    with h5py.File(buffer, "r+") as file:
        change(file)
    return buffer.getvalue()


def put(path: str, values: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file[path]
        file[path] = values

    return change


def drop(path: str) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file[path]

    return change


def attribute(path: str, name: str, value: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        file[path].attrs[name] = value

    return change


def test_a_newer_format_is_refused_with_its_version() -> None:
    for kind in ("registered", "nominal"):
        data = edited(to_bytes(contents(kind)), attribute("/", "schema_version", 2))
        with pytest.raises(
            InputError, match=r"^new\.h5: written in format version 2, this calibtool reads up to 1"
        ):
            read(data, "new.h5")


def test_a_foreign_hdf5_file_is_refused() -> None:
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file["x"] = np.arange(3)
    for schema in (None, "other/format", 7):
        change = attribute("/", "schema", schema)
        data = (
            buffer.getvalue() if schema is None else edited(buffer.getvalue() + bytes(82), change)
        )
        with pytest.raises(InputError, match=r"^x\.h5: an HDF5 file, but not one of calibtool"):
            read(data, "x.h5")


def test_an_empty_stream_is_refused() -> None:
    with pytest.raises(InputError, match=r"^-: empty; expected a calibtool HDF5 file"):
        read(b"", "-")


@given(cut=st.floats(0.0001, 0.9999))
@examples(20)
def test_a_file_that_was_cut_off_is_refused(cut: float) -> None:
    data = to_bytes(measurements("registered"))
    with pytest.raises(InputError, match=r"^cut\.h5: "):
        read(data[: max(1, int(cut * len(data)))], "cut.h5")


@given(data=st.binary(min_size=1, max_size=200))
@examples(20)
def test_any_other_bytes_are_refused(data: bytes) -> None:
    for start in (b"", b"\x89HDF\r\n\x1a\n"):
        with pytest.raises(InputError, match=r"^junk: "):
            read(start + data, "junk")


def test_a_changed_byte_in_the_head_is_harmless_or_refused_but_never_a_crash() -> None:
    # Only the head: deeper in, a changed byte can send the HDF5 library itself into
    # an endless loop.
    data = to_bytes(measurements("registered"))
    refused = 0
    for position in range(96):
        changed = bytearray(data)
        changed[position] ^= 0xFF
        try:
            read(bytes(changed), "bad.h5")
        except InputError as error:
            assert str(error).startswith("bad.h5: ")  # noqa: PT017
            refused += 1
    assert refused > 20


NUMERIC = {
    "registered": [
        "measurements/joint_positions",
        "measurements/points",
        "registration/T_instrument_base",
        "registration/targets",
        "truth/errors/placements",
        "truth/errors/twists",
        "truth/errors/offsets",
        "truth/errors/harmonics",
        "truth/errors/gravity",
        "truth/errors/backlash",
        "truth/registration/targets",
    ],
    "pose": ["measurements/rotations", "registration/R_tool_sensor"],
    "nominal network": [
        "model/errors/placements",
        "registration/targets",
        "registration_nominal/T_instrument_base",
        "networks/0/input_centre",
        "networks/0/input_scale",
        "networks/0/hidden_weights",
        "networks/0/hidden_bias",
        "networks/0/output_weights",
        "networks/0/output_bias",
        "networks/0/output_scale",
        "training/training_loss",
    ],
}
CASES = [(kind, path) for kind, paths in NUMERIC.items() for path in paths]


@pytest.mark.parametrize(("kind", "path"), CASES)
def test_a_dataset_with_a_dimension_too_many_is_refused(kind: str, path: str) -> None:
    data = to_bytes(contents(kind))
    with h5py.File(io.BytesIO(data), "r") as file:
        values = file[path][()]
    with pytest.raises(InputError, match=r"^bad\.h5: "):
        read(edited(data, put(path, values[..., None])), "bad.h5")


# A calibration may have any number of targets, and a training any number of iterations.
ANY_LENGTH = [
    ("nominal network", "registration/targets"),
    ("nominal network", "training/training_loss"),
]


@pytest.mark.parametrize(("kind", "path"), [case for case in CASES if case not in ANY_LENGTH])
def test_a_dataset_with_a_row_too_few_is_refused(kind: str, path: str) -> None:
    data = to_bytes(contents(kind))
    with h5py.File(io.BytesIO(data), "r") as file:
        values = file[path][()]
    with pytest.raises(InputError, match=r"^bad\.h5: "):
        read(edited(data, put(path, values[:-1])), "bad.h5")


# NaN in all coordinates of a measured point means that the target was not seen.
@pytest.mark.parametrize(
    ("kind", "path"), [case for case in CASES if case[1] != "measurements/points"]
)
def test_a_dataset_with_a_value_that_is_not_finite_is_refused(kind: str, path: str) -> None:
    data = to_bytes(contents(kind))
    with h5py.File(io.BytesIO(data), "r") as file:
        values = file[path][()]
    for bad in (np.nan, np.inf):
        values.flat[-1] = bad
        with pytest.raises(InputError, match=rf"^bad\.h5: .*{path.split('/')[-1]}.*not finite"):
            read(edited(data, put(path, values)), "bad.h5")


@pytest.mark.parametrize(
    ("kind", "path"),
    [*CASES, ("registered", "robot/urdf"), ("nominal", "model"), ("nominal", "robot")],
)
def test_a_missing_part_is_refused(kind: str, path: str) -> None:
    with pytest.raises(InputError, match=r"^bad\.h5: "):
        read(edited(to_bytes(contents(kind)), drop(path)), "bad.h5")


@pytest.mark.parametrize(
    ("kind", "path", "name"),
    [
        ("registered", "measurements", "noise_position_m"),
        ("registered", "measurements", "noise_orientation_rad"),
        ("registered", "truth", "temperature_c"),
        ("nominal", "model", "noise_position_m"),
    ],
)
def test_an_attribute_that_is_not_a_finite_number_is_refused(
    kind: str, path: str, name: str
) -> None:
    for value in (np.nan, "much"):
        with pytest.raises(InputError, match=r"^bad\.h5: "):
            read(edited(to_bytes(contents(kind)), attribute(path, name, value)), "bad.h5")


def test_points_for_other_targets_than_registered_are_refused() -> None:
    data = to_bytes(measurements("registered"))
    targets = measurements("registered").setup.targets
    with pytest.raises(InputError, match=r"^bad\.h5: .*points have shape"):
        read(edited(data, put("registration/targets", targets[:2])), "bad.h5")


def test_virtual_joints_that_do_not_complete_the_robot_are_refused() -> None:
    text = h5py.string_dtype()
    for joints in (["rx"], ["rx", "roll"], []):
        data = edited(
            to_bytes(calibration("nominal", "scara")),
            put("equivalent/virtual_joints", np.array(joints, dtype=object).astype(text)),
        )
        with pytest.raises(InputError, match=r"^bad\.h5: .*virtual_joints"):
            read(data, "bad.h5")


def test_a_damaged_robot_is_refused() -> None:
    for path, texts in (("robot/urdf", "<robot"), ("robot/description", "name = ")):
        with pytest.raises(InputError, match=r"^bad\.h5: "):
            read(edited(to_bytes(measurements("registered")), put(path, texts)), "bad.h5")
