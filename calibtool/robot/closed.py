"""A mechanism with closed loops as a function of its actuated joints: Newton's method on closure,
then the kinematics of its tree (docs/closed-loops.md).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import pinocchio as pin

from calibtool.robot.closure import Closure, closure
from calibtool.robot.continuation import At, Closing, Starts, advanced, newton, solved
from calibtool.robot.loops import Tree
from calibtool.robot.mechanism import Bodies, Frames, Mechanism, columns_of, joint_rows, poses_of
from calibtool.robot.screw_joint import Screw
from calibtool.robot.se3 import Array, exp6, readonly, translation
from calibtool.robot.singularity import at_point

_STEPS = 3, 12  # of the way from a start to rows that Newton does not reach at once
_TOGETHER = 1024  # rows: their numbers stay in the processor's cache


@dataclass(frozen=True, eq=False)
class ClosedMechanism(Mechanism):
    """A tree of joints with closed loops, nominal or with errors, as a function of its n actuated
    joints.

    For q the passive joints solve r(q, θ_p) = 0 (`closure`), on the assembly mode of the
    description. A row without a solution is NaN in every result; `closes` tells which rows have
    one. The result of a row does not depend on other rows.

    placements  (J + 2L + 1, 4, 4): M_i of the joints, poses of the cut frames A, B of every loop on
                their joints, and of the tool; (N, …) where they change from row to row
    offsets     (n,) δq of the actuated joints, rad or m; a passive joint has none
    screws      (J) the joints, in the numbering of `tree`
    tree        how the joints are connected
    starts      closed configurations of the nominal mechanism, from which Newton's method starts;
                computed at first use
    """

    tree: Tree
    starts: Callable[[], Starts]

    @classmethod
    def closing(
        cls,
        bodies: Bodies,
        placements: Array,
        twists: Array,
        offsets: Array | None,
        tree: Tree,
        starts: Callable[[], Starts],
    ) -> Self:
        """The mechanism of placements (J + 2L + 1, 4, 4), twists (J, 6), offsets (n,) or zero."""
        screws = tuple(Screw.of(twist) for twist in twists)
        model = pin.Model()
        model.name = bodies.robot
        model.gravity = pin.Motion(bodies.gravity, np.zeros(3))
        ids, backs = {-1: 0}, {-1: np.eye(4)}
        for j in tree.order:
            screw, parent = screws[j], tree.parents[j]
            there = pin.SE3(backs[parent] @ placements[j] @ translation(screw.shift))
            ids[j] = model.addJoint(ids[parent], screw.joint, there, bodies.joints[j])
            backs[j] = translation(-screw.shift)
            model.appendBodyToJoint(ids[j], bodies.inertias[j], pin.SE3(backs[j]))
        names = [f"{loop.name}.{side}" for loop in tree.loops for side in "ab"] + [bodies.tool]
        carriers = (*tree.carriers, tree.tool)
        for name, carrier, placement in zip(
            names, carriers, placements[tree.joints :], strict=True
        ):
            there = pin.SE3(backs[carrier] @ placement)
            frame = pin.Frame(name, ids[carrier], 0, there, pin.FrameType.OP_FRAME)
            model.addFrame(frame, False)
        offsets = readonly(np.zeros(tree.n) if offsets is None else offsets)
        return cls(model, readonly(placements), offsets, screws, tree, starts)

    # --- answers ---

    def forward(self, q: Array) -> Array:
        """T_base_tool for q (N, n) in rad or m: (N, 4, 4), NaN for a row that does not close."""
        pose = np.empty((len(q), 4, 4))
        for rows, closed in self._parts(q):
            pose[rows] = self._tool(closed)
        return pose

    def forward_and_jacobian(self, q: Array) -> tuple[Array, Array]:
        """T_base_tool (N, 4, 4) and the spatial Jacobian of the closed mechanism (N, 6, n) in K_0.

        J = J_a − J_p C_p⁻¹ C_a, J the columns of the tree at the tool. NaN for a row that does not
        close.
        """
        tree, n = self.tree, self.tree.n
        pose, jacobian = np.empty((len(q), 4, 4)), np.empty((len(q), 6, n))
        for rows, closed in self._parts(q):
            pose[rows] = self._tool(closed)
            at_tool = self._at_tool(closed.jacobian)
            passive = at_tool[:, :, tree.passive] @ closed.follow
            jacobian[rows] = np.where(closed.ok[:, None, None], at_tool[:, :, :n] + passive, np.nan)
        return pose, jacobian

    def frames(self, q: Array) -> Frames:
        """Every frame for q (N, n), and the effect of its twist on the tool (`Frames.transfer`).

        NaN for rows that do not close. With Λ = J_p C_p⁻¹ and K_ℓ = Λ_ℓ W_ℓ the transfer is H_i =
        s_tool(i) I − Σ_ℓ σ_ℓ(i) K_ℓ for a joint, K_ℓ for the cut frame A and −K_ℓ for B, and I for
        the tool.
        """
        tree = self.tree
        parts = []
        for rows, closed in self._parts(q):
            theta = np.where(closed.ok[:, None], closed.theta, np.nan)
            driven, numbers = self._coordinates(theta), np.arange(len(q))[rows]
            ends, jacobian, after = self._driven(driven, numbers, joints=True)
            equations = closure(tree, ends[:, :-1], jacobian, theta)
            influence = self._influence(jacobian, equations)
            parts.append(
                (
                    poses_of(after),
                    poses_of(ends),
                    self._transfer(influence, equations),
                    self._at_tool(jacobian)[:, :, : tree.n]
                    - influence @ equations.columns[:, :, : tree.n],
                )
            )
        after, ends, transfer, slopes = (np.concatenate(each) for each in zip(*parts, strict=True))
        for j, screw in enumerate(self.screws):
            if screw.shift.any():
                after[:, j, :3, 3] -= after[:, j, :3, :3] @ screw.shift
        before = np.empty_like(after)
        for j, parent in enumerate(tree.parents):
            placement = self.placements[..., j, :, :]
            before[:, j] = placement if parent < 0 else after[:, parent] @ placement
        return Frames(before, after, ends[:, -1], ends[:, :-1], transfer, slopes)

    def closes(self, q: Array) -> np.ndarray:
        """Which rows of q (N, n) the loops close for: (N,) bool."""
        return np.asarray(np.isfinite(self.joints(q)).all(axis=-1))

    def passive_within(self, q: Array) -> np.ndarray:
        """Which rows of q (N, n) close with the passive joints inside their limits: (N,) bool."""
        theta, rows = self.joints(q), self.tree.passive
        within = (theta >= self.tree.lower - 1e-9) & (theta <= self.tree.upper + 1e-9)
        return np.asarray((within & np.isfinite(theta))[:, rows].all(axis=-1))

    def gain(self, pose: Array, jacobian: Array) -> Array:
        """Size of J (N,), at the tool point and in rad. It grows without bound towards a
        singularity of the passive joints (type 2).

        pose (N, 4, 4) and jacobian (N, 6, n) as of `forward_and_jacobian`.
        """
        scaled = at_point(jacobian, pose[:, :3, 3]) * self.tree.joint_scale[: self.tree.n]
        scaled[:, :3] /= self.tree.length
        size: Array = np.sqrt((scaled**2).sum(axis=(1, 2)))
        return size

    def joints(self, q: Array) -> Array:
        """Positions of all joints (N, J) for q (N, n), rad or m; NaN for rows that do not close."""
        theta = np.empty((len(q), self.tree.joints))
        for rows, closed in self._parts(q):
            theta[rows] = np.where(closed.ok[:, None], closed.theta, np.nan)
        return theta

    def slopes(self, q: Array) -> Array:
        """∂θ/∂q (N, J, n) of all joints by the actuated ones; NaN for rows that do not close."""
        tree = self.tree
        result = np.zeros((len(q), tree.joints, tree.n))
        result[:, : tree.n] = np.eye(tree.n)
        for rows, closed in self._parts(q):
            result[rows, tree.passive] = np.where(closed.ok[:, None, None], closed.follow, np.nan)
        return result

    def by_actuators(self, torques: Array, q: Array) -> Array:
        """Torques (N, n) of the actuators for those of the model's joints (N, nv): (∂θ/∂q)ᵀ τ."""
        work: Array = np.einsum("njk,nj->nk", self.slopes(q), torques[:, self.model_joints])
        return work

    def configuration(self, q: Array) -> Array:
        """Coordinates of `model` for actuated positions q (N, n) in rad or m: (N, nq)."""
        return self._coordinates(self.joints(q))

    def as_model(self, lower: Array, upper: Array) -> pin.Model:
        """A copy of the tree's Pinocchio model with limits (n,) of the actuated joints."""
        model = self.model.copy()
        limits = np.stack([self.tree.lower, self.tree.upper])
        limits[:, : self.tree.n] = lower, upper
        limits[:, : self.tree.n] += self.offsets
        model.lowerPositionLimit, model.upperPositionLimit = self._coordinates(limits)
        return model

    # --- closure ---

    def _parts(self, q: Array) -> Iterator[tuple[slice, Closing]]:
        """Rows some at a time, closed: from the nearest start at once, or in steps."""
        starts, q = self.starts(), joint_rows(q, self.tree.n)
        for first in range(0, max(len(q), 1), _TOGETHER):
            rows = slice(first, min(first + _TOGETHER, len(q)))
            numbers = np.arange(rows.start, rows.stop)
            moved = q[rows] + self.offsets
            begin, near = starts.nearest(moved)
            sign, reach = starts.sign, starts.reach(begin, near)
            closed = newton(self.equations, self.tree, near, numbers, reach, sign)
            for steps in _STEPS:
                again = np.flatnonzero(~closed.ok)
                if len(again):
                    way = begin[again], moved[again], numbers[again]
                    closed.put(again, advanced(self.equations, self.tree, *way, steps, sign))
            yield rows, closed

    def equations(self, theta: Array, rows: np.ndarray) -> At:
        """Cut frames and tool (k, 2L + 1, 4, 3), columns of the joints (k, J, 6), and equations of
        some of the rows of
        θ (N, J), numbered rows (N,), for other positions (k, p) of the passive joints.
        """
        tree, coordinates = self.tree, self._coordinates(theta)

        def at(some: np.ndarray, passive: Array) -> tuple[Array, Array, Closure]:
            moved, driven = theta[some], coordinates[some]
            moved[:, tree.passive] = passive
            driven[:, self._passive_coordinates] = passive
            ends, jacobian, _ = self._driven(driven, rows[some])
            return ends, jacobian, closure(tree, ends[:, :-1], jacobian, moved)

        return at

    def _tool(self, closed: Closing) -> Array:
        """T_base_tool after the last step of the passive joints, whose square is negligible."""
        tree = self.tree
        ends = poses_of(closed.ends[:, -1])
        at_tool = self._at_tool(closed.jacobian)[:, :, tree.passive]
        twist = (at_tool @ closed.last[..., None])[..., 0]
        pose = exp6(twist) @ ends
        pose[~closed.ok] = np.nan
        return pose

    def _at_tool(self, jacobian: Array) -> Array:
        """Columns of the tree at the tool (N, 6, J) from those of all joints (N, J, 6)."""
        return np.swapaxes(jacobian * self.tree.tool_support[:, None], 1, 2)

    def _influence(self, jacobian: Array, equations: Closure) -> Array:
        """Λ = J_p C_p⁻¹, the effect of an open equation on the tool: (N, 6, p)."""
        passive = self.tree.passive
        C_p, at_tool = equations.columns[:, :, passive], self._at_tool(jacobian)[:, :, passive]
        return np.swapaxes(solved(np.swapaxes(C_p, 1, 2), np.swapaxes(at_tool, 1, 2)), 1, 2)

    def _transfer(self, influence: Array, equations: Closure) -> Array:
        """See `frames`: (N, J + 2L + 1, 6, 6)."""
        tree = self.tree
        count = len(influence)
        transfer = np.zeros((count, tree.joints + len(tree.carriers) + 1, 6, 6))
        transfer[:, : tree.joints] = tree.tool_support[:, None, None] * np.eye(6)
        transfer[:, -1] = np.eye(6)
        for k, rows in enumerate(tree.row_blocks):
            K = influence[:, :, rows] @ equations.twists[:, rows]
            for i in np.flatnonzero(tree.signs[k]):
                transfer[:, i] -= tree.signs[k, i] * K
            transfer[:, tree.joints + 2 * k], transfer[:, tree.joints + 2 * k + 1] = K, -K
        return transfer

    # --- the tree ---

    def _driven(
        self, coordinates: Array, rows: np.ndarray, joints: bool = False
    ) -> tuple[Array, Array, Array]:
        """Ends (N, 2L + 1, 4, 3), columns of the joints (N, J, 6) and, if asked, the joints' frames
        (N, J, 4, 3).

        coordinates (N, nq) of the model, rows (N,) their numbers.
        """
        model, count = self.model, len(coordinates)
        if self.placements.ndim == 4:
            model = model.copy()
        data = model.createData()
        frames, columns, moved = bytearray(), bytearray(), bytearray()
        of_frames, of_joints = columns_of(data.oMf)[1:], columns_of(data.oMi)[1:]
        jacobian = data.J.T.data
        move, place = pin.computeJointJacobians, pin.updateFramePlacements
        for k, row in enumerate(coordinates):
            if self.placements.ndim == 4:
                self._place(model, rows[k])
            move(model, data, row)
            place(model, data)
            frames += of_frames
            columns += jacobian
            if joints:
                moved += of_joints
        ends = np.frombuffer(frames).reshape(count, model.nframes - 1, 4, 3)
        per_coordinate = np.frombuffer(columns).reshape(count, model.nv, 6)
        after = np.frombuffer(moved).reshape(-1, model.njoints - 1, 4, 3)
        return ends, self._per_joint(per_coordinate), after[:, self.model_joints]

    def _place(self, model: pin.Model, row: int) -> None:
        """Give a model the placements of one row."""
        backs = {-1: np.eye(4)} | {j: translation(-s.shift) for j, s in enumerate(self.screws)}
        tree, placements = self.tree, self.placements[row]
        for j, screw in enumerate(self.screws):
            there = backs[tree.parents[j]] @ placements[j] @ translation(screw.shift)
            model.jointPlacements[int(self.model_joints[j]) + 1] = pin.SE3(there)
        for k, carrier in enumerate((*tree.carriers, tree.tool)):
            there = backs[carrier] @ placements[tree.joints + k]
            model.frames[k + 1].placement = pin.SE3(there)

    @cached_property
    def model_joints(self) -> np.ndarray:
        """Number of every joint in the model, from 0: (J,)."""
        return np.argsort(self.tree.order)

    def _coordinates(self, theta: Array) -> Array:
        """Coordinates of the model (N, nq) for positions of all joints (N, J)."""
        order = self.tree.order
        if self._rates is not None:
            return theta[:, order] * self._rates[order]
        return np.concatenate([self.screws[j].coordinates(theta[:, j]) for j in order], axis=-1)

    @cached_property
    def _passive_coordinates(self) -> list[int]:
        """Indices of the passive joints, of one coordinate of rate 1 each, in the model."""
        joints = range(self.tree.joints)[self.tree.passive]
        return [self.model.joints[int(self.model_joints[j]) + 1].idx_q for j in joints]

    def _per_joint(self, jacobians: Array) -> Array:
        """Columns per coordinate of the model (N, nv, 6) → per joint (N, J, 6)."""
        if self._rates is not None:
            found: Array = jacobians[:, self.model_joints]
            return found if (self._rates == 1.0).all() else found * self._rates[:, None]
        result = np.empty((len(jacobians), self.tree.joints, 6))
        for j, screw in enumerate(self.screws):
            start = self.model.joints[int(self.model_joints[j]) + 1].idx_v
            result[:, j] = screw.rates @ jacobians[:, start : start + len(screw.rates)]
        return result

    def at_row(self, row: int) -> Self:
        """The mechanism of one row, for any joint positions."""
        model = self.model.copy()
        self._place(model, row)
        return replace(self, model=model, placements=readonly(self.placements[row]))
