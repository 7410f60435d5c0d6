"""Plans for instruments: rows in which the tool is seen, better than random ones; programs."""

import re
from collections.abc import Callable

import numpy as np
import pytest
from program_reading import reader

from calibtool.errors import NoSolutionError, UsageError
from calibtool.measurement.checks.design import repeated_groups
from calibtool.measurement.kinds.corners import Corners
from calibtool.measurement.kinds.projection import project
from calibtool.measurement.setup import Setup
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.planning.constraints import JOINT_MARGIN, Constraints, wrapped
from calibtool.planning.information import Knowledge
from calibtool.planning.instrument_rows import InstrumentRows, placed
from calibtool.planning.plan import Plan, make_plan
from calibtool.programs.agreement import positions
from calibtool.programs.frames import NamedFrames
from calibtool.programs.motion_flow import follow
from calibtool.programs.point_list import point_list
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, inverse, transform_points

Forward = Callable[[Array], Array]

ARM = load_robot("ur5")
FULL = ARM.workspace("full")
KINDS = {
    "plane": 2,
    "sphere": 2,
    "contact": 2,
    "distance": 1,
    "board": 1,
    "camera": 2,
    "corners": 1,
    "corners-beside": 1,
    "second-arm": 1,
}
_MADE: dict[str, tuple[InstrumentRows, Plan]] = {}


def planned(kind: str) -> tuple[InstrumentRows, Plan]:
    if kind not in _MADE:
        rng = np.random.default_rng(3)
        gauge = 0.1 if kind == "plane" else None
        instrument = InstrumentRows.proposed(ARM, FULL, kind, KINDS[kind], gauge, 5e-5, rng)
        knowledge = Knowledge.of_tolerances(
            ARM, instrument.noise, False, instrument.setup, instrument.noise_orientation
        )
        made = make_plan(
            knowledge,
            FULL,
            15,
            constraints=Constraints(),
            criterion="d",
            candidates=150,
            rng=rng,
            instrument=instrument,
        )
        _MADE[kind] = instrument, made
    return _MADE[kind]


@pytest.mark.parametrize("kind", KINDS)
def test_rows_keep_the_margin_and_none_is_repeated(kind: str) -> None:
    _, made = planned(kind)
    span = ARM.upper - ARM.lower
    assert (made.q >= ARM.lower + JOINT_MARGIN * span - 1e-6).all()
    assert (made.q <= ARM.upper - JOINT_MARGIN * span + 1e-6).all()
    assert len(np.unique(repeated_groups(made.q))) == 15


@pytest.mark.parametrize("kind", KINDS)
def test_they_tell_more_than_random_rows_of_the_instrument(kind: str) -> None:
    _, made = planned(kind)
    assert made.selected.effective > made.random.effective
    assert made.before.effective == 0.0
    for prediction in (made.selected, made.random):
        assert 0 < prediction.target.mean() < made.before.target.mean()


@pytest.mark.parametrize("kind", ["plane", "sphere", "contact"])
def test_the_nominal_tip_is_where_it_touches(kind: str) -> None:
    instrument, made = planned(kind)
    setup, rows = instrument.setup, made.rows
    tips = transform_points(ARM.mechanism.forward(rows.q), setup.targets)[:, 0]
    assert rows.place is not None
    assert rows.touches is not None
    if setup.planes is not None:
        planes = setup.planes[rows.place]
        above = (tips * planes[:, :3]).sum(axis=-1) - planes[:, 3]
        assert np.allclose(above, rows.touches[:, 0], atol=1e-6)
        assert set(np.unique(rows.touches).tolist()) == {0.0, 0.1}
    elif setup.spheres is not None:
        spheres = setup.spheres[rows.place]
        apart = np.linalg.norm(tips - spheres[:, :3], axis=-1) - spheres[:, 3]
        assert np.allclose(apart, 0.0, atol=1e-6)
    else:
        in_gauge = transform_points(setup.frames[rows.place], tips[:, None])[:, 0]
        assert np.allclose(in_gauge, rows.touches, atol=1e-6)


