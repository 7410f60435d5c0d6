"""The parameters of the complete model as one vector: which errors, in which order, and their columns (METHOD §7)."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from calibtool.identification.columns import offset_columns, placement_columns, twist_columns
from calibtool.measurement.measurements import Setup
from calibtool.measurement.registration import update_setup
from calibtool.robot.geometry import GeometricErrors
from calibtool.robot.mechanism import Frames
from calibtool.robot.model import Robot
from calibtool.robot.motion import JointMotion, gravity_torque, harmonic_functions, largest_torque, load_carrying
from calibtool.robot.se3 import Array, readonly

LOW_ORDERS = 3  # harmonics of a joint that eccentric gears have
COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations that the errors are expected to have, SI; those of single joints override the rest.

    length, angle  elements of δζ, δξ, δq: m and rad
    harmonic       each coefficient of a joint's harmonics, rad
    gravity        wind-up of a load-carrying joint at its largest static torque, rad
    backlash       half width, rad (m if prismatic: the same figure)
    joints         (joint from 0, length, angle)
    """

    length: float = 1e-3
    angle: float = 1e-3
    harmonic: float = 0.3e-3
    gravity: float = 1e-3
    backlash: float = 0.2e-3
    joints: tuple[tuple[int, float, float], ...] = ()

    @classmethod
    def of(cls, robot: Robot) -> Self:
        """The tolerances in a robot's description."""
        table = robot.source.description.tolerances
        return cls(
            length=table.length_mm * 1e-3,
            angle=table.angle_mrad * 1e-3,
            harmonic=table.harmonic_mrad * 1e-3,
            gravity=table.gravity_mrad * 1e-3,
            backlash=table.backlash_mrad * 1e-3,
            joints=tuple((int(j[1:]) - 1, t.length_mm * 1e-3, t.angle_mrad * 1e-3) for j, t in table.joints.items()),
        )


# Unknown instrument frames and targets are as good as free beside their registration: 1 m, 1 rad.
_FREE = 1.0


