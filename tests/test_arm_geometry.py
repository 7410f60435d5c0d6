"""What the arm looks like: on the joints of the chain, and from the
folders that were given alone.
"""

import os
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from calibtool.errors import InputError
from calibtool.evaluation.view.arm_geometry import described_shape, mesh_folders, simple_shape
from calibtool.evaluation.view.mesh_files import ALONE
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.source import parse_source

TRIANGLE = (
    "solid t\nfacet normal 0 0 1\nouter loop\n"
    "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    "endloop\nendfacet\nendsolid t\n"
)


def placements(robot: Robot, shape: pin.GeometryModel, q: Array) -> dict[str, Array]:
    """Poses of all pieces in K_0, by name."""
    model = robot.chain.model
    data = shape.createData()
    pin.updateGeometryPlacements(model, model.createData(), shape, data, q)
    return {piece.name: data.oMg[i].homogeneous for i, piece in enumerate(shape.geometryObjects)}


def described(visual: str, base: str = "") -> Robot:
    """Two joints; the second link is seen, 0.1 m along x of its frame and turned."""
    urdf = f"""<robot name="r"><link name="world"/>
      <link name="root"><visual><origin xyz="0 0 0.5"/>
        <geometry><box size="1 1 1"/></geometry></visual></link>
      <link name="one"/><link name="two"><visual><origin xyz="0.1 0 0" rpy="0 0.3 0"/>
        <geometry>{visual}</geometry></visual>
      <collision><geometry><mesh filename="/etc/passwd"/></geometry></collision></link>
      <link name="tool"/>
      <joint name="w" type="fixed"><parent link="world"/><child link="root"/>
        <origin xyz="1 2 3" rpy="0 0 1"/></joint>
      <joint name="l" type="prismatic"><parent link="root"/><child link="one"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
      <joint name="a" type="continuous"><parent link="one"/><child link="two"/><origin xyz="0 1 0"/>
        <axis xyz="0 1 0"/></joint>
      <joint name="t" type="fixed"><parent link="two"/><child link="tool"/>
        <origin xyz="0 0 1"/></joint></robot>"""
    toml = f'name = "r"\ntitle = "r"\n[kinematics]\nurdf = "r.urdf"\ntool_frame = "tool"\n{base}\n'
    return Robot.from_source(
        parse_source(toml + "[targets]\npoints_mm = [[0, 0, 0]]\n", urdf, "test")
    )


@pytest.mark.parametrize(
    ("base", "locked"),
    [("", ""), ('base_frame = "root"', ""), ("", "locked_joints = { l = 0.25 }")],
)
def test_links_are_seen_where_the_urdf_has_them(base: str, locked: str, tmp_path: Path) -> None:
    """Against Pinocchio on the URDF as it is, without the rebuilding of the chain."""
    robot = described('<cylinder radius="0.1" length="1"/>', f"{base}\n{locked}")
    shape = described_shape(robot, [], tmp_path)
    q = np.array([0.3]) if locked else np.array([0.25, 0.3])
    found = placements(robot, shape, q)
    full = pin.buildModelFromXML(robot.source.urdf_text)
    data = full.createData()
    pin.framesForwardKinematics(full, data, np.array([0.25, np.cos(0.3), np.sin(0.3)]))
    T_world_base = data.oMf[full.getFrameId("root" if base else "world")]
    expected = {
        "root_0": data.oMf[full.getFrameId("root")] * pin.SE3(np.eye(3), np.array([0, 0, 0.5])),
        "two_0": data.oMf[full.getFrameId("two")]
        * pin.SE3(pin.utils.rotate("y", 0.3), np.array([0.1, 0, 0])),
    }
    assert set(found) == set(expected)
    for name, pose in expected.items():
        assert np.allclose(found[name], (T_world_base.inverse() * pose).homogeneous, atol=1e-12)


def test_meshes_of_a_built_in_robot_are_found(tmp_path: Path) -> None:
    robot = load_robot("xarm7")
    shape = described_shape(robot, mesh_folders(robot, []), tmp_path)
    assert shape.ngeoms == 8
    assert {piece.parentJoint for piece in shape.geometryObjects} == set(range(8))


def test_the_simple_arm_reaches_from_the_base_to_the_tool(robot: Robot) -> None:
    """Every rod ends where the next joint or the tool is, at any configuration."""
    q = robot.workspace().home
    shape = simple_shape(robot)
    found = placements(robot, shape, q)
    lengths = {
        piece.name: 2 * piece.geometry.halfLength
        for piece in shape.geometryObjects
        if "link" in piece.name
    }
    tool = robot.mechanism.forward(q[None])[0, :3, 3]
    last = f"link{robot.n}"
    if last in found:
        assert np.allclose(
            found[last][:3, 3] + found[last][:3, 2] * lengths[last] / 2, tool, atol=1e-9
        )
    assert {f"joint{j + 1}" for j in range(robot.n)} <= set(found)
    assert np.isclose(
        sum(lengths.values()),
        np.linalg.norm(robot.chain.placements[:, :3, 3], axis=-1).sum(),
        atol=1e-6,
    )


