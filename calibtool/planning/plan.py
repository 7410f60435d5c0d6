"""A measurement plan: the most informative configurations, and the predicted accuracy."""

from dataclasses import dataclass
from typing import get_args

import numpy as np

from calibtool.errors import check_choice, check_whole
from calibtool.measurement.sampling import sample_configurations
from calibtool.planning.constraints import (
    Candidates,
    Constraints,
    distinct,
    draw_candidates,
    inside,
)
from calibtool.planning.information import Knowledge
from calibtool.planning.instrument_rows import InstrumentRows, Rows
from calibtool.planning.joint_table import as_written, in_columns, joint_table
from calibtool.planning.observability_indices import observability_indices
from calibtool.planning.selection import Criterion, improve, select
from calibtool.planning.visiting_order import short_order, travel
from calibtool.progress import Progress, silent
from calibtool.robot.coupling import JointValues
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly
from calibtool.robot.workspace import Workspace

# Sizes of the neighbourhoods, parts of the joint range: another four small ones gain 2 to 6 %
_REFINED = (0.2, 0.1, 0.1, 0.05, 0.05, 0.03, 0.03, 0.02)
_NEIGHBOURS = 600  # in all
_WORDS = {"plane": "plane", "sphere": "sphere", "board": "board", "corners": "board"}
_JUDGED = 500  # configurations of the workspace over which predictions are averaged


@dataclass(frozen=True, eq=False)
class Prediction:
    """Expected accuracy after measuring, over the workspace.

    effective  effective number of parameters known beyond the tolerances
    target     (M,) standard deviation of the target points after compensation, m
    """

    effective: float
    target: Array

    def as_json(self) -> dict[str, float]:
        """Units in the keys."""
        return {
            "effective_parameters": self.effective,
            "target_std_mean_mm": float(self.target.mean()) * 1e3,
            "target_std_max_mm": float(self.target.max()) * 1e3,
        }


@dataclass(frozen=True, eq=False)
class Plan:
    """Chosen configurations with predictions.

    knowledge     prior information and instrument
    criterion     `d`: determinant of the covariance of the errors; `i`: mean variance of the target
                  points
    candidates    configurations from which was chosen
    rows          chosen joint positions in the order of travel, rad or m, and their places
    before, selected, random   predictions before, with the plan, and with as many random candidates
    observability, observability_random   indices O1 … O5 of the two designs
    joint_values  whose joint values `table` and `as_json` hold (q is always the serial chain's)
    """

    knowledge: Knowledge
    criterion: Criterion
    candidates: Candidates
    rows: Rows
    before: Prediction
    selected: Prediction
    random: Prediction
    observability: dict[str, float]
    observability_random: dict[str, float]
    joint_values: JointValues = "serial"

    @property
    def q(self) -> Array:
        """(N, n) chosen joint positions, rad or m."""
        return self.rows.q

    @property
    def labels(self) -> dict[str, list[str]]:
        """Columns besides the joints of a row: its place, and the touched point."""
        place, setup, touches = self.rows.place, self.knowledge.state.setup, self.rows.touches
        found: dict[str, list[str]] = {}
        if touches is not None and (touches.shape[1] > 1 or touches.any()):
            names = ("x_mm", "y_mm", "z_mm") if touches.shape[1] > 1 else ("height_mm",)
            millimetres = np.round(touches * 1e3, 3) + 0.0
            found = {name: [f"{v:g}" for v in millimetres[:, k]] for k, name in enumerate(names)}
        if place is not None and setup.kind.id != "second-arm":
            gauge = touches is not None and touches.shape[1] > 1
            word = "placement" if gauge else _WORDS.get(setup.kind.id, "station")
            found[word] = [setup.places[g] for g in place]
        return found

    @property
    def beside(self) -> list[tuple[str, ...]]:
        """The columns besides the joints of every row: cells of `labels`."""
        columns = self.labels.values()
        return list(zip(*columns, strict=True)) if columns else [()] * len(self.q)

    @property
    def table(self) -> str:
        """CSV of the joints, for `simulate --at` and for the controller."""
        robot = self.knowledge.robot
        return joint_table(robot, self.q, self.labels, joint_values=self.joint_values)

    def as_json(self) -> dict[str, object]:
        """The object that `plan --json` prints."""
        robot = self.knowledge.robot
        columns, values = (
            robot.columns(self.joint_values),
            in_columns(robot, self.q, self.joint_values),
        )
        return {
            "schema": "calibtool/plan",
            "schema_version": 1,
            "robot": robot.name,
            "configurations": len(self.q),
            "criterion": self.criterion,
            "candidates": len(self.candidates.q),
            "drawn": self.candidates.drawn,
            "rejected": self.candidates.rejected,
            "parameters": self.knowledge.parameters.count,
            "noise_mm": self.knowledge.noise_position * 1e3,
            "travel_rad": travel(robot, self.q),
            "before": self.before.as_json(),
            "selected": {**self.selected.as_json(), "observability": self.observability},
            "random": {**self.random.as_json(), "observability": self.observability_random},
            "plan": [
                dict(zip([*columns, *self.labels], [*row, *beside], strict=True))
                for row, beside in zip(values.tolist(), self.beside, strict=True)
            ],
        }


