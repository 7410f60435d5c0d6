"""A UR arm of the catalogue with the calibration of one arm, as a robot.toml names them."""

from pathlib import Path

import numpy as np
import pytest
from universal import UR5, as_conf, as_yaml, forward, forward_dh, perturbed, random_changes

from calibtool.errors import InputError
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

Q = np.random.default_rng(5).uniform(-np.pi, np.pi, (12, 6))


def described(folder: Path, file: str, text: str, nominal: str = "ur5", more: str = "") -> Robot:
    (folder / file).write_text(text)
    (folder / "robot.toml").write_text(
        f'name = "cell-4"\ntitle = "UR5 of cell 4"\n[kinematics]\nnominal = "{nominal}"\n'
        f'calibration = "{file}"\n{more}[targets]\npoints_mm = [[0, 0, 0]]\n'
    )
    return load_robot(str(folder))


def test_changes_of_dh_parameters(tmp_path: Path, rng: np.random.Generator) -> None:
    changes = random_changes(rng)
    robot = described(tmp_path, "calibration.conf", as_conf(changes))
    np.testing.assert_allclose(robot.mechanism.forward(Q), forward_dh(changes, Q), atol=1e-9)
    nominal = load_robot("ur5")
    np.testing.assert_array_equal(robot.lower, nominal.lower)
    np.testing.assert_array_equal(robot.upper, nominal.upper)
    assert np.abs(robot.chain.placements[:, :3, 3]).max() < 1.0  # metres that cancel are gone


def test_frames_of_the_driver(tmp_path: Path, rng: np.random.Generator) -> None:
    frames = perturbed(UR5, rng, 0.3e-3, 1e-3)
    robot = described(tmp_path, "my_calibration.yaml", as_yaml(frames))
    np.testing.assert_allclose(robot.mechanism.forward(Q), forward(frames, Q), atol=1e-12)


ZERO = as_conf({key: np.zeros(6) for key in ("theta", "a", "d", "alpha")})


@pytest.mark.parametrize(
    ("nominal", "text", "more", "finding"),
    [
        ("ur6", ZERO, "", "nominal: no UR arm of the catalogue; did you mean ur"),
        ("panda", ZERO, "", "no UR arm of the catalogue"),
        ("abb-irb120", ZERO, "", "no UR arm of the catalogue"),
        ("ur5", "a,b\n1,2\n", "", "a text file of another kind"),
        ("ur5", "<robot/>", "", "is no calibration.conf"),
        ("ur5", ZERO, 'urdf = "robot.urdf"\n', "exactly one of"),
        ("ur5", ZERO.replace("delta_a ", "delta_b "), "", "has no delta_a"),
    ],
)
def test_what_does_not_fit_is_refused(
    nominal: str, text: str, more: str, finding: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=finding) as caught:
        described(tmp_path, "calibration.conf", text, nominal, more)
    assert "\n" not in str(caught.value)


def test_the_file_alone_says_how_it_is_read(tmp_path: Path) -> None:
    (tmp_path / "calibration.conf").write_text(ZERO)
    with pytest.raises(InputError, match=r'nominal = "ur5e", calibration = "calibration.conf"'):
        load_robot(str(tmp_path / "calibration.conf"))