@pytest.mark.parametrize("name", ["hexapod", "prs3", "scara", "fanuc-m1000ia", "delta"])
def test_solids_are_slender_and_rails_reach_their_zero(name: str) -> None:
    robot = load_robot(name)
    shape = simple_shape(robot)
    for piece in shape.geometryObjects:
        if piece.name.startswith("link"):
            assert piece.geometry.radius < robot.length / 20
        if piece.name.startswith("rail"):
            centre, half = piece.placement.translation, piece.geometry.halfLength
            zero = robot.chain.placements[int(piece.name[4:]) - 1][:3, 3]
            assert np.linalg.norm(centre - zero) <= half + 1e-9


@pytest.mark.parametrize(
    "name", ["package://arm/m/a.stl", "m/a.stl", "PATH/arm/m/a.stl", "file://PATH/arm/m/a.stl"]
)
def test_a_mesh_in_the_given_folder(tmp_path: Path, name: str) -> None:
    file = tmp_path / "arm" / "m" / "a.stl"
    file.parent.mkdir(parents=True)
    file.write_text(TRIANGLE)
    robot = described(f'<mesh filename="{name.replace("PATH", str(tmp_path))}"/>')
    folders = [tmp_path / "arm"] if not name.startswith("package") else [tmp_path]
    for given in (folders, [tmp_path / "arm"]):
        (piece,) = (
            p for p in described_shape(robot, given, tmp_path).geometryObjects if p.name == "two_0"
        )
        assert Path(piece.meshPath).read_text() == TRIANGLE
        assert Path(piece.meshPath).parent == tmp_path


@pytest.mark.parametrize(
    "name",
    [
        "../secret.stl",
        "package://arm/../secret.stl",
        "package://../secret.stl",
        "PATH/secret.stl",
        "file://PATH/secret.stl",
        "package://arm/link.stl",
        "m/../../secret.stl",
    ],
)
def test_nothing_outside_the_given_folder_is_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "secret.stl").write_text(TRIANGLE)
    (tmp_path / "arm" / "m").mkdir(parents=True)
    (tmp_path / "arm" / "link.stl").symlink_to(tmp_path / "secret.stl")
    robot = described(f'<mesh filename="{name.replace("PATH", str(tmp_path))}"/>')
    with pytest.raises(InputError, match="is outside of"):
        described_shape(robot, [tmp_path / "arm"], tmp_path)


@pytest.mark.parametrize(
    ("name", "reason"),
    [("none.stl", "--meshes"), ("/etc/passwd", "is none of"), ("bad.stl", "cannot be read")],
)
def test_a_mesh_that_cannot_be_had_is_named(tmp_path: Path, name: str, reason: str) -> None:
    (tmp_path / "bad.stl").write_text("no mesh")
    with pytest.raises(InputError, match=reason):
        described_shape(described(f'<mesh filename="{name}"/>'), [tmp_path], tmp_path)


# --- what meshes refer to ---------------------------------------------------------------------

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2000-01-01T00:00:00</created><modified>2000-01-01T00:00:00</modified></asset>
<library_images><image id="i"><init_from>{}</init_from></image></library_images></COLLADA>"""
PLY = "ply\nformat ascii 1.0\ncomment TextureFile {}\nelement vertex 0\nend_header\n"


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "pipe", "a b.mtl"])
@pytest.mark.parametrize(
    ("suffix", "text"),
    [
        (".obj", "mtllib {}\nusemtl m\n" + OBJ),
        (".obj", "  mtllib\\\n {}\n" + OBJ),
        (".obj", OBJ + "call {}\ncsh cat {}\nmaplib {}"),
        (".obj", "mtllib {}\r" + OBJ.replace("\n", "\r")),
        (".dae", DAE),
        (".ply", PLY),
    ],
)
def test_a_copy_names_no_other_file(suffix: str, text: str, name: str) -> None:
    data = text.replace("{}", name).encode()
    copy = ALONE[suffix](data, "mesh")
    assert name.encode() in data
    assert name.encode() not in copy
    if suffix == ".obj":
        assert copy.split() == OBJ.encode().split()
    assert ALONE[suffix](copy, "mesh") == copy


def test_a_pipe_beside_a_mesh_is_not_opened(tmp_path: Path) -> None:
    """Pinocchio would wait there for ever."""
    folder = tmp_path / "arm"
    folder.mkdir()
    os.mkfifo(folder / "pipe.mtl")
    os.mkfifo(folder / "b.stl")
    (folder / "a.obj").write_text("mtllib pipe.mtl\n" + OBJ)
    shape = described_shape(described('<mesh filename="a.obj"/>'), [folder], tmp_path)
    assert shape.ngeoms == 2
    with pytest.raises(InputError, match="not found"):
        described_shape(described('<mesh filename="b.stl"/>'), [folder], tmp_path)


@pytest.mark.parametrize(
    ("name", "text"),
    [("a.stl", "solid\n"), ("a.dae", "<COLLADA"), ("a.obj", "f 1 2"), ("a.ply", "")],
)
def test_a_mesh_that_a_library_refuses_is_named(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    copies = tmp_path / "copies"
    copies.mkdir()
    with pytest.raises(InputError, match="mesh"):
        described_shape(described(f'<mesh filename="{name}"/>'), [tmp_path], copies)
