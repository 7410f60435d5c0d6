"""Numbers of an HDF5 file, checked as in text tables: types, shapes, ranges, rotations.

Every function raises KeyError for a missing value and ValueError for an impossible one.
"""

from typing import Any

import h5py
import numpy as np

from calibtool.errors import InputError
from calibtool.robot.se3 import Array, check_poses, readonly
from calibtool.storage.texts import put_string
from calibtool.units import LARGEST

LARGEST_ERROR = 1e3  # SI; no error of a robot is a thousand metres or radians
_SMALLEST = 1e-15  # smallest number that may be a divisor
_INDEFINITE = 1e-9  # of the largest eigenvalue: rounding of a covariance that was inverted


def put(
    group: h5py.Group, name: str, values: Any, units: str, long_name: str, frame: str, *dims: str
) -> None:
    """A dataset with its unit, description, frame and dimension labels."""
    dataset = group.create_dataset(name, data=np.asarray(values))
    put_string(dataset, "units", units)
    put_string(dataset, "long_name", long_name)
    put_string(dataset, "frame", frame)
    for axis, label in enumerate(dims):
        dataset.dims[axis].label = label


def read_number(
    group: h5py.Group, name: str, lowest: float = -LARGEST, largest: float = LARGEST
) -> float:
    """An attribute between two bounds."""
    value = float(group.attrs[name])
    if not lowest <= value <= largest:
        raise ValueError(f"{group.name}: {name} is {value:g}, expected {lowest:g} to {largest:g}")
    return value


def read_count(group: h5py.Group, name: str) -> int:
    """An attribute that counts: a whole number from 0."""
    value = group.attrs[name]
    if np.ndim(value) or not 0 <= float(value) < 2**53:
        raise ValueError(f"{group.name}: {name} is no count")
    return int(value)


def get(group: h5py.Group, name: str, *shape: int, below: float = LARGEST) -> Array:
    """A dataset (…,) of the given shape, -1 for any length, its values smaller than `below` in
    size.

    As in tables of text, larger values are errors, and their squares would overflow.
    """
    array = get_with_gaps(group, name, *shape, below=below)
    if np.isnan(array).any():
        raise ValueError(f"{group.name}/{name} holds a value that is not finite")
    return array


def get_with_gaps(group: h5py.Group, name: str, *shape: int, below: float = LARGEST) -> Array:
    """A dataset (…,) as `get`, where NaN has a meaning."""
    dataset = group[name]
    if dataset.dtype.kind not in "iuf":  # numpy would read numbers from text
        raise ValueError(f"{dataset.name} holds {dataset.dtype}; expected numbers")
    array = readonly(dataset[()], shape)
    if np.isinf(array).any():
        raise ValueError(f"{dataset.name} holds a value that is not finite")
    if (np.abs(array) >= below).any():
        raise ValueError(f"{dataset.name} holds a value of {below:g} or more")
    return array


def get_positive(group: h5py.Group, name: str, *shape: int) -> Array:
    """A dataset (…,) of scales or standard deviations, all above zero."""
    array = get(group, name, *shape)
    if not (array > _SMALLEST).all():
        raise ValueError(f"{group.name}/{name} holds a value that is not above zero")
    return array


def get_indices(group: h5py.Group, name: str, count: float = 2**53) -> np.ndarray:
    """Row numbers from 0, (N,), below `count`."""
    values = get(group, name, -1, below=np.inf)
    if ((values < 0) | (values >= count) | (values % 1 != 0)).any():
        raise ValueError(f"{group.name}/{name} holds a value that is no row number")
    return values.astype(int)


def get_frames(group: h5py.Group, name: str, *shape: int) -> Array:
    """Poses (…, 4, 4) in m, or rotations (…, 3, 3): rigid to the usual number of written digits."""
    array = get(group, name, *shape)
    size = array.shape[-1]
    poses = np.tile(np.eye(4), (array.size // size**2, 1, 1))
    poses[:, :size, :size] = array.reshape(-1, size, size)
    try:
        check_poses(poses, f"{group.name}/{name}")
    except InputError as error:
        raise ValueError(str(error)) from None
    return array


def get_covariance(group: h5py.Group, name: str, count: int) -> Array:
    """A covariance (count, count): symmetric, without negative variances."""
    array = get(group, name, count, count)
    std = np.sqrt(np.maximum(np.diag(array), 0.0))
    scale = np.where(std > 0, std, 1.0)
    correlation = array / scale / scale[:, None]
    symmetric = np.allclose(correlation, correlation.T, rtol=0.0, atol=1e-6)
    if count and not (symmetric and np.linalg.eigvalsh(correlation).min() > -_INDEFINITE * count):
        raise ValueError(f"{group.name}/{name} is no covariance: not symmetric, or negative")
    return array
