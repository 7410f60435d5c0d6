"""A network trained on a calibration's exact corrections, which controllers of closed loops
evaluate.

A controller would otherwise need Newton's method and a table of closed configurations. The
corrections are a smooth function of the joints, and a small network approximates them to within the
remaining error of the calibration itself.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from calibtool.calibration import Calibration
from calibtool.compensation.exact import exact
from calibtool.compensation.status import CORRECTED
from calibtool.compensation.weighted_error import Task
from calibtool.equivalent.loss import task_loss
from calibtool.equivalent.network import Network
from calibtool.equivalent.optimisers import LM_STOPPING, levenberg_marquardt, run
from calibtool.errors import NoSolutionError
from calibtool.export.taught_region import TaughtRegion
from calibtool.measurement.sampling import sample_configurations
from calibtool.robot.se3 import Array, pose_difference
from calibtool.robot.singularity import weighted_jacobian

HIDDEN = 24
_TAUGHT, _JUDGED = 1500, 500  # configurations
_ANYWHERE = 20_000  # configurations of the whole region on which nothing may become worse
LEAST_PART = 0.9  # of the configurations that must be in the region of the network
LARGEST_PART = 0.1  # of the rms error that is corrected: a network that leaves more is refused


@dataclass(frozen=True, eq=False)
class Taught:
    """N(q) ≈ q_m − q of `compensation.exact`, for joints in the region of its training.

    network      of n outputs, rad or m
    region       configurations in which it may be used
    before, exact, after  largest errors of the task components on other configurations: as
                 commanded, exactly corrected, corrected by the network; mm and mrad each
    mean         mean errors of the same, mm and mrad each
    """

    network: Network
    region: TaughtRegion
    before: tuple[float, float]
    exact: tuple[float, float]
    after: tuple[float, float]
    mean: tuple[float, float]

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Train a network over the default workspace of the robot.

        The loss is the weighted error of the task components, |A (N − Δ)|². Raises NoSolutionError
        where the largest error that it leaves is more than LARGEST_PART of the rms error to be
        corrected, or where less than LEAST_PART of the configurations are in a region in which
        nothing becomes worse.
        """
        robot, rng = calibration.robot, np.random.default_rng(0)
        workspace = robot.workspace()
        drawn = sample_configurations(robot, workspace, _TAUGHT + _JUDGED, rng)
        commanded = robot.mechanism.forward(drawn)
        result = exact(calibration, drawn, commanded)
        kept = np.isin(result.status, CORRECTED)
        q, poses, change = drawn[kept], commanded[kept], (result.q - drawn)[kept]
        known = np.arange(len(q)) < len(q) * _TAUGHT // (_TAUGHT + _JUDGED)
        task = Task.of(calibration.equivalent)

        def error(rows: np.ndarray, moved: Array) -> Array:
            pose = calibration.forward(q[rows] + moved)
            return pose_difference(pose, poses[rows], robot.length)

        pose, jacobian = calibration.forward_and_jacobian(q[known])
        A = weighted_jacobian(jacobian[:, :, : robot.n], pose, robot.length)
        A = task.of_jacobian(A, poses[known])
        loss = task_loss(q[known], A, (A @ change[known, :, None])[..., 0])
        scale = np.maximum(np.sqrt(np.mean(change[known] ** 2, axis=0)), 1e-12)
        start = Network.initial(q[known], scale, HIDDEN, rng)
        network, _ = run(levenberg_marquardt, start, loss, None, LM_STOPPING)
        assert isinstance(network, Network)
        rest = ~known
        sizes = [
            _sizes(robot.length, task, error(rest, moved), poses[rest])
            for moved in (np.zeros(change[rest].shape), change[rest], network(q[rest]))
        ]
        before, done, after = (_pair(each.max(axis=0)) for each in sizes)
        weighted = [np.linalg.norm(each / [robot.length * 1e3, 1e3], axis=-1) for each in sizes]
        largest = LARGEST_PART * float(np.sqrt(np.mean(weighted[0] ** 2)))
        remedy = "make the default workspace smaller, or use json"
        if weighted[2].max() > largest:
            raise NoSolutionError(
                f"{robot.name}: a network of {HIDDEN} nodes leaves {after[0]:.3g} mm and "
                f"{after[1]:.3g} mrad of {before[0]:.3g} mm and {before[1]:.3g} mrad, more than "
                f"{LARGEST_PART * 100:g} %: {remedy}"
            )
        region = TaughtRegion.of(robot, q[known], network)
        worse = _worse(calibration, task, network, region, largest)
        bounded = region.axes is not None
        region = region.without(worse) if bounded else region
        if (len(worse) and not bounded) or region.holds(q).mean() < LEAST_PART:
            raise NoSolutionError(
                f"{robot.name}: a network of {HIDDEN} nodes makes poses in the taught range of "
                f"the joints worse: {remedy}"
            )
        return cls(
            network=network,
            region=region,
            before=before,
            exact=done,
            after=after,
            mean=_pair(sizes[2].mean(axis=0)),
        )


def _worse(
    calibration: Calibration, task: Task, network: Network, region: TaughtRegion, largest: float
) -> Array:
    """Of configurations that are drawn in the region, those (k, n) that the loops do not close
    for, or that have an error of the task components larger with the network than without it, and
    than `largest` (weighted, mm)."""
    robot = calibration.robot
    q = region.drawn(_ANYWHERE, np.random.default_rng(1))
    commanded, sizes = robot.mechanism.forward(q), []
    for moved in (np.zeros(q.shape), network(q)):
        error = pose_difference(calibration.forward(q + moved), commanded, robot.length)
        sizes.append(np.linalg.norm(task.of_error(error, commanded), axis=-1) * 1e3)
    return np.asarray(q[~(sizes[1] <= np.maximum(sizes[0], largest))])


def _sizes(length: float, task: Task, error: Array, commanded: Array) -> Array:
    """Position (mm) and rotation (mrad) of the task components of weighted errors: (N, 2)."""
    components = np.arange(6) if task.components is None else np.array(task.components)
    own = task.of_error(error, commanded)
    parts = own[:, components < 3] * length, own[:, components >= 3]
    return np.stack([np.linalg.norm(part, axis=-1) * 1e3 for part in parts], axis=-1)


def _pair(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])
