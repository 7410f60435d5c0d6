"""HDF5 files of an attacker, or of a failing disk: nothing else is read, nothing fills the
memory, nothing loops.
"""

import hashlib
import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from readers import calibrations, measurements, six, studied, without_digest

from calibtool.calibration import Calibration, identify
from calibtool.errors import InputError
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.storage import read_any, read_study, to_bytes
from calibtool.storage.file_checks import check_contents, with_digest
from calibtool.storage.studies import study_to_bytes


def changed(change: Callable[[h5py.File], None]) -> bytes:
    buffer = io.BytesIO(without_digest(to_bytes(measurements())))
    with h5py.File(buffer, "r+") as file:
        change(file)
    return buffer.getvalue()


def refused(data: bytes, reason: str) -> None:
    with pytest.raises(InputError, match=rf"^x\.h5: .*{reason}") as caught:
        read_any(io.BytesIO(data), "x.h5")
    assert "\n" not in str(caught.value)


# --- the digest -----------------------------------------------------------------------------------


def test_the_digest_is_that_of_what_stands_before_it() -> None:
    data = to_bytes(measurements())
    assert (
        data[-82:] == b"calibtool/sha256 " + hashlib.sha256(data[:-82]).hexdigest().encode() + b"\n"
    )


def test_hdf5_reads_the_file_with_its_digest_and_without_it() -> None:
    data = to_bytes(measurements())
    for part in (data, data[:-82]):
        with h5py.File(io.BytesIO(part), "r") as file:
            assert np.array_equal(file["measurements/joint_positions"][()], measurements().q)
        assert to_bytes(read_any(io.BytesIO(part), "x.h5")) == data


def test_a_file_that_ends_inside_its_digest_is_refused() -> None:
    data = to_bytes(measurements())
    for missing in range(1, 82):
        refused(data[:-missing], "cut off")


@pytest.mark.parametrize(
    "contents", [measurements(), calibrations()[2]], ids=["measurements", "calibration"]
)
def test_a_zeroed_sector_anywhere_is_refused(contents: object) -> None:
    data = to_bytes(contents)
    for start in range(0, len(data) - 82 - 512, 512):  # the digest itself stays
        damaged = data[:start] + bytes(512) + data[start + 512 :]
        if damaged != data:
            refused(damaged, "SHA-256")


def test_a_changed_bit_anywhere_is_refused() -> None:
    data = to_bytes(measurements())
    for position in range(0, len(data) - 82, 97):
        changed = bytearray(data)
        changed[position] ^= 1
        refused(bytes(changed), "SHA-256")


def test_a_changed_byte_is_refused_with_the_way_to_read_the_file_all_the_same() -> None:
    data = to_bytes(measurements())
    place = data.find(b"m", 600)
    refused(data[:place] + b"n" + data[place + 1 :], r"head -c -82")


def test_a_file_edited_by_an_hdf5_tool_loses_its_digest_and_is_read() -> None:
    buffer = io.BytesIO(to_bytes(measurements()))
    with h5py.File(buffer, "r+") as file:
        file["measurements"].attrs["noise_position_m"] = 2e-5
    assert read_any(io.BytesIO(buffer.getvalue()), "x.h5").noise_position == 2e-5


@pytest.mark.parametrize("sealed", [False, True])
@pytest.mark.parametrize("reserved", [bytes(3), b"abc"])
def test_a_broken_heap_of_texts(sealed: bool, reserved: bytes) -> None:
    # As other tools write texts. The HDF5 library would go through the zeros for ever, and skips
    # the reserved bytes.
    buffer = io.BytesIO(without_digest(to_bytes(measurements())))
    with h5py.File(buffer, "r+") as file:
        file["measurements"].attrs["note"] = "x" * 2000
    data = bytearray(buffer.getvalue())
    heap = data.find(b"GCOL\x01\0\0\0")
    assert heap > 0
    data[heap + 5 : heap + 8] = reserved
    data[heap + 16 : heap + 1024] = bytes(1008)
    broken = bytes(data)
    refused(with_digest(broken) if sealed else broken, "heap of texts is broken")


def test_lengths_of_another_size_would_hide_a_heap() -> None:
    data = bytearray(without_digest(to_bytes(measurements())))
    place = 13 if data[8] in (0, 1) else 9
    data[place + 1] = 4
    refused(with_digest(bytes(data)), "not of 8 bytes")


# --- other files ----------------------------------------------------------------------------------


def move(file: h5py.File, path: str, link: object) -> None:
    del file[path]
    file[path] = link


@pytest.mark.parametrize("path", ["registration", "measurements/points", "robot/urdf"])
@pytest.mark.parametrize(
    "link", [h5py.ExternalLink("/etc/passwd", "/"), h5py.SoftLink("/"), h5py.SoftLink("loop")]
)
def test_links_are_refused(path: str, link: object) -> None:
    refused(changed(lambda file: move(file, path, link)), "link to another place")