def make_plan(
    knowledge: Knowledge,
    workspace: Workspace | str | None,
    count: int,
    *,
    constraints: Constraints,
    criterion: Criterion,
    candidates: int,
    rng: np.random.Generator,
    refine: bool = True,
    instrument: InstrumentRows | None = None,
    progress: Progress = silent,
) -> Plan:
    """Choose `count` of `candidates` configurations of a workspace that satisfy the constraints.

    workspace: None is the default one of the robot, `full` the whole joint range. refine: then
    improve every chosen configuration in its neighbourhood. instrument: all configurations are
    those that it sees. No configuration is chosen twice. Joint positions are rounded as they are
    written to the table, so that the plan is what will be driven. Raises NoSolutionError when too
    few candidates are found.
    """
    check_choice(criterion, get_args(Criterion), "criterion")
    check_whole(count, "configurations", 1)
    check_whole(candidates, "candidates", count)
    robot, targets = knowledge.robot, knowledge.state.setup.targets
    workspace = robot.workspace(workspace)
    drawn = draw_candidates(
        robot, workspace, constraints, targets, candidates, count, rng, instrument
    )
    if instrument is None:
        judged = drawn.workspace[:_JUDGED]
        reference = knowledge.rows(judged)
    else:
        judged = sample_configurations(robot, workspace, _JUDGED, rng)
        reference = knowledge.target_rows(judged)
    matrix = knowledge.rows(drawn.q, drawn.rows.place)
    chosen = drawn.rows.take(
        select(matrix, knowledge.covariance, count, criterion, reference, progress)
    )
    for scale in progress(_REFINED, "refinements") if refine else ():
        if instrument is None:
            near = Rows(robot.closing(_neighbours(robot, chosen.q, scale, rng)))
            near = near.take(inside(robot, workspace, near.q))
        else:
            near = instrument.draw(_NEIGHBOURS, rng)
        near = near.take(constraints.kept(robot, targets, near.q))
        both = chosen.with_more(near)
        both = both.take(distinct(both.q))
        best = improve(
            knowledge.rows(both.q, both.place), knowledge.covariance, count, criterion, reference
        )
        chosen = both.take(best)
    chosen = chosen.take(short_order(robot, chosen.q, workspace.home))
    chosen = chosen._replace(q=readonly(as_written(robot, chosen.q)))
    first = drawn.rows.take(np.arange(count))

    def predicted(known: Knowledge) -> Prediction:
        return Prediction(known.effective, known.target_deviation(judged))

    return Plan(
        knowledge=knowledge,
        criterion=criterion,
        candidates=drawn,
        rows=chosen,
        before=predicted(knowledge),
        selected=predicted(knowledge.after(knowledge.rows(chosen.q, chosen.place))),
        random=predicted(knowledge.after(matrix[:count])),
        observability=observability_indices(
            knowledge, chosen.q, drawn.q, (chosen.place, drawn.rows.place)
        ),
        observability_random=observability_indices(
            knowledge, first.q, drawn.q, (first.place, drawn.rows.place)
        ),
    )


def _neighbours(robot: Robot, q: Array, scale: float, rng: np.random.Generator) -> Array:
    """Configurations near q (N, n), with random steps of about half of the joints."""
    repeated = np.repeat(q, max(_NEIGHBOURS // len(q), 4), axis=0)
    step = rng.normal(size=repeated.shape) * (rng.random(repeated.shape) < 0.5)
    result: Array = np.clip(
        repeated + scale * (robot.upper - robot.lower) * step, robot.lower, robot.upper
    )
    return result
