"""Motion of the instrument from points fixed to the base: recovered within its covariance where it
is there, nothing where it is not; rows brought back by it.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from calibtool.errors import InputError, UsageError
from calibtool.measurement.auxiliary import AuxiliaryReadings
from calibtool.measurement.checks import check_measurements
from calibtool.measurement.importing import Imported, read_table, undo_instrument_motion
from calibtool.measurement.reference_motion import ReferencePoints, instrument_motion
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array, readonly

NOISE = 0.05e-3


def displaced(points: Array, twists: Array, centre: Array) -> Array:
    """Points (M, k, 3) turned about the centre and shifted by twists (M, 6), by scipy."""
    R = Rotation.from_rotvec(twists[:, 3:]).as_matrix()
    return np.einsum("nij,nkj->nki", R, points - centre) + centre + twists[:, None, :3]


def readings(
    count: int, k: int, sizes: Array, rng: np.random.Generator, *, steady: bool = False
) -> tuple[ReferencePoints, Array, Array]:
    """Readings at random times of k points that move by a random walk, or steadily: with the true
    twists and the centre.
    """
    times = np.sort(np.concatenate([[0.0, 3600.0], rng.uniform(0, 3600, count - 2)]))
    part = times / times[-1]
    walk = rng.normal(size=(count - 1, 6)) * np.sqrt(np.diff(part))[:, None]
    walk = np.concatenate([np.zeros((1, 6)), np.cumsum(walk, axis=0)])
    twists = (part[:, None] * rng.normal(size=6) if steady else walk) * np.repeat(sizes, 3)
    fixed = rng.uniform(-1, 1, (k, 3)) + np.array([3.0, 0.0, 0.0])
    centre = fixed.mean(axis=0)
    points = displaced(np.broadcast_to(fixed, (count, k, 3)), twists, centre)
    points = points + rng.normal(size=points.shape) * NOISE
    return ReferencePoints(times, points), twists, centre


@pytest.mark.parametrize(
    ("count", "k", "sizes", "steady"),
    [
        (2, 3, (2e-3, 2e-3), True),  # before and after
        (3, 3, (1e-3, 0.5e-3), False),
        (10, 4, (0.5e-3, 0.3e-3), False),
        (40, 3, (0.3e-3, 0.15e-3), True),
        (12, 1, (1e-3, 0.0), False),
        (30, 2, (1e-3, 0.0), True),
    ],
)
def test_motion_is_recovered_within_its_covariance(
    count: int, k: int, sizes: tuple[float, float], steady: bool
) -> None:
    squares, freedom = 0.0, 0
    for seed in range(10):
        rng = np.random.default_rng([7, seed])
        references, twists, centre = readings(count, k, np.array(sizes), rng, steady=steady)
        motion = instrument_motion(references.ordered(), NOISE)
        assert motion.found
        # the motion is about the middle of noisy readings, which moves the centre by that noise
        np.testing.assert_allclose(motion.centre, centre, atol=5 * NOISE)
        free = np.diag(motion.covariance[-1]) > 0
        covariance = motion.covariance[-1][np.ix_(free, free)]
        error = (motion.twists - twists)[-1][free]
        squares += float(error @ np.linalg.solve(covariance, error))
        freedom += int(free.sum())
        assert np.linalg.norm(error[:3]) < 0.5 * np.linalg.norm(twists[-1, :3]) + 3 * NOISE
    assert chi2.ppf(1e-4, 0.5 * freedom) / 2 < squares < 2 * chi2.ppf(0.9999, freedom)


@pytest.mark.parametrize(("count", "k"), [(2, 1), (2, 3), (3, 3), (8, 2), (25, 3)])
def test_still_points_say_nothing(count: int, k: int) -> None:
    found = 0
    for seed in range(60):
        rng = np.random.default_rng([8, seed])
        references, _, _ = readings(count, k, np.zeros(2), rng)
        motion = instrument_motion(references.ordered(), NOISE)
        found += motion.found
        if not motion.found:
            assert not motion.at(np.linspace(-100, 4000, 5)).any()
            assert motion.noise == pytest.approx(NOISE, rel=0.8)
    assert found <= 1  # at most 1 % of sets: more than one of 60 has a probability of 12 %


def test_a_stated_noise_that_is_too_small_is_corrected_by_the_readings() -> None:
    found = sum(
        instrument_motion(
            readings(12, 3, np.zeros(2), np.random.default_rng([9, seed]))[0].ordered(), NOISE / 4
        ).found
        for seed in range(40)
    )
    assert found <= 1


def test_a_rotation_of_a_degree_is_taken_back_exactly() -> None:
    rng = np.random.default_rng(3)
    times = np.linspace(0, 100, 21)
    fixed = rng.uniform(-1, 1, (4, 3))
    twists = np.sin(times / 30)[:, None] * [5e-3, -3e-3, 2e-3, 0.017, -0.01, 0.02]
    points = displaced(np.broadcast_to(fixed, (21, 4, 3)), twists, fixed.mean(axis=0))
    motion = instrument_motion(ReferencePoints(times, points), 1e-6)
    seen = rng.uniform(-2, 2, (21, 5, 3))
    R = Rotation.random(21, random_state=1).as_matrix()
    moved = displaced(seen, twists, fixed.mean(axis=0))
    turned = Rotation.from_rotvec(twists[:, 3:]).as_matrix() @ R
    back, rotations = motion.moved_back(times, moved, turned)
    np.testing.assert_allclose(back, seen, atol=1e-5)
    np.testing.assert_allclose(rotations, R, atol=1e-5)


def test_gross_and_missing_readings_do_not_count() -> None:
    references, _, _ = readings(20, 3, np.zeros(2), np.random.default_rng(5))
    points = references.points.copy()
    points[4, 1] = 0.0
    points[9, 0] += [0.095, 0.0, 0.0]
    points[12, 2] = np.nan
    clean, gross = ReferencePoints(references.times, points).ordered().without_gross(NOISE)
    assert gross == 1
    assert np.isnan(clean.points[[4, 9, 12], [1, 0, 2], 0]).all()
    assert np.isfinite(clean.points[..., 0]).sum() == 57
    assert not instrument_motion(clean, NOISE).found


def test_a_kick_is_no_gross_reading() -> None:
    references, _, _ = readings(20, 3, np.zeros(2), np.random.default_rng(6))
    points = references.points.copy()
    points[11:] += [2e-3, 0.0, 0.0]
    clean, gross = ReferencePoints(references.times, points).ordered().without_gross(NOISE)
    motion = instrument_motion(clean, NOISE)
    assert gross == 0
    np.testing.assert_allclose(motion.twists[[2, 17], 0], [0.0, 2e-3], atol=0.1e-3)


# --- tables ---------------------------------------------------------------------------------------


def tables(
    drift: float, *, with_columns: bool = True, time: bool = True, seed: int = 0
) -> tuple[str, dict[str, str], Array]:
    """A table of ur10 with an instrument that drifts by `drift` times 0.7 mm and 0.4 mrad, the
    same readings as files of their own, and the points without the drift.
    """
    count = 48
    data = simulate(
        load_robot("ur10"), Simulation(configurations=count, seed=seed, unregistered=True)
    )
    rng = np.random.default_rng([11, seed])
    fixed = data.points.mean(axis=(0, 1)) + rng.uniform(-1.5, 1.5, (4, 3))
    centre = fixed.mean(axis=0)
    part = np.linspace(0, 1, count)
    twists = drift * np.outer(part, [0.6e-3, -0.3e-3, 0.2e-3, 0.2e-3, -0.1e-3, 0.3e-3])
    points = displaced(data.points, twists, centre)
    references = displaced(np.broadcast_to(fixed, (count, 4, 3)), twists, centre)
    references = references + rng.normal(size=references.shape) * 0.02e-3
    read = [e for e in range(count) if e % 5 == 0 or e == count - 1]
    header = [f"j{j + 1}_deg" for j in range(6)]
    header += [f"t{k + 1}_{axis}_mm" for k in range(3) for axis in "xyz"]
    names = [f"ref{k + 1}_{axis}_mm" for k in range(4) for axis in "xyz"]
    lines = [",".join((["time_s"] if time else []) + header + (names if with_columns else []))]
    for e in range(count):
        cells = [f"{60 * e}"] if time else []
        cells += [f"{v:.9f}" for v in np.rad2deg(data.q[e])]
        cells += [f"{v * 1e3:.6f}" for v in points[e].ravel()]
        if with_columns:
            cells += [f"{v * 1e3:.6f}" if e in read else "" for v in references[e].ravel()]
        lines.append(",".join(cells))
    wide = [",".join(["row", *names])] + [
        ",".join([str(e), *(f"{v * 1e3:.6f}" for v in references[e].ravel())]) for e in read
    ]
    stamped = [",".join(["time_s", *names])] + [
        ",".join([str(60 * e), *(f"{v * 1e3:.6f}" for v in references[e].ravel())]) for e in read
    ]
    long = ["row,name,x_mm,y_mm,z_mm"] + [
        ",".join([str(e), f"N{k}", *(f"{v * 1e3:.6f}" for v in references[e, k])])
        for e in read
        for k in range(4)
    ]
    files = {"rows": wide, "times": stamped, "lines": long}
    return "\n".join(lines), {name: "\n".join(text) for name, text in files.items()}, data.points


def imported(text: str) -> Imported:
    return read_table(text, "t.csv", load_robot("ur10"))


@pytest.mark.parametrize("source", ["columns", "rows", "times", "lines"])
def test_rows_are_brought_back_by_columns_and_by_files(source: str) -> None:
    text, files, truth = tables(1.0, with_columns=source == "columns")
    given = imported(text)
    file = None if source == "columns" else (files[source], "refs.csv")
    back, told, moved = undo_instrument_motion(given, file)
    assert moved
    assert "brought back into the frame of the first reading" in told[0]
    before = np.linalg.norm(given.measurements.points - truth, axis=-1)
    after = np.linalg.norm(back.measurements.points - truth, axis=-1)
    assert before.max() > 0.6e-3
    assert after.max() < 0.08e-3
    assert after.mean() < 0.2 * before.mean()
    assert not any(
        finding.severity == "warning" and finding.name == "reference_drift"
        for finding in check_measurements(back.registered().measurements, back.auxiliary)
    )


@pytest.mark.parametrize("source", ["columns", "rows", "times", "lines"])
def test_rows_without_drift_stay_as_they_are(source: str) -> None:
    text, files, _ = tables(0.0, with_columns=source == "columns", seed=2)
    given = imported(text)
    file = None if source == "columns" else (files[source], "refs.csv")
    back, told, moved = undo_instrument_motion(given, file)
    assert not moved
    assert "do not say more than their noise" in told[0]
    np.testing.assert_array_equal(back.measurements.points, given.measurements.points)


def test_without_stamps_the_order_of_the_rows_is_the_time() -> None:
    timed, plain = (imported(tables(1.0, time=time)[0]) for time in (True, False))
    one, other = (undo_instrument_motion(given)[0].measurements.points for given in (timed, plain))
    np.testing.assert_allclose(one, other, atol=1e-6)


def test_places_are_brought_back_each_for_itself() -> None:
    given = imported(tables(1.0)[0])
    half = len(given.measurements) // 2
    shift = np.array([0.5, 0.0, 0.2])  # the instrument was moved on purpose
    points, fixed = given.measurements.points.copy(), given.auxiliary.reference_points
    assert fixed is not None
    fixed = fixed.copy()
    points[half:] += shift
    fixed[half:] += shift
    place = (np.arange(2 * half) >= half).astype(int)
    setup = replace(
        given.measurements.setup, places=("A", "B"), further_frames=readonly(np.eye(4)[None])
    )
    two = given._replace(
        measurements=replace(given.measurements, points=readonly(points), place=place, setup=setup),
        auxiliary=replace(given.auxiliary, reference_points=fixed),
    )
    back, told, moved = undo_instrument_motion(two)
    assert moved
    assert [text.split(":")[0] for text in told] == ["A", "B"]
    once = undo_instrument_motion(given)[0].measurements.points
    np.testing.assert_allclose(back.measurements.points[:half], once[:half], atol=0.1e-3)
    apart = back.measurements.points[half:] - points[half:]
    assert 0.1e-3 < np.linalg.norm(apart, axis=-1).max() < 0.8e-3  # from its own first reading on


def test_references_that_cannot_be_meant_are_refused() -> None:
    text, files, _ = tables(1.0, with_columns=False)
    given = imported(text)
    with pytest.raises(UsageError, match="has no reference points"):
        undo_instrument_motion(given)
    with pytest.raises(InputError, match=r"refs\.csv: neither a time .* nor row"):
        undo_instrument_motion(given, (files["rows"].replace("row,", "step,"), "refs.csv"))
    later = files["times"].replace("\n0,", "\n", 1).splitlines()
    moved = [later[0], *(f"{9000 + k},{line.split(',', 1)[1]}" for k, line in enumerate(later[2:]))]
    with pytest.raises(InputError, match="after the last row"):
        undo_instrument_motion(given, ("\n".join(moved), "refs.csv"))
    unstamped = imported(tables(1.0, with_columns=False, time=False)[0])
    with pytest.raises(InputError, match="give a column row"):
        undo_instrument_motion(unstamped, (files["times"], "refs.csv"))
    once = "\n".join(files["rows"].splitlines()[:2])
    back, told, was_moved = undo_instrument_motion(given, (once, "refs.csv"))
    assert not was_moved
    assert "read once only" in told[0]
    assert back.measurements is not None


def test_a_zero_or_a_gross_reference_is_no_drift() -> None:
    data = simulate(load_robot("ur5"), Simulation(configurations=40))
    rng = np.random.default_rng(1)
    fixed = np.array([0.06, 0.05, 0.05]) + rng.normal(size=(40, 1, 3)) * 0.03e-3
    for value in (0.0, 0.3):
        spoilt = fixed.copy()
        spoilt[17, 0] = value
        found = check_measurements(data, AuxiliaryReadings(reference_points=spoilt))
        (drift,) = [finding for finding in found if finding.name == "reference_drift"]
        assert drift.severity == "note"
        assert drift.numbers["moved_mm"] < 0.1
        assert ("left out" in drift.message) == (value > 0)
