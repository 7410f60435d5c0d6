"""A serial chain as a Pinocchio model, nominal or with errors."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from calibtool.errors import InputError
from calibtool.robot.screw_joint import Screw
from calibtool.robot.se3 import Array, readonly, translation


def joint_rows(q: ArrayLike, n: int) -> Array:
    """Joint positions as an array (N, n) of floats; InputError for another shape."""
    rows = np.asarray(q, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != n:
        raise InputError(
            f"joint positions have shape {rows.shape}; expected (N, {n}): a row of {n} joints for "
            "each configuration"
        )
    return rows


@dataclass(frozen=True, eq=False)
class Bodies:
    """Properties of a serial chain beside its geometry.

    robot, joints, tool   names of the robot, of its n joints and of its tool frame
    inertias              (n) of the links, in the frames of their joints
    gravity               (3,) m/s² in K_0
    """

    robot: str
    joints: tuple[str, ...]
    tool: str
    inertias: tuple[pin.Inertia, ...]
    gravity: Array


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of a chain in K_0 for N configurations, from which error columns are built.

    before    (N, n, 4, 4) F0_j, after M_j and before joint j moves
    after     (N, n, 4, 4) F_j, after joint j has moved
    tool      (N, 4, 4) T_base_tool
    cuts      (N, 2L, 4, 4) frames A and B of every closed loop; None without loops, as all that
              follow
    transfer  (N, n + 2L + 1, 6, 6) what a twist of everything beyond each of `placed` does to the
              tool; n counts all joints
    jacobian  (N, 6, n_a) of the tool by the actuated joints, which are the first ones
    """

    before: Array
    after: Array
    tool: Array
    cuts: Array | None = None
    transfer: Array | None = None
    jacobian: Array | None = None

    @property
    def placed(self) -> Array:
        """The frames of the placements (N, n + 2L + 1, 4, 4): before joints, cut frames, tool."""
        parts = [self.before, *([] if self.cuts is None else [self.cuts]), self.tool[:, None]]
        return np.concatenate(parts, axis=1)

    def links(self, placed_on: tuple[int, ...]) -> tuple[Array, Array]:
        """Straight parts from the joint of each of `placed` (−1: base) to it: ends (N, s, 3)
        each.
        """
        origins = np.concatenate(
            [np.zeros((len(self.tool), 1, 3)), self.after[:, :, :3, 3]], axis=1
        )
        return origins[:, np.array(placed_on) + 1], self.placed[:, :, :3, 3]

    def seen(self, twists: Array, joints: slice = slice(None)) -> Array:
        """Twists (N, k, 6, …) of the placed frames (`joints` of them), transferred to the tool."""
        return twists if self.transfer is None else self.transfer[:, joints] @ twists


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A serial chain T(q) = Π_j M_j exp(ξ_j (q_j + δq_j)) · M_{n+1} (Eq. 7), nominal or with
    errors.

    Pinocchio computes every row; the result of a row does not depend on other rows.

    model       the chain as a Pinocchio model; `configuration` turns joint positions into its
                coordinates
    placements  (n+1, 4, 4) M_j, the last one the tool's; (N, n+1, 4, 4) where they change from row
                to row: such a mechanism can only be used for its N rows
    offsets     (n,) δq_j in rad or m
    screws      (n) the joints of the model
    """

    model: pin.Model
    placements: Array
    offsets: Array
    screws: tuple[Screw, ...]

    @classmethod
    def of(
        cls, bodies: Bodies, placements: Array, twists: Array, offsets: Array | None = None
    ) -> Self:
        """The chain with M_j (n+1, 4, 4), ξ_j (n, 6) of any pitch, and δq_j (n,), zero unless
        given.
        """
        screws = tuple(Screw.of(twist) for twist in twists)
        model = pin.Model()
        model.name = bodies.robot
        model.gravity = pin.Motion(bodies.gravity, np.zeros(3))
        back = np.eye(4)  # from the model's frame of the joint before to the chain's
        parts = zip(screws, placements, bodies.joints, bodies.inertias, strict=False)
        for j, (screw, placement, name, inertia) in enumerate(parts):
            there = pin.SE3(back @ placement @ translation(screw.shift))
            new = model.addJoint(j, screw.joint, there, name)
            back = translation(-screw.shift)
            model.appendBodyToJoint(new, inertia, pin.SE3(back))
        tool = pin.SE3(back @ placements[-1])
        model.addFrame(pin.Frame(bodies.tool, len(screws), 0, tool, pin.FrameType.OP_FRAME), False)
        offsets = readonly(np.zeros(len(screws)) if offsets is None else offsets)
        return cls(model, readonly(placements), offsets, screws)

    def forward(self, q: Array) -> Array:
        """T_base_tool (N, 4, 4) for q (N, n), rad or m. Pinocchio's `framesForwardKinematics`."""
        model, data, rows = self._moving(q)
        tool, move = _columns_of(data.oMf[model.nframes - 1]), pin.framesForwardKinematics
        columns = bytearray()
        for row in rows:
            move(model, data, row)
            columns += tool
        return _poses(columns, len(q))

    def forward_and_jacobian(self, q: Array) -> tuple[Array, Array]:
        """T_base_tool (N, 4, 4) and the spatial Jacobian (N, 6, n) in K_0.

        The columns are ∂(δy)/∂q_j = Ad(F_j) ξ_j (Eq. 14). Pinocchio's `computeJointJacobians` and
        `updateFramePlacements`.
        """
        model, data, rows = self._moving(q)
        tool, jacobian = _columns_of(data.oMf[model.nframes - 1]), data.J.T.data
        move, place = pin.computeJointJacobians, pin.updateFramePlacements
        columns, jacobians = bytearray(), bytearray()
        for row in rows:
            move(model, data, row)
            place(model, data)
            columns += tool
            jacobians += jacobian
        per_coordinate = np.frombuffer(jacobians).reshape(len(q), model.nv, 6)
        return _poses(columns, len(q)), np.swapaxes(self._per_joint(per_coordinate), -1, -2)

    def frames(self, q: Array) -> Frames:
        """Frames of the chain for q (N, n), rad or m. Pinocchio's `framesForwardKinematics`."""
        n = len(self.screws)
        model, data, rows = self._moving(q)
        live = [_columns_of(data.oMi[j + 1]) for j in range(n)]
        live.append(_columns_of(data.oMf[model.nframes - 1]))
        columns = bytearray()
        for row in rows:
            pin.framesForwardKinematics(model, data, row)
            for frame in live:
                columns += frame
        poses = _poses(columns, len(q), n + 1)
        after, tool = poses[:, :n], poses[:, n]
        for j, screw in enumerate(self.screws):
            if screw.shift.any():
                after[:, j, :3, 3] -= after[:, j, :3, :3] @ screw.shift
        before = np.empty_like(after)
        before[:, 0] = self.placements[..., 0, :, :]
        before[:, 1:] = after[:, :-1] @ self.placements[..., 1:-1, :, :]
        return Frames(before, after, tool)

    def closes(self, q: Array) -> np.ndarray:
        """At which rows of q (N, n) the loops close: (N,) bool; all without loops."""
        return np.ones(len(q), dtype=bool)

    def configuration(self, q: Array) -> Array:
        """Coordinates of `model` for joint positions q (N, n) in rad or m: (N, nq)."""
        moved: Array = joint_rows(q, len(self.offsets)) + self.offsets
        if self._rates is not None:
            return moved * self._rates
        parts = [screw.coordinates(moved[:, j]) for j, screw in enumerate(self.screws)]
        return np.concatenate(parts, axis=-1)

    def at_row(self, row: int) -> Self:
        """The mechanism of one row, for any joint positions."""
        model = self.model.copy()
        _place(model, self._in_model()[row])
        return replace(self, model=model, placements=readonly(self.placements[row]))

    def _moving(self, q: Array) -> tuple[pin.Model, pin.Data, Iterable[Array]]:
        """A model, its data, and its coordinates row by row, with the placements of the row."""
        if self.placements.ndim == 3:
            return self.model, self.model.createData(), self.configuration(q)
        model = self.model.copy()
        return model, model.createData(), self._placed_rows(model, q)

    def _placed_rows(self, model: pin.Model, q: Array) -> Iterator[Array]:
        for row, there in zip(self.configuration(q), self._in_model(), strict=True):
            _place(model, there)
            yield row

    def _in_model(self) -> Array:
        """M_j as placements of the model's frames, which the screws shift against the chain's."""
        shifts = np.array([np.zeros(3), *(screw.shift for screw in self.screws)])
        there = self.placements.copy()
        there[..., :3, 3] -= shifts
        there[..., :-1, :3, 3] += (self.placements[..., :-1, :3, :3] @ shifts[1:, :, None])[..., 0]
        return there

    def as_model(self, lower: Array, upper: Array) -> pin.Model:
        """A copy of the Pinocchio model with joint limits (n,) in rad or m."""
        model = self.model.copy()
        model.lowerPositionLimit, model.upperPositionLimit = self.configuration(
            np.array([lower, upper])
        )
        return model

    def _per_joint(self, jacobians: Array) -> Array:
        """Columns per coordinate of the model (N, nv, 6) → per joint position (N, n, 6)."""
        if self._rates is not None:
            jacobians *= self._rates[:, None]
            return jacobians
        result = np.empty((len(jacobians), len(self.screws), 6))
        for j, screw in enumerate(self.screws):
            start = self.model.joints[j + 1].idx_v
            result[:, j] = screw.rates @ jacobians[:, start : start + len(screw.rates)]
        return result

    @cached_property
    def _rates(self) -> Array | None:
        """(n,) model coordinates per unit of the joints; None where a joint has several."""
        if any(len(screw.rates) > 1 for screw in self.screws):
            return None
        return readonly(np.concatenate([screw.rates for screw in self.screws]))


