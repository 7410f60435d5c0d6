"""Checks of an HDF5 file before it is read: its digest, its text heaps, its links and its sizes.

The digest is one line after the end of the HDF5 data. It finds accidental damage, and says nothing
about who wrote the file: all other checks run with it and without it. An HDF5 call cannot be
interrupted, and damaged bytes can send it into an endless loop.
"""

import hashlib
import math
import re
import struct
from typing import Any

import h5py
import numpy as np

_MARK = b"calibtool/sha256 "
_DIGEST_LINE = re.compile(_MARK + rb"[0-9a-f]{64}\n\Z")
_LENGTH = len(_MARK) + 65
_HEAP = re.compile(rb"GCOL\x01")  # a global heap: signature, version 1
_ROOM = 16 << 20  # bytes that any file may hold …
_PACKED = 20  # … and this many times its length: compressed numbers are not smaller
_TEXTS = 8  # number of texts that one attribute may hold
_CHARACTERS = 1 << 24  # bytes of all texts of variable length: a file may refer to one many times
SIGNATURE = b"\x89HDF\r\n\x1a\n"


def with_digest(data: bytes) -> bytes:
    """The file, followed by a line of text with its digest."""
    return data + _digest(memoryview(data))


def _digest(data: memoryview) -> bytes:
    return _MARK + hashlib.sha256(data).hexdigest().encode() + b"\n"


def check_bytes(data: bytes) -> None:
    """ValueError for bytes that do not match the digest, or an endless global heap; OSError for a
    file that is not HDF5.
    """
    if _DIGEST_LINE.search(data, max(0, len(data) - _LENGTH)):
        if data[-_LENGTH:] != _digest(memoryview(data)[:-_LENGTH]):
            raise ValueError(
                "its bytes do not match its SHA-256: changed since it was written; get it again "
                f"(if it was edited on purpose: head -c -{_LENGTH} FILE is the same "
                "without the digest)"
            )
        data = data[:-_LENGTH]
    if not data.startswith(SIGNATURE):
        raise OSError("no signature of HDF5")
    if _sizes(data) != b"\x08\x08":  # of other numbers, the heaps below would be misread
        raise ValueError("its addresses or lengths are not of 8 bytes")
    behind = data[_end_of_file(data) :]
    if behind and (behind.startswith(_MARK) or _MARK.startswith(behind)):
        raise ValueError(
            "it ends in the middle of its SHA-256: cut off since it was written; get it again"
        )
    for heap in _HEAP.finditer(data):
        _check_heap(data, heap.start())


def _sizes(data: bytes) -> bytes:
    """Bytes of an address and of a length, from the superblock."""
    at = 13 if data[8:9] in (b"\0", b"\1") else 9
    return data[at : at + 2]


def _end_of_file(data: bytes) -> int:
    """Where HDF5's own bytes end, from the superblock (HDF5 file format specification, II.A)."""
    at = 40 if data[8:9] in (b"\0", b"\1") else 28
    at += 4 if data[8:9] == b"\1" else 0
    return int.from_bytes(data[at : at + 8], "little")


def _check_heap(data: bytes, start: int) -> None:
    """Objects follow one another: index, length; index 0 is the free rest.

    A step of 0 would never end.
    """
    end, at = start + int.from_bytes(data[start + 8 : start + 16], "little"), start + 16
    while at + 16 <= min(end, len(data)):
        index, length = struct.unpack_from("<H6xQ", data, at)
        step = 16 + (length + 7) // 8 * 8 if index else length
        if step < 16 or at + step > end:
            raise ValueError(f"a heap of texts is broken at byte {at}")
        at += step


def check_contents(file: h5py.File, length: int) -> None:
    """ValueError for anything but groups and datasets of numbers and texts, each with one name and
    inside the file.

    length: bytes of the file. Soft and external links, virtual datasets and external storage would
    read other files; a dataset that claims much more than the file's length would fill the memory.
    """
    room, characters = _ROOM + _PACKED * length, _CHARACTERS
    seen: set[int] = set()
    waiting: list[tuple[str, Any]] = [("", file)]
    while waiting:
        path, item = waiting.pop()
        address = h5py.h5o.get_info(item.id).addr
        if address in seen:
            raise ValueError(f"{path} is another object under a second name")
        seen.add(address)
        characters -= _check_attributes(path, item)
        if isinstance(item, h5py.Group):
            for name in item:
                below = f"{path}/{name}"
                if not isinstance(item.get(name, getlink=True), h5py.HardLink):
                    raise ValueError(f"{below} is a link to another place")
                waiting.append((below, item[name]))
        elif isinstance(item, h5py.Dataset):
            room -= _check_dataset(path, item)
            characters -= _long_texts(item, characters)
            if room < 0:
                raise ValueError(f"{path}: claims more data than a file of {length} bytes can hold")
        else:
            raise ValueError(f"{path} is neither a group nor a dataset")
        if characters < 0:
            raise ValueError(f"{path}: its texts are longer than {_CHARACTERS} characters together")


def _check_dataset(path: str, dataset: h5py.Dataset) -> int:
    """Its size in bytes."""
    if dataset.is_virtual or dataset.external:
        raise ValueError(f"{path}: its data stand in another file")
    if dataset.dtype.kind not in "iufb" and h5py.check_string_dtype(dataset.dtype) is None:
        raise ValueError(f"{path} holds {dataset.dtype}; expected numbers or text")
    return int(math.prod(dataset.shape or ()) * dataset.dtype.itemsize)


def _long_texts(dataset: h5py.Dataset, room: int) -> int:
    """Bytes of its texts of variable length, read one at a time until there is no room."""
    total = 0
    if dataset.dtype.kind == "O":
        for index in np.ndindex(dataset.shape):
            total += len(dataset[index]) + 1
            if total > room:
                break
    return total


def _check_attributes(path: str, item: Any) -> int:
    """Bytes of its attributes' texts of variable length, which many references multiply."""
    total = 0
    for name in item.attrs:
        attribute = item.attrs.get_id(name)
        if attribute.dtype.kind != "O":
            continue
        if math.prod(attribute.shape) > _TEXTS:
            raise ValueError(f"{path}: attribute {name} holds {math.prod(attribute.shape)} texts")
        total += sum(len(text) + 1 for text in np.ravel(item.attrs[name]))
        if total > _CHARACTERS:
            break
    return total
