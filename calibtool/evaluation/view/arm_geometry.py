"""Shape of the arm: the meshes of its URDF where they are found, or simple solids."""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from pinocchio import coal

from calibtool.errors import InputError
from calibtool.evaluation.view.mesh_files import ALONE
from calibtool.robot.chain import joints_to
from calibtool.robot.named_files import inside
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.source import Source, example_robot_data
from calibtool.robot.tree import urdf_root
from calibtool.robot.urdf import base_placement, frame_id, locked_joints, parse_urdf, read_urdf
from calibtool.robot.z_axes import turn_z_to

_LINK, _JOINT = np.array([0.62, 0.64, 0.67, 1.0]), np.array([0.35, 0.37, 0.4, 1.0])
_THIN = 1e-9  # m: shorter links count as having no length


def mesh_folders(robot: Robot, given: Sequence[Path]) -> list[Path]:
    """Folders of the robot's meshes: the given ones, and example-robot-data for its robots."""
    from_library = robot.source.description.kinematics.example_robot_data is not None
    return [*given, *([example_robot_data().parent] if from_library else [])]


def described_shape(robot: Robot, folders: Sequence[Path], copies: Path) -> pin.GeometryModel:
    """The visual geometry of the robot's URDF, on the joints of its chain; empty where the
    URDF shows nothing.

    Meshes are read from `folders` and below them alone, whatever the URDF and they themselves say;
    the libraries see copies in `copies`, which must stay while the shape is shown. InputError names
    a mesh that is not there or cannot be read.
    """
    root = urdf_root(robot.source.urdf_text, robot.name)
    copied: dict[Path, Path] = {}
    for mesh in root.iterfind("link/visual/geometry/mesh"):
        found = _mesh(mesh.get("filename", ""), folders, robot.name)
        if found not in copied:
            copied[found] = _copied(found, copies / f"{len(copied)}{found.suffix.lower()}")
        mesh.set("filename", str(copied[found]))
    for part in root.iter():  # only visual geometry is wanted, and no image is read
        for other in [child for child in part if child.tag in ("collision", "texture")]:
            part.remove(other)
    return _visual_geometry(robot.source, ElementTree.tostring(root, encoding="unicode"))


def _visual_geometry(source: Source, urdf_text: str) -> pin.GeometryModel:
    """What the links look like, on the joints of `build_chain(source)`: placements in their frames,
    and in K_0 before them.

    urdf_text: the source's URDF with meshes named by absolute paths. InputError for a mesh
    that cannot be read.
    """
    name, kinematics = source.place, source.description.kinematics
    full = parse_urdf(urdf_text, name)
    every = read_urdf(
        urdf_text,
        name,
        lambda text: pin.buildGeomFromUrdfString(full, text, pin.GeometryType.VISUAL),
    )
    reduced, geometry = pin.buildReducedModel(
        full, every, *locked_joints(full, kinematics.locked_joints, name)
    )
    tool = reduced.frames[frame_id(reduced, kinematics.tool_frame, name)]
    way = [0, *joints_to(reduced, tool.parentJoint, name)]
    base = base_placement(reduced, kinematics.base_frame, name)
    result = pin.GeometryModel()
    for piece in geometry.geometryObjects:
        piece.parentJoint, piece.parentFrame = way.index(piece.parentJoint), 0
        if piece.parentJoint == 0:
            piece.placement = base.actInv(piece.placement)
        result.addGeometryObject(piece)
    return result


def _mesh(name: str, folders: Sequence[Path], robot: str) -> Path:
    """The file of a mesh: package://PACKAGE/PATH lies in a folder that holds the package, or is it;
    other names beside.
    """
    place = f"{robot}: mesh '{name}'"
    if Path(name).suffix.lower() not in ALONE:
        raise InputError(f"{place} is none of {' '.join(ALONE)}")
    if Path(name).suffix.lower() == ".dae" and find_spec("collada") is None:
        raise InputError(f"{place} needs pycollada; run: pip install 'calibtool[view]'")
    path = name.removeprefix("file://").removeprefix("package://")
    package, _, below = path.partition("/")
    for folder in folders:
        own = name.startswith("package://") and folder.resolve().name == package
        found = inside(folder, below if own else path, place)
        if found.is_file():
            return found
    raise InputError(f"{place} is not found; name its folder by --meshes")


def _copied(mesh: Path, copy: Path) -> Path:
    """A copy that refers to no other file, and that both libraries can read: Pinocchio's, and
    trimesh, by which viser shows it.
    """
    try:
        copy.write_bytes(ALONE[copy.suffix](mesh.read_bytes(), str(mesh)))
    except OSError as error:
        raise InputError(f"{mesh}: {error.strerror or error}") from None
    try:
        coal.MeshLoader().load(str(copy), np.ones(3))
        if find_spec("trimesh") is not None:
            import trimesh

            trimesh.load_scene(copy)
    except Exception as error:  # of many kinds: the file comes from outside
        raise InputError(f"{mesh}: the mesh cannot be read ({type(error).__name__})") from None
    return copy


def simple_shape(robot: Robot) -> pin.GeometryModel:
    """Cylinders along links, rails and axes, boxes for slides, sized by the robot."""
    shape = pin.GeometryModel()
    placements, twists = robot.chain.placements, robot.chain.twists
    links = float(np.linalg.norm(placements[:, :3, 3], axis=-1).sum()) / 2 or 0.3
    width = (links if robot.chain.tree is None else min(links, robot.length)) / 30  # one leg's size
    origin = np.zeros(3)
    joint = robot.chain.model_joints  # of Pinocchio, by number; 0 is the base
    # from the origin of a joint's frame to that of the next one
    for k, (placement, carrier) in enumerate(zip(placements, robot.chain.placed_on, strict=True)):
        thick = width if k < len(twists) else width / 2
        _add_rod(shape, f"link{k}", joint[carrier], origin, placement[:3, 3], thick)
    for j, twist in enumerate(twists[: robot.n]):
        if robot.prismatic[j]:
            axis, zero = placements[j][:3, :3] @ twist[:3], placements[j][:3, 3]
            _add_rod(
                shape,
                f"rail{j + 1}",
                joint[robot.chain.placed_on[j]],
                zero + axis * min(robot.lower[j], 0.0),
                zero + axis * max(robot.upper[j], 0.0),
                width / 2,
            )
            solid, along = coal.Box(3 * width, 3 * width, 4 * width), twist[:3]
        else:
            solid, along = coal.Cylinder(1.5 * width, 4 * width), twist[3:]
        _add(shape, f"joint{j + 1}", joint[j], pin.SE3(turn_z_to(along), origin), solid, _JOINT)
    return shape


def _add_rod(
    shape: pin.GeometryModel, name: str, joint: int, start: Array, end: Array, radius: float
) -> None:
    """A cylinder between two points of a joint's frame."""
    length = float(np.linalg.norm(end - start))
    if length > _THIN:
        middle = pin.SE3(turn_z_to((end - start) / length), (start + end) / 2)
        _add(shape, name, joint, middle, coal.Cylinder(radius, length), _LINK)


def _add(
    shape: pin.GeometryModel,
    name: str,
    joint: int,
    placement: pin.SE3,
    solid: coal.CollisionGeometry,
    colour: Array,
) -> None:
    piece = pin.GeometryObject(name, joint, placement, solid)
    piece.meshColor = colour
    shape.addGeometryObject(piece)
