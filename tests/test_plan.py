"""A plan as a whole: it keeps its promises, is reproducible, and beats random configurations."""

import numpy as np
import pytest

from calibtool.calibration import identify
from calibtool.joint_and_pose_columns import joints_from_header
from calibtool.measurement.checks.design import REPEATS
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.planning.constraints import Constraints, distinct, inside
from calibtool.planning.information import Knowledge
from calibtool.planning.joint_table import as_written, joint_table
from calibtool.planning.plan import Plan, make_plan
from calibtool.planning.selection import Criterion
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.tables import parse_table

NOISE = 0.05e-3


def planned(
    robot: Robot,
    count: int = 8,
    criterion: Criterion = "d",
    workspace: str | None = None,
    **options: bool,
) -> Plan:
    knowledge = Knowledge.of_tolerances(robot, NOISE)
    space = robot.workspace(workspace)
    constraints = Constraints(singularity_distance=0.05, joint_margin=0.02)
    rng = np.random.default_rng(0)
    return make_plan(
        knowledge,
        space,
        count,
        constraints=constraints,
        criterion=criterion,
        candidates=100,
        rng=rng,
        **options,
    )


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "scara", "gantry", "planar-3r", "panda"])
def test_it_keeps_workspace_and_constraints(name: str) -> None:
    robot = load_robot(name)
    made = planned(robot, 6)
    space = robot.workspace()
    assert made.q.shape == (6, robot.n)
    assert len(np.unique(made.q, axis=0)) == 6
    assert inside(robot, space, made.q).all()
    assert robot.singularity_distance(made.q).min() > 0.05 - 1e-6
    assert robot.within_limits(made.q).all()


def test_the_table_is_the_plan(robot: Robot) -> None:
    q = as_written(robot, sample_configurations(robot, "full", 5, np.random.default_rng(0)))
    read = joints_from_header(parse_table(joint_table(robot, q), "plan.csv"), robot)
    assert read is not None
    assert np.allclose(read[0], q, atol=1e-14)


@pytest.mark.parametrize("criterion", ["d", "i"])
def test_it_predicts_more_than_random_ones(fanuc: Robot, criterion: Criterion) -> None:
    for workspace in ("full", "machining"):
        made = planned(fanuc, 15, criterion, workspace, refine=False)
        assert made.selected.target.mean() < 0.8 * made.random.target.mean()
        assert made.selected.effective > 0.95 * made.random.effective
        assert made.before.effective == 0.0


def test_and_refinement_more_than_the_candidates(fanuc: Robot) -> None:
    rough, fine = (planned(fanuc, 6, workspace="full", refine=refine) for refine in (False, True))

    def volume(made: Plan) -> float:
        covariance = made.knowledge.after(made.knowledge.rows(made.q)).covariance
        return float(np.linalg.slogdet(covariance)[1])

    assert volume(fine) < volume(rough) - 1.0


@pytest.mark.parametrize("name", ["scara", "planar-3r", "so100"])
def test_a_plan_for_poses_predicts_better_poses_than_one_for_parameters(name: str) -> None:
    robot = load_robot(name)
    for_poses, for_parameters = (planned(robot, 10, criterion) for criterion in ("i", "d"))
    assert for_poses.selected.target.mean() < for_parameters.selected.target.mean()
    fresh = sample_configurations(robot, None, 200, np.random.default_rng(9))
    poses, parameters = (
        made.knowledge.after(made.knowledge.rows(made.q)).target_deviation(fresh)
        for made in (for_poses, for_parameters)
    )
    assert poses.mean() < parameters.mean()


def test_the_prediction_holds(fanuc: Robot) -> None:
    """Errors of an identification from 15 planned configurations, against 15 random ones, on
    the same robots.
    """
    made = planned(fanuc, 15, workspace="full", refine=False)
    errors: dict[str, list[float]] = {"planned": [], "random": []}
    for seed in range(2):
        random = simulate(fanuc, Simulation(seed=seed, configurations=15, workspace="full"))
        best = simulate(fanuc, Simulation(seed=seed, at=made.q, same_robot=random.truth))
        fresh = sample_configurations(fanuc, "full", 200, np.random.default_rng(seed))
        assert random.truth is not None
        actual = random.truth.actual.forward(fresh)[:, :3, 3]
        for name, data in (("planned", best), ("random", random)):
            left = identify(data, "complete").forward(fresh)[:, :3, 3] - actual
            errors[name].append(float(np.linalg.norm(left, axis=-1).mean()))
    assert np.mean(errors["planned"]) < 0.8 * np.mean(errors["random"])


def test_the_same_seed_gives_the_same_plan() -> None:
    robot = load_robot("scara")
    assert planned(robot, 3).table == planned(robot, 3).table


@pytest.mark.parametrize("joints", [1, 2])
def test_a_dense_draw_is_not_one_configuration(joints: int, rng: np.random.Generator) -> None:
    """Rows that are kept are apart, and every other one is near an earlier row that is kept."""
    q = rng.uniform(0.0, 0.03, (400, joints))
    kept = distinct(q)
    apart = np.linalg.norm(q[:, None] - q[None, kept], axis=-1)
    assert len(kept) > 10
    assert (apart[kept] + np.eye(len(kept)) > REPEATS).all()
    near = np.where(kept < np.arange(len(q))[:, None], apart, np.inf).min(axis=1)
    dropped = np.setdiff1d(np.arange(len(q)), kept)
    assert len(dropped)
    assert (near[dropped] <= REPEATS).all()
