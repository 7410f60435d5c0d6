"""A folder of images and a table of joint values → measurements of image corners."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from calibtool.errormodel.operating_conditions import Conditions, directions
from calibtool.errors import InputError
from calibtool.measurement.checks.finding import Finding
from calibtool.measurement.images.board_description import BoardDescription
from calibtool.measurement.images.detection import Seen, detect
from calibtool.measurement.images.image_findings import (
    board_findings,
    lost_images,
    reprojection_finding,
)
from calibtool.measurement.images.lens import Lens, applied, calibrated
from calibtool.measurement.images.turned_boards import turned
from calibtool.measurement.importing.header import parts_found
from calibtool.measurement.importing.labels import label_columns
from calibtool.measurement.importing.readings import read_joints
from calibtool.measurement.importing.sources import read_source
from calibtool.measurement.importing.spelling import spelt
from calibtool.measurement.importing.stated_units import Stated
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.setup import Setup
from calibtool.progress import Progress, silent
from calibtool.robot.coupling import JointValues
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly
from calibtool.tables import Table

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".webp")
PIXEL_NOISE = 0.05  # px: smallest noise, because no detector finds corners better
_FILES = ("image", "file", "filename", "file name", "picture", "photo", "bild", "datei", "frame")
Camera = Literal["tool", "beside"]


@dataclass(frozen=True, eq=False)
class ImportedImages:
    """Measurements that are not registered yet, and the findings of their import.

    paths   of the images that are rows of the measurements
    lens    intrinsics, poses of the board and reprojection errors in these images
    notes   notes for people, without warnings
    """

    measurements: Measurements
    findings: list[Finding]
    paths: tuple[Path, ...]
    lens: Lens
    notes: tuple[str, ...]

    @property
    def pixels(self) -> Array:
        """Corners (N, m, 2), px, NaN where not found."""
        assert self.measurements.values is not None
        return self.measurements.values.reshape(len(self.paths), -1, 2)


def images_in(folder: Path) -> list[Path]:
    """The images of a folder, img2 before img10. InputError where there is none."""
    paths = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES]
    if not paths:
        raise InputError(f"{folder}: no image in it ({', '.join(SUFFIXES)})")

    def key(path: Path) -> list[Any]:
        parts = re.split(r"(\d+)", path.name.casefold())
        return [int(part) if i % 2 else part for i, part in enumerate(parts)]

    return sorted(paths, key=key)


def import_images(
    paths: Sequence[Path],
    joints: bytes | str,
    joints_name: str,
    robot: Robot,
    board: BoardDescription,
    *,
    camera: Camera = "tool",
    intrinsics: Array | None = None,
    stated: Stated = Stated(),
    joint_values: JointValues | None = None,
    encoding: str | None = None,
    progress: Progress = silent,
) -> ImportedImages:
    """Measurements from images of a board and a table of joint values.

    The board is found in every image, the lens is calibrated unless intrinsics (9,) are given, and
    images and joint values are matched by the images' names or, without names, by their order.
    camera: on the tool with the board fixed in the cell, or beside the arm with the board on the
    tool. Images without a board are left out with a finding.

    Raises InputError where the images show another board than the one described, are mirrored, or
    match no row; NoSolutionError where the lens cannot be calibrated; UsageError without OpenCV.
    """
    source = read_source(joints, joints_name, encoding=encoding)
    table = source.table
    rows = joined(table, [path.name for path in paths])
    seen = list(progress(detect(paths, board), "images"))
    wrong = board_findings(seen, paths, board)
    if wrong:
        raise InputError(wrong[0].message)
    size = _usual_size(seen)
    findings = lost_images(seen, size)
    kept = np.array([k for k, image in enumerate(seen) if image.found and image.size == size])
    if not len(kept):
        raise InputError(f"none of {len(seen)} images shows the {board.words} described")
    pixels = np.array([seen[k].pixels for k in kept])
    columns = parts_found(source, table, robot, stated).joints
    if isinstance(columns, InputError):
        raise columns
    whose = robot.joint_values(joints_name, columns.values, joint_values)
    every = read_joints(table, robot, columns.model_copy(update={"values": whose}))
    if board.kind == "checkerboard":
        poses = robot.mechanism.forward(every[rows[kept]])
        pixels = _upright(pixels, board.corners, size, poses, intrinsics)
    lens = _lens(pixels, board.corners, size, intrinsics)
    blurred, good = reprojection_finding([seen[k].name for k in kept], lens)
    if blurred and good.any():
        kept, pixels = kept[good], pixels[good]
        lens = _lens(pixels, board.corners, size, intrinsics)
    q = every[rows[kept]]
    measurements = _measurements(robot, q, pixels, board, lens, camera)
    f, c = lens.intrinsics[:2], lens.intrinsics[2:4]
    note = (
        f"{len(kept)} of {len(seen)} images: focal length {f[0]:.1f}, {f[1]:.1f} px, centre "
        f"{c[0]:.1f}, {c[1]:.1f} px, corners to {lens.pixel_noise:.2g} px"
    )
    return ImportedImages(
        measurements,
        [*findings, *blurred],
        tuple(paths[k] for k in kept),
        lens,
        (note,),
    )


def joined(table: Table, names: Sequence[str]) -> np.ndarray:
    """The row of a table for each image: (N,), by a column of file names or of names, else by
    order.

    InputError where an image has no row, or where the numbers differ and there are no names.
    """
    columns = [column for column in table.header if spelt(column) in _FILES]
    stems = [Path(name).stem for name in names]
    for column in [*columns, *label_columns(table)]:
        texts = [Path(text.replace("\\", "/")).name for text in table.texts(column)]
        known = {text: row for row, text in reversed(list(enumerate(texts)))}
        known |= {Path(text).stem: row for text, row in list(known.items())}
        rows = [
            known.get(name, known.get(stem, -1)) for name, stem in zip(names, stems, strict=True)
        ]
        if column in columns and min(rows) < 0:
            name = names[rows.index(-1)]
            raise InputError(
                f"{table.name}: column '{column}' has no row for the image {name} "
                f"({sum(row < 0 for row in rows)} of {len(rows)} have none)"
            )
        if min(rows) >= 0:
            return np.array(rows)
    if len(table) != len(names):
        raise InputError(
            f"{table.name}: {len(table)} rows, but there are {len(names)} images; by order both "
            "need as many: add a column image with their names"
        )
    return np.arange(len(names))


def _usual_size(seen: Sequence[Seen]) -> tuple[int, int]:
    """Size of most of the images that show the board, px."""
    sizes = [image.size for image in seen if image.found] or [(0, 0)]
    return max(set(sizes), key=sizes.count)


def _lens(pixels: Array, corners: Array, size: tuple[int, int], intrinsics: Array | None) -> Lens:
    if intrinsics is None:
        return calibrated(pixels, corners, size)
    if (np.abs(2 * intrinsics[2:4] - np.array(size)) > 0.5 * np.array(size)).any():
        raise InputError(
            f"the intrinsics have the centre {intrinsics[2]:.0f}, {intrinsics[3]:.0f} px, the "
            f"images are {size[0]} × {size[1]} px: they belong to another camera or resolution"
        )
    return applied(pixels, corners, intrinsics)


def _upright(
    pixels: Array,
    corners: Array,
    size: tuple[int, int],
    T_base_tool: Array,
    intrinsics: Array | None,
) -> Array:
    """Corners of a checkerboard (N, m, 2), numbered from the same corner in every image."""
    lens = _lens(pixels, corners, size, intrinsics)
    over = turned(lens.T_camera_board[:, :3, :3], T_base_tool[:, :3, :3])
    found = pixels.copy()
    found[over] = pixels[over, ::-1]
    return found


def _measurements(
    robot: Robot, q: Array, pixels: Array, board: BoardDescription, lens: Lens, camera: Camera
) -> Measurements:
    """Corners (N, m, 2) at q (N, n) as measurements, with the set-up to be registered."""
    distance = float(np.median(lens.T_camera_board[:, 2, 3]))
    scale = distance / lens.intrinsics[0]
    on_tool, in_cell = {
        "tool": ("T_tool_camera", "T_base_boards"),
        "beside": ("T_tool_board", "T_base_cameras"),
    }[camera]
    setup = Setup.unknown(
        np.zeros((1, 3)),
        intrinsics=lens.intrinsics,
        corners=board.corners,
        image_scale=np.array([scale]),
        **{on_tool: np.eye(4), in_cell: np.eye(4)[None]},
    )
    return Measurements(
        robot=robot,
        q=readonly(q),
        points=readonly(np.full((len(q), 1, 3), np.nan)),
        rotations=None,
        setup=setup,
        noise_position=max(lens.pixel_noise, PIXEL_NOISE) * scale,
        noise_orientation=1e-3,
        conditions=Conditions(direction=readonly(directions(q))),
        values=readonly(pixels.reshape(len(q), -1)),
    )
