"""The picture of an arm: every joint named in every view, inside the picture, the same
bytes every time.
"""

import numpy as np
import pytest
from matplotlib.text import Text

from calibtool.evaluation.plots import draw_arm
from calibtool.evaluation.plots.arm_picture import arm_figure
from calibtool.robot.catalogue import load_robot


@pytest.mark.parametrize("name", ["planar-3r", "gantry", "tiago-arm"])
def test_every_view_names_base_joints_and_tool_once(name: str) -> None:
    robot = load_robot(name)
    for panel in arm_figure(robot).axes:
        words = [word for text in panel.texts for word in text.get_text().split(", ")]
        names = sorted(word for word in words if word not in "xyz")
        assert names == sorted(["base", "tool", *(f"j{j + 1}" for j in range(robot.n))])


def test_points_stand_where_kinematics_puts_them() -> None:
    robot = load_robot("scara")
    home = robot.workspace().home
    tool = robot.mechanism.forward(home[None])[0]
    side = arm_figure(robot).axes[0]
    links, targets = (
        next(line for line in side.lines if line.get_label() == label)
        for label in ("links", "targets")
    )
    np.testing.assert_allclose(np.array(links.get_xydata())[-1], tool[[0, 2], 3] * 1e3, atol=1e-9)
    expected = (tool[:3, :3] @ robot.targets.T).T + tool[:3, 3]
    np.testing.assert_allclose(targets.get_xydata(), expected[:, [0, 2]] * 1e3, atol=1e-9)


def test_the_picture_is_the_same_every_time_and_states_whose_it_is() -> None:
    robot = load_robot("planar-3r")
    assert draw_arm(robot, "svg") == draw_arm(robot, "svg")
    words = " ".join(
        text.get_text() for text in arm_figure(robot).findobj(Text)
    )  # letters of a file are outlines
    for word in ("planar-3r", "j2_deg 60", "targets", "revolute joint", "from above"):
        assert word in words
    assert "prismatic" not in words.replace("of a slide its stroke", "")