def _place(model: pin.Model, placements: Array) -> None:
    """Give a model other placements (n+1, 4, 4) of its joints and its tool."""
    for j, placement in enumerate(placements[:-1]):
        model.jointPlacements[j + 1] = pin.SE3(placement)
    model.frames[model.nframes - 1].placement = pin.SE3(placements[-1])


def _columns_of(frame: pin.SE3) -> memoryview:
    """Axes x, y, z and origin of a frame of Pinocchio's data (4, 3), which change with every row.

    Appending memory to a `bytearray` is the fastest way to keep the numbers of a row.
    """
    rotation, position = frame.rotation, frame.translation
    start, end = (array.__array_interface__["data"][0] for array in (rotation, position))
    if rotation.strides != (8, 24) or end - start != 72:
        raise RuntimeError("this Pinocchio stores poses in another way; install pin 3.4 to 4.x")
    return np.lib.stride_tricks.as_strided(rotation.T, (4, 3), (24, 8), writeable=False).data


def columns_of(frames: pin.StdVec_SE3) -> memoryview:
    """`_columns_of` all frames of Pinocchio's data (k, 4, 3), which stand one behind the other."""
    first = frames[0].rotation
    start, end = (frames[k].rotation.__array_interface__["data"][0] for k in (0, len(frames) - 1))
    if first.strides != (8, 24) or end - start != 96 * (len(frames) - 1):
        raise RuntimeError("this Pinocchio stores poses in another way; install pin 3.4 to 4.x")
    shape, strides = (len(frames), 4, 3), (96, 24, 8)
    return np.lib.stride_tricks.as_strided(first.T, shape, strides, writeable=False).data


def poses_of(columns: Array) -> Array:
    """Axes x, y, z and origin (…, 4, 3) as poses (…, 4, 4)."""
    poses = np.empty((*columns.shape[:-2], 4, 4))
    poses[..., :3, :] = np.swapaxes(columns, -1, -2)
    poses[..., 3, :] = (0.0, 0.0, 0.0, 1.0)
    return poses


def _poses(columns: bytearray, *shape: int) -> Array:
    """Axes x, y, z and origin of frames, one after the other, as poses (*shape, 4, 4)."""
    return poses_of(np.frombuffer(columns).reshape(*shape, 4, 3))
