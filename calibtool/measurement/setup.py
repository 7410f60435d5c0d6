"""Set-up of a measurement: the pose of the instrument and its targets on the tool."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from calibtool.errors import InputError
from calibtool.measurement.kinds import KINDS, Kind
from calibtool.robot.se3 import Array, readonly

_COLLINEAR = 1e-3  # smallest extent across the line over the largest one along it


@dataclass(frozen=True, eq=False)
class Setup:
    """Set-up of the measurement, known beforehand or estimated by registration.

    T_instrument_base  (4, 4) pose of K_0 in the instrument's frame
    targets            (m, 3) target points in the tool frame, m; the sensor's origin for a 6-D
                       instrument
    R_tool_sensor      (3, 3) orientation of a 6-D instrument's sensor in the tool frame, None for
                       target points
    frame_known        whether the instrument's frame was given (otherwise every fit estimates it)
    targets_known      whether targets (and sensor orientation) were given
    further_frames     (G − 1, 4, 4) T_instrument_base in the second to last labelled place
    places             labels (G) of the places; none where there is one
    anchors            (w, 3) fixed points in K_0 that distances are measured to, m
    planes             (G, 4) unit normals in K_0 and distances from its origin, m, of probed planes
    spheres            (G, 4) centres in K_0 and radii of probed spheres, m
    T_base2_flange2    (G, 4, 4) poses of a second arm's flange in its base, one for each place
    T_flange2_sensor   (4, 4) pose of a sensor on that flange, m
    T_base_base2       (4, 4) pose of the second arm's base in K_0, m
    T_tool_camera      (4, 4) pose of a camera on the tool, m
    T_base_boards      (G, 4, 4) poses in K_0 of the boards that it sees, m
    T_tool_board       (4, 4) pose on the tool of a board that cameras beside the arm see, m
    T_base_cameras     (G, 4, 4) poses of these in K_0, m
    intrinsics         (9,) of the camera whose image corners are measured, see `kinds.projection`
    corners            (k, 3) of the board in its frame, m
    image_scale        (1,) length that a pixel has on the board, m
    From the anchors on they are None but for their kinds of observation.
    """

    T_instrument_base: Array
    targets: Array
    R_tool_sensor: Array | None = None
    frame_known: bool = True
    targets_known: bool = True
    further_frames: Array | None = None
    anchors: Array | None = None
    planes: Array | None = None
    spheres: Array | None = None
    T_base2_flange2: Array | None = None
    T_flange2_sensor: Array | None = None
    T_base_base2: Array | None = None
    T_tool_camera: Array | None = None
    T_base_boards: Array | None = None
    T_tool_board: Array | None = None
    T_base_cameras: Array | None = None
    intrinsics: Array | None = None
    corners: Array | None = None
    image_scale: Array | None = None
    places: tuple[str, ...] = ()

    @classmethod
    def unknown(cls, targets: Array, **arrays: Array) -> Self:
        """A set-up to be registered: targets (m, 3) and arrays of the kind, K_0 as the frame."""
        setup = cls(readonly(np.eye(4)), readonly(targets), frame_known=False, targets_known=False)
        of_kind: dict[str, Any] = {name: readonly(array) for name, array in arrays.items()}
        return replace(setup, **of_kind)

    @property
    def frames(self) -> Array:
        """T_instrument_base of every labelled place: (G, 4, 4)."""
        if self.further_frames is None:
            return self.T_instrument_base[None]
        return np.concatenate([self.T_instrument_base[None], self.further_frames])

    @property
    def known(self) -> bool:
        """Whether nothing of the set-up has to be estimated."""
        return self.frame_known and self.targets_known

    @cached_property
    def kind(self) -> Kind:
        """Kind of the observations."""
        for kind in KINDS.values():
            if kind.arrays and all(getattr(self, name) is not None for name in kind.arrays):
                return kind
        return KINDS["points"]

    @property
    def free_names(self) -> tuple[str, ...]:
        """Names of the free elements beside the first frame: target1.x …, sensor.rx …, base2.x …"""
        return self.kind.names(self)

    def with_read_parts(self, read: "Setup") -> "Setup":
        """The same with the poses of a second arm, which are read with the rows of `read`."""
        if self.kind.id != "second-arm" or read.kind is not self.kind:
            return self
        return replace(self, T_base2_flange2=read.T_base2_flange2, places=read.places)

    @property
    def arrays(self) -> dict[str, Array]:
        """Arrays of the tool beside the targets that this kind has, by name, such as (3, 3)."""
        return {name: getattr(self, name) for name in self.kind.arrays}


def determines_orientation(targets: Array) -> bool:
    """Whether target points (m, 3) are at least three and not on one line."""
    if len(targets) < 3:
        return False
    extents = np.linalg.svd(targets - targets.mean(axis=0), compute_uv=False)
    return bool(extents[1] > _COLLINEAR * extents[0])


def check_targets(targets: Array, place: str) -> None:
    """Raises InputError when three or more targets (m, 3) lie on one line, or two coincide."""
    if len(targets) >= 3 and not determines_orientation(targets):
        raise InputError(
            f"{place}: the {len(targets)} target points are collinear, so the turn about their "
            "line stays unseen; move one off the line, or use one target (position only)"
        )
    for i, point in enumerate(targets):
        near = np.linalg.norm(targets[i + 1 :] - point, axis=-1) < 1e-6
        if near.any():
            raise InputError(
                f"{place}: targets {i + 1} and {i + 2 + int(np.argmax(near))} are the same point"
            )
