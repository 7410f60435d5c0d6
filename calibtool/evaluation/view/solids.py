"""The shape of the arm as triangles for a page: one body per piece, in its own frame."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from pinocchio import coal

from calibtool.evaluation.view.scene import Scene
from calibtool.robot.se3 import Array

_MOST = 9000  # number of triangles of a page
_ROUND = 14  # number of corners of a cylinder
_COARSEST = 12  # cells along a mesh: no mesh gets fewer


@dataclass(frozen=True, eq=False)
class Solid:
    """One piece of the arm.

    vertices (v, 3) m and faces (f, 3) in its own frame; colour (3,) from 0 to 1; placements
    (N, 3, 4) in K_0, one per configuration of the scene
    """

    vertices: Array
    faces: np.ndarray
    colour: Array
    placements: Array


def solids(scene: Scene, shape: pin.GeometryModel) -> list[Solid]:
    """The pieces of a shape on the joints of the robot's chain, at every configuration of a scene.

    Meshes with too many triangles are simplified: vertices of one cell of a grid become one.
    """
    meshes = [_mesh(piece) for piece in shape.geometryObjects]
    many = sum(len(faces) for _, faces in meshes)
    cells = 64
    while many > _MOST and cells >= _COARSEST:
        coarse = [_simplified(vertices, faces, cells) for vertices, faces in meshes]
        many, cells = sum(len(faces) for _, faces in coarse), cells * 3 // 4
        if many <= _MOST or cells < _COARSEST:
            meshes = coarse
    places = _placements(scene, shape)
    return [
        Solid(vertices, faces, np.asarray(piece.meshColor[:3], float), places[:, k])
        for k, (piece, (vertices, faces)) in enumerate(
            zip(shape.geometryObjects, meshes, strict=True)
        )
    ]


def _placements(scene: Scene, shape: pin.GeometryModel) -> Array:
    """Placements (N, pieces, 3, 4) in K_0."""
    model = scene.robot.chain.model
    data, own = model.createData(), shape.createData()
    result = np.empty((len(scene), shape.ngeoms, 3, 4))
    configurations = scene.robot.mechanism.configuration(scene.q)
    for k, q in enumerate(configurations):
        pin.forwardKinematics(model, data, q)
        pin.updateGeometryPlacements(model, data, shape, own)
        result[k] = [placement.homogeneous[:3] for placement in own.oMg]
    return result


def _mesh(piece: pin.GeometryObject) -> tuple[Array, np.ndarray]:
    """Vertices (v, 3) and faces (f, 3) of a piece; empty for a shape that is not drawn."""
    solid = piece.geometry
    if isinstance(solid, coal.Box):
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
        sides = np.array(
            [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        )
        return corners * solid.halfSide, np.concatenate([sides[:, [0, 1, 2]], sides[:, [0, 2, 3]]])
    if isinstance(solid, coal.Cylinder | coal.Capsule):
        angle = 2 * np.pi * np.arange(_ROUND) / _ROUND
        ring = solid.radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        half = np.array([0.0, 0.0, solid.halfLength])
        a, b = np.arange(_ROUND), (np.arange(_ROUND) + 1) % _ROUND
        walls = [np.stack(t, 1) for t in ((a, b, a + _ROUND), (b, b + _ROUND, a + _ROUND))]
        first, last = np.full(_ROUND, 2 * _ROUND), np.full(_ROUND, 2 * _ROUND + 1)
        caps = [np.stack([first, b, a], 1), np.stack([last, a + _ROUND, b + _ROUND], 1)]
        vertices = np.concatenate([ring - half, ring + half, [-half, half]])
        return vertices, np.concatenate([*walls, *caps])
    if isinstance(solid, coal.BVHModelBase):
        triangles = [solid.tri_indices(i) for i in range(solid.num_tris)]
        faces = np.array([[t[0], t[1], t[2]] for t in triangles], dtype=int)
        return np.array(solid.vertices()) * piece.meshScale, faces.reshape(-1, 3)
    return np.empty((0, 3)), np.empty((0, 3), dtype=int)


def _simplified(vertices: Array, faces: np.ndarray, cells: int) -> tuple[Array, np.ndarray]:
    """The mesh with the vertices of each cell of a grid, `cells` along its longest edge, as one."""
    size = float(np.ptp(vertices, axis=0).max()) / cells if len(vertices) else 0.0
    if size <= 0.0:
        return vertices, faces
    grid = np.floor((vertices - vertices.min(axis=0)) / size).astype(int)
    _, place, counts = np.unique(grid, axis=0, return_inverse=True, return_counts=True)
    place = place.ravel()
    merged = np.zeros((len(counts), 3))
    np.add.at(merged, place, vertices)
    kept = place[faces]
    a, b, c = kept.T
    kept = kept[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(kept, axis=1), axis=0, return_index=True)
    return merged / counts[:, None], kept[np.sort(first)]
