"""What 15 planned configurations can tell at best, beside 30 random ones: predicted position error
of the task components after compensation.

Run: python benchmarks/plan_bound.py [--robots delta,hexapod] [--seeds 7] [--first-seed 200]. Known
tolerances, 0.05 mm noise, default workspace. The prediction is linear (a Cramér–Rao bound with the
tolerances as prior information) and needs no identification. Mean and RMS over 500 random
configurations, median of the seeds, µm. The bound is that of all designs of 15 configurations from
the candidates, repeated ones and fractions of one included (Kiefer 1974): the mean variance is
convex in the weights of the candidates, and its tangent bounds it from below. A plan can only be
better with configurations that are not among the candidates.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse

import numpy as np

from calibtool.compensation.weighted_error import Task
from calibtool.equivalent.joints import equivalent_robot
from calibtool.identification.evidence import inverse
from calibtool.measurement.sampling import sample_configurations
from calibtool.planning.constraints import Constraints
from calibtool.planning.information import Knowledge
from calibtool.planning.plan import make_plan
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array
from calibtool.robot.singularity import at_point

ROBOTS = "fivebar,hexapod,delta,prs3,palletizer,palletizer-level,hybrid"
NOISE = 0.05e-3
PLANNED, RANDOM = 15, 30
JUDGED = 500  # configurations over which errors are averaged
SETS = ("30 random", "15 planned (d)", "15 planned (i)", "15 planned (i), no joint margin")


def position_rows(knowledge: Knowledge, q: Array) -> Array:
    """∂(position in the task components)/∂θ at q (M, n), m, columns times the tolerances:
    (M, k, p).
    """
    context = knowledge.state.errors.context(q)
    tool = context.frames.tool
    task = Task.of(equivalent_robot(knowledge.robot))
    columns = task.of_jacobian(
        at_point(knowledge.parameters.pose_columns(context), tool[:, :3, 3]), tool
    )
    components = range(6) if task.components is None else task.components
    found: Array = columns[:, [c < 3 for c in components]] * knowledge.prior_std
    return found


def lower_bound(rows: Array, moments: Array, count: int, rounds: int = 150) -> float:
    """A lower bound of tr(M C), C = (I + Σ w_k A_kᵀ A_k)⁻¹, over all weights w ≥ 0 of sum `count`.

    rows A (N, r, p) over the noise, moments M (p, p). Multiplicative steps lower tr(M C); at any w
    it is at least tr(M C) + Σ w_k φ_k − count · max φ, φ_k = tr(A_k C M C A_kᵀ).
    """
    flat = rows.reshape(-1, rows.shape[-1])
    weights, best = np.full(len(rows), count / len(rows)), 0.0
    for _ in range(rounds):
        each = np.repeat(weights, rows.shape[1])[:, None]
        covariance = inverse(np.eye(flat.shape[1]) + (flat * each).T @ flat)
        slope = ((flat @ (covariance @ moments @ covariance)) * flat).sum(axis=1)
        slope = slope.reshape(len(rows), -1).sum(axis=1)
        value = float(np.sum(moments * covariance))
        best = max(best, value + float(weights @ slope) - count * float(slope.max()))
        weights *= slope**0.8
        weights *= count / weights.sum()
    return best


def predicted(name: str, seed: int) -> Array:
    """Mean and RMS (m) of every set, and the bound of the RMS: (9,)."""
    robot = load_robot(name)
    workspace, knowledge = robot.workspace(), Knowledge.of_tolerances(robot, NOISE)
    rng = np.random.default_rng(seed)
    judged = position_rows(knowledge, sample_configurations(robot, workspace, JUDGED, rng))
    flat = judged.reshape(-1, judged.shape[-1])
    moments = flat.T @ flat / JUDGED
    sets = [sample_configurations(robot, workspace, RANDOM, rng)]
    candidates = []
    for criterion, constraints in (
        ("d", Constraints()),
        ("i", Constraints()),
        ("i", Constraints(joint_margin=0.0)),
    ):
        plan = make_plan(
            knowledge,
            workspace,
            PLANNED,
            constraints=constraints,
            criterion=criterion,
            candidates=2000,
            rng=np.random.default_rng(seed),
        )
        sets.append(plan.q)
        candidates += [plan.candidates.q, plan.q]
    found = []
    for q in sets:
        known = knowledge.after(knowledge.rows(q)).covariance
        variance = ((judged @ known) * judged).sum(axis=(1, 2))
        found += [np.sqrt(variance).mean(), np.sqrt(variance.mean())]
    rows = knowledge.rows(np.concatenate(candidates[2:]))
    return np.array([*found, np.sqrt(lower_bound(rows, moments, PLANNED))])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", default=ROBOTS)
    parser.add_argument("--seeds", type=int, default=7)
    parser.add_argument("--first-seed", type=int, default=200)
    options = parser.parse_args()
    print("| robot | " + " | ".join(SETS) + " | RMS of any 15 at least |")
    print("|" + "---|" * (len(SETS) + 2))
    for name in options.robots.split(","):
        seeds = range(options.first_seed, options.first_seed + options.seeds)
        values = 1e6 * np.median([predicted(name, seed) for seed in seeds], axis=0)
        cells = [f"{values[2 * k]:.1f} ({values[2 * k + 1]:.1f})" for k in range(len(SETS))]
        print(f"| {name} | " + " | ".join(cells) + f" | {values[-1]:.1f} |", flush=True)


if __name__ == "__main__":
    main()
