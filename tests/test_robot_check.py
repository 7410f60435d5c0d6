"""The check of a description: true figures, and a warning for everything
that will be in the way.
"""

import numpy as np
import pytest
from test_description import TOML, URDF, crane

from calibtool.errors import InputError
from calibtool.evaluation.robot_check import RobotCheck, check_robot
from calibtool.robot.catalogue import load_robot, shipped

PLANAR = shipped("robots") / "planar-3r"


def planar(tmp_path, old: str = "", new: str = "", urdf: tuple[str, str] = ("", "")) -> RobotCheck:
    """The check of planar-3r with a change in its texts."""
    toml = (PLANAR / "robot.toml").read_text().replace('name = "planar-3r"', 'name = "mine"')
    assert old in toml
    (tmp_path / "robot.toml").write_text(toml.replace(old, new))
    (tmp_path / "robot.urdf").write_text((PLANAR / "robot.urdf").read_text().replace(*urdf))
    return check_robot(load_robot(str(tmp_path)), str(tmp_path))


@pytest.mark.parametrize("name", ["planar-3r", "so100", "fanuc-m1000ia"])
def test_built_in_robots_have_sensible_homes_and_everything_identifiable(name: str) -> None:
    found = check_robot(load_robot(name), name)
    assert all(each.singularity_distance > 0.1 for each in found.workspaces)
    assert all(design.rank == design.possible for _, design in found.designs)
    assert all("masses" in warning for warning in found.warnings)


def test_the_reach_is_that_of_a_stretched_arm(tmp_path) -> None:
    found = planar(tmp_path)
    assert 1.05 < found.reach[0] <= 1.1  # links of 500, 400 and 200 mm
    np.testing.assert_array_equal(found.extent[:, 2], 0.0)
    assert len(found.virtual_joints) == 3
    assert "3 joints need 3" in found.virtual_reason


def test_limits_state_where_they_come_from(tmp_path) -> None:
    found = check_robot(load_robot(str(crane(tmp_path))), "crane")
    assert found.limit_sources == ["robot.toml", "urdf"]
    kinova = load_robot("kinova")
    assert [s == "continuous" for s in kinova.chain.limited_by] == [
        True,
        False,
        False,
        True,
        False,
        True,
    ]


def test_missing_limits_of_an_angle_are_a_warning(tmp_path) -> None:
    urdf = (PLANAR / "robot.urdf").read_text()
    limit = urdf[urdf.index("<limit") : urdf.index("/>", urdf.index("<limit")) + 2]
    found = planar(tmp_path, urdf=(limit, '<limit effort="0" velocity="0"/>'))
    assert "assumed" in found.limit_sources
    assert any(warning.startswith("no limits for j") for warning in found.warnings)


@pytest.mark.parametrize(
    ("points", "finding"),
    [
        ("[[0, 0, 50]]", "are one point"),
        ("[[0, 0, 50], [0, 0, 90]]", "are 2"),
        ("[[0, 0, 50], [0, 0, 90], [0, 0, 120]]", "lie on one line"),
    ],
)
def test_targets_that_hide_the_orientation_are_a_warning(
    points: str, finding: str, tmp_path
) -> None:
    targets = "[[86.603, 0.0, 50.0], [-43.301, 75.0, 50.0], [-43.301, -75.0, 50.0]]"
    found = planar(tmp_path, targets, points)
    assert any(f"the targets {finding}" in warning for warning in found.warnings)
    assert any("directions are not seen" in warning for warning in found.warnings)
    assert any(design.unobservable for _, design in found.designs)


def test_a_singular_home_and_a_name_of_the_catalogue_are_warnings(tmp_path) -> None:
    found = planar(tmp_path, "j2_deg = 60", "j2_deg = 0")
    assert any("home of workspace bench is singular" in warning for warning in found.warnings)
    text = (tmp_path / "robot.toml").read_text().replace('name = "mine"', 'name = "ur5"')
    (tmp_path / "robot.toml").write_text(text)
    clash = check_robot(load_robot(str(tmp_path)), str(tmp_path))
    assert any("'ur5' is also a robot of the catalogue" in warning for warning in clash.warnings)