@dataclass(frozen=True)
class Parameters:
    """θ = (δζ, δξ, δq, harmonics, gravity, backlash, base, targets).

    n          joints
    twists     δξ is among them
    harmonics  orders per revolute joint
    revolute   joints with harmonics
    gravity    joints with a wind-up under gravity
    frame_free an unknown instrument frame: a twist of K_0
    targets    free target coordinates (and sensor orientation), 0 where they are known
    backlash   joints with a half width
    """

    n: int
    twists: bool
    harmonics: int
    revolute: tuple[int, ...]
    gravity: tuple[int, ...]
    frame_free: bool
    targets: int
    backlash: tuple[int, ...] = ()

    @classmethod
    def of(
        cls, robot: Robot, setup: Setup, twists: bool, harmonics: int, gravity: bool, backlash: bool = False
    ) -> Self:
        """The parameters of a robot in a set-up."""
        free = 0 if setup.targets_known else 3 * len(setup.targets) + 3 * (setup.R_tool_sensor is not None)
        return cls(
            n=robot.n,
            twists=twists,
            harmonics=harmonics,
            revolute=tuple(j for j, prismatic in enumerate(robot.prismatic) if not prismatic),
            gravity=tuple(int(j) for j in np.flatnonzero(load_carrying(robot))) if gravity else (),
            frame_free=not setup.frame_known,
            targets=free,
            backlash=tuple(range(robot.n)) if backlash else (),
        )

    @cached_property
    def blocks(self) -> dict[str, slice]:
        """Where each family stands in the vector."""
        sizes = {
            "placements": 6 * (self.n + 1),
            "twists": 6 * self.n * self.twists,
            "offsets": self.n,
            "harmonics": 2 * self.harmonics * len(self.revolute),
            "gravity": len(self.gravity),
            "backlash": len(self.backlash),
            "base": 6 * self.frame_free,
            "targets": self.targets,
        }
        ends = np.cumsum(list(sizes.values()))
        return {name: slice(int(end) - size, int(end)) for (name, size), end in zip(sizes.items(), ends, strict=True)}

    @cached_property
    def families(self) -> list[np.ndarray]:
        """Indices that share a tolerance: lengths and angles of δζ, of δξ; offsets, gravity, backlash; harmonics.

        A gear's first orders are often large, and say nothing about how fine the rest is.
        """
        result = []
        for name in ("placements", "twists"):
            index = np.arange(self.blocks[name].start, self.blocks[name].stop).reshape(-1, 6)
            result += [index[:, :3].ravel(), index[:, 3:].ravel()]
        result += [
            np.arange(self.blocks[name].start, self.blocks[name].stop) for name in ("offsets", "gravity", "backlash")
        ]
        harmonics = np.arange(self.blocks["harmonics"].start, self.blocks["harmonics"].stop)
        low = np.arange(len(harmonics)) // 2 % max(self.harmonics, 1) < LOW_ORDERS
        result += [harmonics[low], harmonics[~low]]
        return [family for family in result if len(family)]

    @property
    def count(self) -> int:
        """Number of parameters."""
        return int(self.blocks["targets"].stop)

    @cached_property
    def names(self) -> list[str]:
        """One name per parameter: ζ3.x, ξ2.rz, q1, sin2q4, gravity2, backlash1, base.x, target1.z."""
        names = [f"ζ{j + 1}.{c}" for j in range(self.n + 1) for c in COMPONENTS]
        names += [f"ξ{j + 1}.{c}" for j in range(self.n) for c in COMPONENTS] if self.twists else []
        names += [f"q{j + 1}" for j in range(self.n)]
        for j in self.revolute:
            for h in range(1, self.harmonics + 1):
                order = "" if h == 1 else str(h)
                names += [f"sin{order}q{j + 1}", f"cos{order}q{j + 1}"]
        names += [f"gravity{j + 1}" for j in self.gravity]
        names += [f"backlash{j + 1}" for j in self.backlash]
        names += [f"base.{c}" for c in COMPONENTS] if self.frame_free else []
        points = self.targets // 3
        names += [f"target{i + 1}.{c}" for i in range(points) for c in COMPONENTS[:3]]
        return names

    def missing_in(self, other: Self) -> np.ndarray:
        """Indices (k,) of the parameters that `other` does not have."""
        kept = set(other.names)
        return np.array([i for i, name in enumerate(self.names) if name not in kept], dtype=int)

    def prior_std(self, robot: Robot, tolerances: Tolerances) -> Array:
        """Prior standard deviation of every parameter (p,), SI; gravity as compliance in rad per N m."""
        length, angle = np.full(self.n + 1, tolerances.length), np.full(self.n + 1, tolerances.angle)
        for joint, joint_length, joint_angle in tolerances.joints:
            length[joint], angle[joint] = joint_length, joint_angle
        elements = np.repeat(np.stack([length, angle], axis=-1), 3, axis=-1)
        offsets = np.where(robot.prismatic, length[: self.n], angle[: self.n])
        gravity = tolerances.gravity / largest_torque(robot)[list(self.gravity)]
        parts: list[Array] = [
            elements.ravel(),
            elements[: self.n].ravel() if self.twists else np.zeros(0),
            offsets,
            np.full(2 * self.harmonics * len(self.revolute), tolerances.harmonic),
            gravity,
            np.full(len(self.backlash), tolerances.backlash),
            np.full(6 * self.frame_free + self.targets, _FREE),
        ]
        return np.concatenate(parts)

    def constant_columns(
        self, robot: Robot, state: "ErrorState", frames: Frames, q: Array, direction: Array | None = None
    ) -> Array:
        """∂δy/∂θ without harmonics and targets at the frames of the state; q, direction (N, n) commanded. (N, 6, ·)"""
        moved = q + state.motion.errors(robot, q, direction) + state.geometry.offsets
        twists = robot.chain.twists + state.geometry.twists
        offsets = offset_columns(frames, twists)
        blocks = [placement_columns(frames)]
        if self.twists:
            blocks.append(twist_columns(frames, twists, moved))
        blocks.append(offsets)
        if self.gravity:
            loaded = list(self.gravity)
            blocks.append(-offsets[:, :, loaded] * gravity_torque(robot, q)[:, None, loaded])
        if self.backlash:
            signs = np.zeros_like(q) if direction is None else direction
            joints = list(self.backlash)
            blocks.append(-offsets[:, :, joints] * signs[:, None, joints])
        if self.frame_free:
            blocks.append(np.broadcast_to(np.eye(6), (len(q), 6, 6)))
        return np.concatenate(blocks, axis=-1)

    def pose_columns(
        self, robot: Robot, state: "ErrorState", frames: Frames, q: Array, direction: Array | None = None
    ) -> Array:
        """∂δy/∂θ without the targets (N, 6, p − targets), at the frames of the state; q, direction (N, n) commanded."""
        constant = self.constant_columns(robot, state, frames, q, direction)
        if not self.harmonics:
            return constant
        revolute = list(self.revolute)
        offsets = constant[:, :, self.blocks["offsets"]][:, :, revolute, None]
        functions = harmonic_functions(q[:, revolute], self.harmonics)[:, None]
        harmonics = (offsets * functions).reshape(len(q), 6, -1)
        return np.insert(constant, [self.blocks["harmonics"].start] * harmonics.shape[-1], harmonics, axis=-1)