@pytest.mark.parametrize("kind", ["corners", "corners-beside"])
def test_the_whole_board_is_in_the_image(kind: str) -> None:
    instrument, made = planned(kind)
    setup = instrument.setup
    assert isinstance(setup.kind, Corners)
    tool = ARM.mechanism.forward(made.q)
    if kind == "corners":
        assert setup.T_tool_camera is not None
        assert setup.T_base_boards is not None
        seen = inverse(tool @ setup.T_tool_camera) @ setup.T_base_boards[0]
    else:
        assert setup.T_tool_board is not None
        assert setup.T_base_cameras is not None
        seen = inverse(setup.T_base_cameras[0]) @ tool @ setup.T_tool_board
    assert setup.corners is not None
    assert setup.intrinsics is not None
    corners = transform_points(seen, setup.corners)
    pixels = project(corners, setup.intrinsics)
    assert (corners[..., 2] > 0).all()
    assert (pixels > 0).all()
    assert (pixels < np.array([1600, 1200])).all()


def test_rows_go_on_where_measurements_have_been() -> None:
    seen = simulate(ARM, Simulation(2, 40, "full", instrument="plane", places=2))
    instrument = InstrumentRows.of(seen, FULL)
    drawn = instrument.draw(200, np.random.default_rng(0))
    assert drawn.place is not None
    tips, known = (
        transform_points(ARM.mechanism.forward(q), seen.setup.targets)[:, 0]
        for q in (drawn.q, seen.q)
    )
    assert seen.setup.planes is not None
    planes = seen.setup.planes[drawn.place]
    assert np.abs((tips * planes[:, :3]).sum(axis=-1) - planes[:, 3]).max() < 2e-4
    for g in (0, 1):  # on the part of the plane that was touched
        assert seen.place is not None
        part, whole = tips[drawn.place == g], known[seen.place == g]
        assert (part > whole.min(axis=0) - 5e-3).all()
        assert (part < whole.max(axis=0) + 5e-3).all()


@pytest.mark.parametrize("kind", KINDS)
def test_the_proposed_places_are_said(kind: str) -> None:
    instrument, _ = planned(kind)
    lines = placed(instrument.setup)
    places = 1 if kind in ("second-arm", "distance") else KINDS[kind]
    assert len(lines) >= places
    assert all(re.search(r"-?\d+, -?\d+, -?\d+ mm|mm$", line) for line in lines)


def test_joints_of_several_turns_come_back_near_home() -> None:
    home = np.zeros(6)
    q = np.deg2rad([[350.0, -350.0, 170.0, 200.0, -20.0, 300.0]])
    found = np.rad2deg(wrapped(ARM, q, 0.05, home))
    assert np.allclose(found, [[-10.0, 10.0, 170.0, -160.0, -20.0, -60.0]])
    one_turn = load_robot("panda")
    inside = np.full((1, 7), 2.0)
    assert np.array_equal(wrapped(one_turn, inside, 0.05, np.zeros(7)), inside)


@pytest.mark.parametrize(
    ("name", "path", "language"),
    [
        ("fanuc-m900ib-700", "rows.ls", "fanuc-ls"),
        ("kuka-kr6-r900", "rows.src", "kuka-krl"),
        ("abb-irb1200", "rows.mod", "abb-rapid"),
        ("ur5", "rows.script", "ur-script"),
        ("scara", "rows.ls", "fanuc-ls"),
    ],
)
def test_a_program_of_rows_is_read_as_these_rows(name: str, path: str, language: str) -> None:
    robot = load_robot(name)
    middle, span = (robot.lower + robot.upper) / 2, robot.upper - robot.lower
    q = middle + 0.2 * span * np.random.default_rng(0).uniform(-1, 1, (7, robot.n))
    text = point_list(path, robot, q, [(f"plane {k}", "}; PTP [") for k in range(7)])
    program = reader(language)(text, robot)
    assert not program.remarks
    found, left = positions(program, follow(program, NamedFrames()))
    assert not left
    values = np.array([program.literals[position.literal].values for position in found])
    shown = robot.to_controller(q) if robot.coupled else q
    assert values.shape == (7, robot.n)
    assert np.allclose(values, shown, atol=1e-8)


