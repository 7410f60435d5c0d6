"""Text in HDF5, of fixed length.

Text of variable length is in HDF5's global heap, which has no checksums: a zeroed sector there
sends the HDF5 library (2.0 among them) into an endless loop at an object of size zero. Text of
fixed length is in object headers, with checksums, or in a dataset of its own. Both kinds are read.
"""

from collections.abc import Iterable, Sequence

import h5py
import numpy as np

from calibtool.atomic_output import encoded


def put_string(item: h5py.Group | h5py.Dataset, name: str, text: str) -> None:
    """A text attribute of a group or dataset."""
    data = encoded(text)
    item.attrs[name] = np.array(data, _kind(data))


def string(item: h5py.Group | h5py.Dataset, name: str, default: str | None = None) -> str:
    """A text attribute.

    KeyError if it is missing and there is no default, ValueError if it is no text.
    """
    value = item.attrs[name] if default is None else item.attrs.get(name, default)
    if isinstance(value, bytes):
        return value.decode("utf-8")
    if not isinstance(value, str):
        raise ValueError(f"{item.name}: {name} is no text")
    return value


def choice(item: h5py.Group, name: str, allowed: Iterable[str]) -> str:
    """A text attribute that is one of a list. ValueError for any other."""
    found = string(item, name)
    if found not in (names := tuple(allowed)):
        raise ValueError(f"{item.name}: {name} '{found[:100]}' is none of {', '.join(names)}")
    return found


def put_text(group: h5py.Group, name: str, text: str | Sequence[str], long_name: str) -> None:
    """Text, or a list of texts, with a description."""
    data = encoded(text) if isinstance(text, str) else [encoded(item) for item in text]
    kind = _kind(data) if isinstance(data, bytes) else _kind(*data)
    dataset = group.create_dataset(name, data=np.array(data, kind), dtype=kind)
    put_string(dataset, "units", "")
    put_string(dataset, "long_name", long_name)
    put_string(dataset, "frame", "")
    if dataset.ndim:
        dataset.dims[0].label = "item"


def text(group: h5py.Group, name: str) -> str:
    """One text dataset."""
    return str(group[name].asstr()[()])


def texts(group: h5py.Group, name: str) -> tuple[str, ...]:
    """A list of texts; their total length is checked before (`file_checks`)."""
    if group[name].ndim != 1:
        raise ValueError(f"{group.name}/{name} is no list of texts")
    return tuple(map(str, group[name].asstr()[()]))


def _kind(*data: bytes) -> np.dtype:
    kind: np.dtype = h5py.string_dtype(
        "utf-8", max([1, *map(len, data)])
    )  # HDF5 has no text of length zero
    return kind