@dataclass(frozen=True, eq=False)
class ErrorState:
    """Where an iteration stands: geometric errors, joint motions and the set-up."""

    geometry: GeometricErrors
    motion: JointMotion
    setup: Setup

    @classmethod
    def nominal(cls, robot: Robot, setup: Setup) -> Self:
        """No errors in a set-up."""
        return cls(GeometricErrors.none(robot.n), JointMotion.none(robot.n), setup)

    def frames(self, robot: Robot, q: Array, direction: Array | None = None) -> Frames:
        """Frames of the robot with these errors for commanded q (N, n), each joint last moved in `direction` (N, n)."""
        return self.geometry.frames(robot.chain, q + self.motion.errors(robot, q, direction))

    def vector(self, parameters: Parameters) -> Array:
        """θ as the prior sees it (p,); zero for base and targets, whose prior moves along."""
        harmonics = np.zeros((parameters.n, 2 * parameters.harmonics))
        harmonics[:, : self.motion.harmonics.shape[1]] = self.motion.harmonics
        return np.concatenate(
            [
                self.geometry.placements.ravel(),
                self.geometry.twists.ravel() if parameters.twists else [],
                self.geometry.offsets,
                harmonics[list(parameters.revolute)].ravel(),
                self.motion.compliance[list(parameters.gravity)],
                self.motion.backlash[list(parameters.backlash)],
                np.zeros(6 * parameters.frame_free + parameters.targets),
            ]
        )

    def moved(self, parameters: Parameters, step: Array) -> Self:
        """The state after a step of the parameters (p,)."""
        part = {name: step[block] for name, block in parameters.blocks.items()}
        geometry = self.geometry.moved_placements(part["placements"].reshape(-1, 6))
        geometry = GeometricErrors(
            geometry.placements,
            readonly(geometry.twists + part["twists"].reshape(-1, 6)) if parameters.twists else geometry.twists,
            readonly(geometry.offsets + part["offsets"]),
        )
        harmonics = np.zeros((parameters.n, 2 * parameters.harmonics))
        harmonics[:, : self.motion.harmonics.shape[1]] = self.motion.harmonics
        if parameters.harmonics:
            harmonics[list(parameters.revolute)] += part["harmonics"].reshape(-1, 2 * parameters.harmonics)
        compliance = self.motion.compliance.copy()
        compliance[list(parameters.gravity)] += part["gravity"]
        backlash = self.motion.backlash.copy()
        backlash[list(parameters.backlash)] += part["backlash"]
        setup = update_setup(
            self.setup,
            part["base"] if parameters.frame_free else None,
            part["targets"] if parameters.targets else None,
        )
        motion = JointMotion(readonly(harmonics), readonly(compliance), readonly(backlash))
        return replace(self, geometry=geometry, motion=motion, setup=setup)