def test_a_home_outside_the_limits_is_wrong(tmp_path) -> None:
    with pytest.raises(
        InputError,
        match=r"robot.toml: workspaces.bench.home: j2_deg = 175 is outside .*-160 to 160; ",
    ):
        planar(tmp_path, "j2_deg = 60", "j2_deg = 175")


def test_a_workspace_out_of_reach_is_wrong(tmp_path) -> None:
    toml = TOML.replace("box_m = [0.2, 0.2, 0.1]", "box_m = [9000, 9000, 9000]")
    with pytest.raises(
        InputError, match=r"robot.toml: workspaces.yard: .*make it smaller or move its home"
    ):
        check_robot(load_robot(str(crane(tmp_path, toml))), "crane")


def test_a_bare_urdf_states_what_was_taken_for_the_tool(tmp_path) -> None:
    path = tmp_path / "crane.urdf"
    more = (
        '<link name="hook"/><joint name="pin" type="fixed"><parent link="slide"/><child '
        'link="hook"/></joint>'
    )
    path.write_text(URDF.replace("</robot>", more + "</robot>"))
    found = check_robot(load_robot(str(path)), str(path))
    assert 'a bare URDF, taken as [kinematics] tool_frame = "tool0"' in found.warnings[0]
    assert any("no [workspaces]" in each for each in found.warnings)


def test_json_holds_the_findings_in_people_s_units(tmp_path) -> None:
    value = planar(tmp_path).as_json()
    assert value["schema"] == "calibtool/robot-check"
    assert value["joints"] == "RRR"
    assert value["workspaces"][0]["home_singular"] is False
    assert value["reach_mm"]["from_base"] == pytest.approx(1100, abs=50)
    assert {entry["model"] for entry in value["identifiable"]} == {"local-poe", "complete"}


def test_virtual_joints_named_in_the_description_are_stated_to_be(tmp_path) -> None:
    free = planar(tmp_path)
    assert free.virtual_reason.startswith("3 joints need 3;")
    names = ", ".join(f'"{name}"' for name in free.virtual_joints)
    named = planar(tmp_path, "[targets]", f"[equivalent]\nvirtual_joints = [{names}]\n\n[targets]")
    assert named.virtual_reason == "named in [equivalent]"
    assert named.virtual_joints == free.virtual_joints


@pytest.mark.parametrize(
    ("inertial", "finding"),
    [
        ('<mass value="2"/><origin xyz="500 0 0"/>', "centre of mass 500 m away"),
        ('<mass value="3e6"/><origin xyz="0.1 0 0"/>', "weighs 3e+06 kg"),
        ('<mass value="2"/><origin xyz="0 -40 0"/>', "centre of mass 40 m away"),
        ('<mass value="2"/><origin xyz="0 0 1.3"/>', "centre of mass 1.5 m away"),
        ('<mass value="-2"/><origin xyz="0.1 0 0"/>', "below zero"),
        ('<mass value="nan"/><origin xyz="0.1 0 0"/>', "link 'tool0' is no number"),
        ('<mass value="2"/><origin xyz="0.1 inf 0"/>', "link 'tool0' is no number"),
        ('<mass value="2000"/><origin xyz="0.1 0 0"/>', "weigh 2e+03 kg together"),
        ('<mass value="2e-9"/><origin xyz="0.1 0 0"/>', "weigh 2e-09 kg together"),
        ('<mass value="2"/><origin xyz="0.1 0 0"/>', None),
        ('<mass value="900"/><origin xyz="0.3 0.2 0"/>', None),
    ],
)
def test_absurd_masses_are_findings(tmp_path, inertial: str, finding: str | None) -> None:
    old, inertia = (
        '<link name="tool0"/>',
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>',
    )
    new = f'<link name="tool0"><inertial>{inertial}{inertia}</inertial></link>'
    assert old in (PLANAR / "robot.urdf").read_text()
    warnings = planar(tmp_path, urdf=(old, new)).warnings
    found = [warning for warning in warnings if "<inertial>" in warning]
    assert (len(found) == 1 and finding in found[0]) if finding else not found
