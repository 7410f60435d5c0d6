"""Constraints of a plan: every accepted configuration keeps them, checked by sampling
points of the arm.
"""

import numpy as np
import pytest

from calibtool.errors import NoSolutionError
from calibtool.measurement.sampling import sample_configurations
from calibtool.planning import constraints
from calibtool.planning.constraints import (
    Candidates,
    Constraints,
    Sight,
    crosses,
    draw_candidates,
    inside,
    links,
)
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import transform_points

BOX = (1.0, -3.0, -2.0, 3.0, -0.4, 3.0)


def draw(
    robot: Robot, kept: Constraints, count: int = 100, workspace: str | None = "full"
) -> Candidates:
    rng = np.random.default_rng(0)
    space = robot.workspace(workspace)
    return draw_candidates(robot, space, kept, robot.targets, count, 1, rng)


def arm_points(robot: Robot, q: np.ndarray, steps: int = 200) -> np.ndarray:
    """Points along the links, (N, k, 3)."""
    start, end = links(robot, robot.targets, q)
    part = np.linspace(0, 1, steps)[:, None, None]
    return (start[:, None] + part * (end - start)[:, None]).reshape(len(q), -1, 3)


def test_links_run_from_joint_to_joint_and_to_the_targets(fanuc: Robot) -> None:
    """The arm stretched along x: lengths of the description, heights in the plane of the base."""
    q = sample_configurations(fanuc, "full", 5, np.random.default_rng(1))
    start, end = links(fanuc, fanuc.targets, q)
    assert start.shape == end.shape == (5, 5 + 1 + 3, 3)
    pose = fanuc.mechanism.forward(q)
    assert np.allclose(end[:, 5], pose[:, :3, 3])
    assert np.allclose(end[:, 6:], transform_points(pose, fanuc.targets))
    lengths = np.linalg.norm(fanuc.chain.placements[1:6, :3, 3], axis=-1)
    assert np.allclose(np.linalg.norm((end - start)[:, :5], axis=-1), lengths)
    assert np.allclose(end[:, :4], start[:, 1:5])


def test_pieces_and_boxes() -> None:
    box = np.array([0.0, 0.0, 0.0, 1.0, 2.0, 3.0])
    rng = np.random.default_rng(0)
    start, end = rng.uniform(-2, 4, (2, 300, 3))
    points = start[:, None] + np.linspace(0, 1, 2000)[:, None] * (end - start)[:, None]
    sampled = ((points >= box[:3]) & (points <= box[3:])).all(axis=-1).any(axis=-1)
    found = crosses(start, end, box)
    assert (sampled <= found).all()
    assert (found != sampled).sum() <= 1  # a corner cut between two samples
    assert crosses(np.array([0.5, 1.0, 1.0]), np.array([0.5, 1.0, 1.0]), box)  # a point
    assert crosses(np.array([0.5, -1.0, 1.0]), np.array([0.5, 5.0, 1.0]), box)  # along an axis
    assert not crosses(np.array([1.5, -1.0, 1.0]), np.array([1.5, 5.0, 1.0]), box)


def test_floor_and_keep_out(fanuc: Robot) -> None:
    drawn = draw(fanuc, Constraints(floor=-1.0, keep_out=(BOX,), joint_margin=0.0))
    points = arm_points(fanuc, drawn.q)
    assert points[..., 2].min() >= -1.0 - 1e-12
    within = ((points > np.array(BOX[:3]) + 1e-9) & (points < np.array(BOX[3:]) - 1e-9)).all(
        axis=-1
    )
    assert not within.any()
    assert len(drawn.q) == 100
    free = arm_points(fanuc, draw(fanuc, Constraints()).q)
    assert free[..., 2].min() < -1.0  # the constraint was needed
    assert set(drawn.rejected) == {"--floor-mm", "--keep-out"}


def test_margins_and_singularities(fanuc: Robot) -> None:
    q = draw(fanuc, Constraints(joint_margin=0.1, singularity_distance=0.08)).q
    span = fanuc.upper - fanuc.lower
    assert (q >= fanuc.lower + 0.1 * span - 1e-9).all()
    assert (q <= fanuc.upper - 0.1 * span + 1e-9).all()
    assert fanuc.singularity_distance(q).min() >= 0.08


def test_every_target_looks_at_the_instrument(fanuc: Robot) -> None:
    instrument = np.array([6.0, 1.0, 0.5])
    wall = (4.0, 0.5, -5.0, 4.2, 5.0, 5.0)
    sight = Sight((6.0, 1.0, 0.5), (0.0, 0.6, 0.8), np.deg2rad(40))
    q = draw(fanuc, Constraints(sight=sight, keep_out=(wall,)), 50).q
    pose = fanuc.mechanism.forward(q)
    for target in fanuc.targets:
        point = (pose @ [*target, 1.0])[:, :3]
        ray = instrument - point
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        assert (
            np.degrees(np.arccos((ray * (pose[:, :3, :3] @ [0.0, 0.6, 0.8])).sum(axis=-1))).max()
            <= 40 + 1e-9
        )
        part = (4.1 - point[:, 0]) / (
            6.0 - point[:, 0]
        )  # where the ray meets the middle of the wall
        meets = (point + part[:, None] * (instrument - point))[(part > 0) & (part < 1)]
        assert not ((meets[:, 1] > 0.5) & (meets[:, 1] < 5) & (np.abs(meets[:, 2]) < 5)).any()


def test_impossible_constraints_are_named(fanuc: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(constraints, "_TRIES", 3)
    with pytest.raises(
        NoSolutionError, match=r"fanuc-m1000ia: 0 of 1500 .*--floor-mm turns down 1500: loosen"
    ):
        draw(fanuc, Constraints(floor=10.0))


def test_drawn_configurations_are_inside_their_workspace_and_others_are_not(robot: Robot) -> None:
    for name in robot.workspace_names:
        space = robot.workspace(name)
        q = sample_configurations(robot, space, 40, np.random.default_rng(2))
        assert inside(robot, space, q).all()
        if space.bounded:
            elsewhere = sample_configurations(robot, "full", 200, np.random.default_rng(3))
            assert inside(robot, space, elsewhere).mean() < 0.5