def test_programs_that_cannot_be_written_are_refused(fanuc: Robot) -> None:
    with pytest.raises(UsageError, match=r"a program of rows is \.ls"):
        point_list("rows.txt", fanuc, np.zeros((1, 6)))
    panda = load_robot("panda")
    for path, said in (("a.src", "7 joints; KRL"), ("a.script", "six revolute joints")):
        with pytest.raises(UsageError, match=said):
            point_list(path, panda, np.zeros((1, 7)))


# --- arms of fewer than six joints ---

FEW = ["scara", "planar-3r", "prs3", "delta", "gantry"]


def apart(setup: Setup, q: Array, place: np.ndarray | None, forward: Forward) -> Array:
    """Distances (N,) of the tip from the true planes or spheres, m."""
    tips = transform_points(forward(q), setup.targets)[:, 0]
    own = np.zeros(len(q), dtype=int) if place is None else place
    if setup.planes is not None:
        return np.einsum("ij,ij->i", setup.planes[own, :3], tips) - setup.planes[own, 3]
    assert setup.spheres is not None
    away = np.linalg.norm(tips - setup.spheres[own, :3], axis=-1)
    return away - setup.spheres[own, 3]


@pytest.mark.parametrize("seed", [0, 5])
@pytest.mark.parametrize("kind", ["plane", "sphere"])
@pytest.mark.parametrize("name", FEW)
def test_a_probe_touches_with_few_joints(name: str, kind: str, seed: int) -> None:
    """The actual tip, in every place, within the limits; rows of a plan touch with the nominal."""
    robot = load_robot(name)
    by = Simulation(seed=seed, configurations=30, instrument=kind, places=2, noise=1e-6)
    rows = simulate(robot, by)
    assert rows.truth is not None
    setup, actual = rows.truth.setup, rows.truth.actual
    np.testing.assert_allclose(apart(setup, rows.q, rows.place, actual.forward), 0, atol=1e-5)
    assert robot.within_limits(rows.q).all()
    assert rows.place is not None
    assert set(rows.place) == {0, 1}
    rng = np.random.default_rng(seed)
    there = InstrumentRows.proposed(robot, robot.workspace(), kind, 2, None, 5e-5, rng)
    drawn = there.draw(60, rng)
    away = apart(there.setup, drawn.q, drawn.place, robot.mechanism.forward)
    np.testing.assert_allclose(away, 0, atol=1e-8)
    assert robot.within_limits(drawn.q).all()
    assert len(drawn.q) >= 20


@pytest.mark.parametrize("kind", ["contact", "board", "camera", "corners", "second-arm"])
@pytest.mark.parametrize("name", ["scara", "delta", "gantry"])
def test_instruments_that_need_any_orientation_say_so(name: str, kind: str) -> None:
    robot = load_robot(name)
    with pytest.raises(NoSolutionError, match=f"{name}: with {robot.n} joints .* plane and sphere"):
        simulate(robot, Simulation(configurations=20, instrument=kind))


def test_half_of_the_contacts_are_on_the_block() -> None:
    robot = load_robot("scara")
    by = Simulation(seed=1, configurations=40, instrument="plane", gauge=0.05, noise=1e-6)
    rows = simulate(robot, by)
    assert rows.truth is not None
    assert rows.values is not None
    heights = apart(rows.truth.setup, rows.q, None, rows.truth.actual.forward)
    np.testing.assert_allclose(heights, rows.values[:, 0], atol=1e-5)
    assert 5 < (heights > 0.04).sum() < 35