def test_soft_links_in_a_circle() -> None:
    def change(file: h5py.File) -> None:
        file["a"], file["b"] = h5py.SoftLink("/b"), h5py.SoftLink("/a")

    refused(changed(change), "link to another place")


def test_groups_in_a_circle() -> None:
    def change(file: h5py.File) -> None:
        file["measurements/again"] = file["/"]

    refused(changed(change), "second name")


def test_a_virtual_dataset(tmp_path: Path) -> None:
    secret = tmp_path / "secret.h5"
    with h5py.File(secret, "w") as file:
        file["x"] = np.arange(36.0)

    def change(file: h5py.File) -> None:
        layout = h5py.VirtualLayout(shape=(36,), dtype="f8")
        layout[:] = h5py.VirtualSource(str(secret), "x", shape=(36,))
        file.create_virtual_dataset("extra", layout)

    refused(changed(change), "in another file")


def test_external_storage(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(bytes(8 * 36))

    def change(file: h5py.File) -> None:
        del file["measurements/joint_positions"]
        file.create_dataset(
            "measurements/joint_positions", (12, 3), "f8", external=[(str(secret), 0, 288)]
        )

    refused(changed(change), "in another file")


# --- memory ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(10**15, 3), (2**40, 2**40), (1 << 24, 3)])
def test_a_dataset_that_claims_far_more_than_the_file_holds(shape: tuple[int, ...]) -> None:
    def change(file: h5py.File) -> None:
        del file["measurements/joint_positions"]
        file.create_dataset("measurements/joint_positions", shape, "f8", chunks=(64, 1))

    refused(changed(change), "claims more data|overflow|too large|damaged")


def test_a_compression_bomb() -> None:
    def change(file: h5py.File) -> None:
        del file["measurements/joint_positions"]
        zeros = np.zeros((1 << 20, 3))
        file.create_dataset(
            "measurements/joint_positions", data=zeros, chunks=(1 << 17, 3), compression="gzip"
        )

    data = changed(change)
    assert len(data) < 200_000
    refused(data, "claims more data")


def test_many_names_of_one_long_text() -> None:
    def change(file: h5py.File) -> None:
        file["measurements"].attrs.create("kind", ["x"] * 1000, dtype=h5py.string_dtype())

    refused(changed(change), "1000 texts")


def many_references(data: bytes, path: str, count: int, text: bytes) -> bytes:
    """A file with a column of texts of variable length, all of them the one in its heap."""
    buffer = io.BytesIO(data)
    with h5py.File(buffer, "r+") as file:
        if path in file:
            del file[path]
        column = file.create_dataset(path, (count,), dtype=h5py.string_dtype())
        column[0] = text
        file.flush()
        offset = column.id.get_offset()
    changed = bytearray(buffer.getvalue())
    changed[offset : offset + 16 * count] = changed[offset : offset + 16] * count
    return bytes(changed)


@pytest.mark.parametrize("sealed", [False, True])
@pytest.mark.parametrize("path", ["model/unobservable", "registration/places"])
def test_many_references_to_one_long_text(path: str, sealed: bool) -> None:
    plain = without_digest(to_bytes(calibrations()[0]))
    data = many_references(plain, path, 20_000, b"x" * 200_000)
    assert len(data) < 1 << 20
    refused(with_digest(data) if sealed else data, "longer than")
    few = many_references(plain, "model/unobservable", 3, b"x" * 200_000)
    assert read_any(io.BytesIO(few), "x.h5").base.unobservable == ("x" * 200_000,) * 3


@pytest.mark.parametrize("sealed", [False, True])
def test_many_references_in_the_table_of_a_study(sealed: bool) -> None:
    plain = without_digest(study_to_bytes(studied(), "{}"))
    data = many_references(plain, "table/status", 20_000, b"x" * 200_000)
    with pytest.raises(InputError, match="longer than"):
        read_study(io.BytesIO(with_digest(data) if sealed else data), "s.h5")


# --- types ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "values",
    [
        np.zeros((12, 3), complex),
        np.zeros((12, 3), "f8,f8"),
        np.full((12, 3), b"1.5"),
        np.ones((12, 3), bool),
        np.zeros((12, 3), "V8"),
    ],
    ids=["complex", "compound", "text", "boolean", "opaque"],
)
def test_what_is_no_number_never_becomes_one(values: np.ndarray) -> None:
    refused(
        changed(lambda file: move(file, "measurements/joint_positions", values)), "expected numbers"
    )


