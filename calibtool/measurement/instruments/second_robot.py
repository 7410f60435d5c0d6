"""A second arm of the same make, without errors, whose sensor sees a ball on the tool."""

import numpy as np

from calibtool.errors import NoSolutionError
from calibtool.measurement.instruments.cell import TIP, Cell, Observed
from calibtool.measurement.kinds import Readings
from calibtool.measurement.setup import Setup
from calibtool.robot.inverse import solve_poses
from calibtool.robot.se3 import Array, exp6, inverse, transform_points

# Twist of the sensor on the second flange, m and rad
_SENSOR = np.array([0.02, -0.03, 0.12, 0.2, -0.1, 0.5])
_SEEN = 0.05  # m: largest distance of the ball from the middle of the sensor
_APART = 0.9  # of the arm's length: distance of the two bases
_TRIES = 100


def second_arm(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """The second arm takes a new pose for every row, such that its sensor sees the tool."""
    robot = cell.robot
    cell.check_any_pose()
    T_base_base2 = exp6(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.5]))
    T_base_base2[:2, 3] = _APART * robot.length * np.array([0.8, 0.6])
    T_flange2_sensor = exp6(_SENSOR)
    found: list[tuple[Array, Array]] = []
    for _ in range(_TRIES):
        q = cell.sampled(count, rng)
        ball = transform_points(cell.actual.forward(q), TIP[None])[:, 0]
        sensor = exp6(np.concatenate([np.zeros((count, 3)), rng.normal(size=(count, 3))], -1))
        beside = rng.uniform(-_SEEN, _SEEN, (count, 3, 1))
        sensor[:, :3, 3] = ball - (sensor[:, :3, :3] @ beside)[..., 0]
        flange = inverse(T_base_base2) @ sensor @ inverse(T_flange2_sensor)
        start = robot.lower + (robot.upper - robot.lower) * rng.random((count, robot.n))
        solved = solve_poses(
            robot.mechanism.forward_and_jacobian,
            flange,
            np.clip(start, -np.pi, np.pi),
            length=robot.length,
            lower=robot.lower,
            upper=robot.upper,
            tolerance=1e-10,
        )
        found.append((q[solved.reached], robot.mechanism.forward(solved.q[solved.reached])))
        if sum(len(q) for q, _ in found) >= count:
            break
    else:
        raise NoSolutionError(f"{robot.name}: the second arm hardly reaches the first one's tool")
    q = np.concatenate([part for part, _ in found])[:count]
    flange = np.concatenate([part for _, part in found])[:count]
    seen = inverse(T_base_base2 @ flange @ T_flange2_sensor) @ cell.actual.forward(q)
    points = transform_points(seen, TIP[None])
    points = points + rng.normal(size=points.shape) * cell.noise
    setup = Setup.unknown(
        TIP[None],
        T_base2_flange2=flange,
        T_flange2_sensor=T_flange2_sensor,
        T_base_base2=T_base_base2,
    )
    names = tuple(str(k + 1) for k in range(count))
    return Observed(q, setup, Readings(points, place=np.arange(count)), names)
