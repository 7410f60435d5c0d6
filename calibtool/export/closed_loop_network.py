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
from calibtool.measurement.sampling import sample_configurations
from calibtool.robot.se3 import Array, pose_difference
from calibtool.robot.singularity import weighted_jacobian

HIDDEN = 24
_TAUGHT, _JUDGED = 1500, 500  # configurations
LARGEST_PART = 0.1  # of the rms error that is corrected: a network that leaves more is refused


@dataclass(frozen=True, eq=False)
class Taught:
    """N(q) ≈ q_m − q of `compensation.exact`, for joints inside the range of its training.

    network      of n outputs, rad or m
    lower, upper (n,) range of the joints in training, rad or m
    before, exact, after  largest errors of the task components on other configurations: as
                 commanded, exactly corrected, corrected by the network; mm and mrad each
    mean         mean errors of the same, mm and mrad each
    """

    network: Network
    lower: Array
    upper: Array
    before: tuple[float, float]
    exact: tuple[float, float]
    after: tuple[float, float]
    mean: tuple[float, float]

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Train a network over the default workspace of the robot.

        The loss is the weighted error of the task components, |A (N − Δ)|². Raises NoSolutionError
        where the largest error that it leaves is more than LARGEST_PART of the rms error to be
        corrected.
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
        if weighted[2].max() > LARGEST_PART * np.sqrt(np.mean(weighted[0] ** 2)):
            raise NoSolutionError(
                f"{robot.name}: a network of {HIDDEN} nodes leaves {after[0]:.3g} mm and "
                f"{after[1]:.3g} mrad of {before[0]:.3g} mm and {before[1]:.3g} mrad, more than "
                f"{LARGEST_PART * 100:g} %: make the default workspace smaller, or use json"
            )
        return cls(
            network=network,
            lower=q[known].min(axis=0),
            upper=q[known].max(axis=0),
            before=before,
            exact=done,
            after=after,
            mean=_pair(sizes[2].mean(axis=0)),
        )


def _sizes(length: float, task: Task, error: Array, commanded: Array) -> Array:
    """Position (mm) and rotation (mrad) of the task components of weighted errors: (N, 2)."""
    components = np.arange(6) if task.components is None else np.array(task.components)
    own = task.of_error(error, commanded)
    parts = own[:, components < 3] * length, own[:, components >= 3]
    return np.stack([np.linalg.norm(part, axis=-1) * 1e3 for part in parts], axis=-1)


def _pair(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])