def test_row_numbers_that_no_table_has() -> None:
    buffer = io.BytesIO(without_digest(to_bytes(calibrations()[2])))
    with h5py.File(buffer, "r+") as file:
        move(file, "training/training_rows", np.array([1e300, 0.0]))
    refused(buffer.getvalue(), "no row number")


def whole() -> Calibration:
    """A calibration with a network and a posterior."""
    complete = identify(measurements(), "complete").base
    return replace(
        calibrations()[2], base=replace(calibrations()[2].base, posterior=complete.posterior)
    )


def set_first(data: bytes, path: str, value: float) -> bytes:
    buffer = io.BytesIO(data)
    with h5py.File(buffer, "r+") as file:
        values = file[path][()].astype(float)
        values.flat[0] = value
        move(file, path, values)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("path", "value", "why"),
    [
        *(
            (f"networks/0/{name}", value, why)
            for name in ("input_scale", "output_scale")
            for value, why in ((0.0, "above zero"), (-1.0, "above zero"), (1e308, "or more"))
        ),
        ("networks/0/hidden_weights", 1e200, "or more"),
        ("model/errors/twists", 1e200, "1000 or more"),
        ("model/errors/placements", -1e4, "1000 or more"),
        ("model/joint_positions", 1e16, "or more"),
        ("registration/T_instrument_base", 2.0, "rigid"),
        ("registration/T_instrument_base", -1.0, "rigid"),
        ("registration_nominal/targets", 1e300, "or more"),
        ("model/posterior/covariance", -1e-6, "covariance"),
        ("model/posterior/prior_std", 0.0, "above zero"),
        ("training/training_rows", 1e6, "row number"),
        ("training/training_rows", 0.5, "row number"),
    ],
)
def test_numbers_beyond_their_ranges(path: str, value: float, why: str) -> None:
    data = set_first(without_digest(to_bytes(whole())), path, value)
    refused(data, why)
    refused(with_digest(data), why)


@pytest.mark.parametrize(
    ("group", "name", "value"),
    [
        *(("model", name, -1) for name in ("rank", "observable_rank", "iterations")),
        *(("model", "noise_position_m", value) for value in (0.0, -1e-5, 1e308, np.nan)),
        ("model", "residual_rms_position_m", -1e-6),
        ("model", "residual_rms_orientation_rad", np.inf),
        ("model/posterior", "noise_factor", -1.0),
        ("training", "chosen", 1e300),
    ],
)
def test_attributes_beyond_their_ranges(group: str, name: str, value: float) -> None:
    buffer = io.BytesIO(without_digest(to_bytes(whole())))
    with h5py.File(buffer, "r+") as file:
        file[group].attrs[name] = value
    refused(buffer.getvalue(), name)


@pytest.mark.parametrize("value", [0.5, -1.0, 1.001, 1e200])
def test_measured_rotations_that_are_none(value: float) -> None:
    simulated = simulate(six(), Simulation(seed=1, configurations=8, instrument="board"))
    for path in ("measurements/rotations", "registration/T_tool_camera"):
        data = set_first(without_digest(to_bytes(simulated)), path, value)
        refused(data, "rigid|or more")


def test_every_file_of_calibtool_passes() -> None:
    for contents in (measurements(), *calibrations()):
        data = to_bytes(contents)
        with h5py.File(io.BytesIO(data), "r") as file:
            check_contents(file, len(data))


def test_a_named_type_is_neither_a_group_nor_a_dataset() -> None:
    def name_a_type(file: h5py.File) -> None:
        file["measurements/kind"] = np.dtype("f8")

    refused(changed(name_a_type), "neither a group nor a dataset")


# --- studies --------------------------------------------------------------------------------------


def test_the_file_of_a_study_is_checked_like_the_others(tmp_path: Path) -> None:
    data = study_to_bytes(studied(), "{}")
    assert read_study(io.BytesIO(data), "s.h5").table.rows == studied().rows

    def refused_study(data: bytes, why: str) -> None:
        with pytest.raises(InputError, match=why):
            read_study(io.BytesIO(data), "s.h5")

    refused_study(data[:500] + b"\x01" + data[501:], "SHA-256")
    for name, values, why in (
        ("noise_mm", h5py.ExternalLink(str(tmp_path / "other.h5"), "/x"), "link to another place"),
        ("noise_mm", np.zeros(7), "differ in length"),
        ("noise_mm", np.full(3, np.inf), "noise_mm"),
        ("run", np.array([1.0, 2.0, 1e300]), "whole numbers"),
        ("noise_mm", np.zeros(3, complex), "damaged|expected numbers"),
    ):
        buffer = io.BytesIO(without_digest(data))
        with h5py.File(buffer, "r+") as file:
            del file["table"][name]
            file["table"][name] = values
        refused_study(buffer.getvalue(), why)
