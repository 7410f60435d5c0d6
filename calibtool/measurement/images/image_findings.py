"""Problems of images: no board, mirrored, blurred, or another board."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calibtool.measurement.checks.finding import Finding, Numbers
from calibtool.measurement.images.board_description import BoardDescription, dictionaries
from calibtool.measurement.images.detection import Seen, corners_of, off_plane, read_image
from calibtool.measurement.images.lens import Lens
from calibtool.measurement.images.opencv import opencv
from calibtool.robot.se3 import Array

_BLURRED = 0.15  # of the median sharpness: images of the board below it are blurred
_TRIED = 4  # number of images in which a mistake is looked for
_FLAT = 5e-3  # of the width of the image: corners farther from a plane belong to another board
_FAR, _AT_LEAST = 3.0, 0.5  # times the median reprojection error, and px
_NAMED = 12  # number of images named in a message
_LEAST = 6  # number of markers in a usable image
_WIDEST = 20  # largest number of squares across that is tried


def lost_images(seen: Sequence[Seen], size: tuple[int, int]) -> list[Finding]:
    """The images in which no board was found, or that are of another size, by name."""
    sharp = [image.sharpness for image in seen if image.found and image.size == size]
    lost = []
    for image in seen:
        if image.found and image.size == size:
            continue
        why = ""
        if image.size == (0, 0):
            why = " (no image)"
        elif image.size != size:
            why = f" ({image.size[0]} × {image.size[1]} px)"
        elif sharp and image.sharpness < _BLURRED * float(np.median(sharp)):
            part = image.sharpness / float(np.median(sharp))
            why = f" (blurred: {100 * part:.2g} % of the sharpness of the others)"
        lost.append(image.name + why)
    if not lost:
        return []
    message = (
        f"{len(lost)} of {len(seen)} images do not show the board and are left out: {_listed(lost)}"
    )
    return [Finding("board_not_found", "warning", message, {"images": len(lost)})]


def board_findings(
    seen: Sequence[Seen], paths: Sequence[Path], board: BoardDescription
) -> list[Finding]:
    """Images that are mirrored, or show another board than the one described."""
    lost = [path for image, path in zip(seen, paths, strict=True) if not image.found]
    found = [image for image in seen if image.found]
    apart = [off_plane(image.pixels, board) for image in found]
    bent = bool(found) and float(np.median(apart)) > _FLAT * found[0].size[0]
    if 2 * len(lost) <= len(seen) and not bent:
        return []
    tried = lost[:_TRIED] if len(lost) >= len(found) else list(paths)[:_TRIED]
    images = [image for path in tried if (image := read_image(path)) is not None]
    if not images:
        return []
    mirrored = _seen_in([np.ascontiguousarray(image[:, ::-1]) for image in images], board)
    if mirrored > len(images) / 2:
        message = (
            f"the images are mirrored: {mirrored} of {len(images)} of those tried show the "
            f"{board.words} when left and right are exchanged; turn mirroring off in the camera"
        )
        return [Finding("mirrored_images", "warning", message, {"images": mirrored})]
    other = _other_charuco if board.kind == "charuco" else _other_checkerboard
    if (what := other(images, board)) is not None:
        message = f"the images do not show the {board.words} described: {what}"
        return [Finding("another_board", "warning", message, {"images": len(images)})]
    if bent:
        message = (
            f"the corners are {np.median(apart):.3g} px rms from those of a flat {board.words}: "
            "check squares, dictionary and whether the board is flat"
        )
        return [Finding("another_board", "warning", message, {"rms_px": float(np.median(apart))})]
    return []


def reprojection_finding(names: Sequence[str], lens: Lens) -> tuple[list[Finding], np.ndarray]:
    """Images with large reprojection errors, which are kept: (N,)."""
    rms = lens.image_rms
    far = ~(rms <= max(_FAR * float(np.nanmedian(rms)), _AT_LEAST))
    if not far.any():
        return [], ~far
    which = [f"{names[k]} ({rms[k]:.2g} px)" for k in np.flatnonzero(far).tolist()]
    message = (
        f"{int(far.sum())} of {len(rms)} images are blurred or moving: their corners are far from "
        f"those of a flat board (the others: {np.nanmedian(rms):.2g} px), and left out: "
        f"{_listed(which)}"
    )
    numbers: Numbers = {"images": int(far.sum()), "rms_px": float(np.nanmedian(rms))}
    return [Finding("blurred_images", "warning", message, numbers)], ~far


def _seen_in(images: Sequence[Any], board: BoardDescription) -> int:
    """Number of images in which the board is found, and flat."""
    apart = [off_plane(corners_of(image, board), board) for image in images]
    return sum(rms < _FLAT * image.shape[1] for rms, image in zip(apart, images, strict=True))


def _other_charuco(images: Sequence[Any], board: BoardDescription) -> str | None:
    """The pattern, the number of squares across, or the dictionary that fits the markers."""
    legacy = board.model_copy(update={"legacy": not board.legacy})
    if _seen_in(images, legacy) > len(images) / 2:
        return f"the pattern is that of legacy = {str(legacy.legacy).lower()}"
    assert board.dictionary is not None
    known = dictionaries()
    own = board.dictionary.lower().removeprefix("dict_")
    markers = _markers(images, known[own])
    if len(markers[0]) >= _LEAST * len(images):
        rms = {across: _layout_rms(*markers, across) for across in range(3, _WIDEST)}
        across = min(rms, key=lambda k: rms[k])
        if across != board.squares[0] and rms[across] < 0.2 * rms.get(board.squares[0], np.inf):
            return f"their markers are those of a board of {across} squares across"
        return None
    families = {name.rpartition("_")[0]: name for name in sorted(known, key=_capacity)}
    found = {name: _markers(images[:2], known[name])[0] for name in families.values()}
    best = max(found, key=lambda name: len(found[name]))
    if len(found[best]) < 2 * _LEAST or best.rpartition("_")[0] == own.rpartition("_")[0]:
        return None
    alike = [name for name in known if name.rpartition("_")[0] == best.rpartition("_")[0]]
    likely = min((n for n in alike if _capacity(n) > found[best].max()), key=_capacity)
    return f"their markers are those of {likely} (or a larger one), not of {own}"


def _capacity(dictionary: str) -> int:
    """How many markers a dictionary has, by the number in its name."""
    number = dictionary.rpartition("_")[2]
    return int(number) if number.isdigit() else 1024


def _markers(images: Sequence[Any], dictionary: int) -> tuple[np.ndarray, Array, np.ndarray]:
    """Numbers (k,), centres (k, 2) and images (k,) of the markers of a dictionary."""
    aruco = opencv().aruco
    detector = aruco.ArucoDetector(aruco.getPredefinedDictionary(dictionary))
    numbers, centres, owner = [], [], []
    for k, image in enumerate(images):
        corners, found, _ = detector.detectMarkers(image)
        for corner, number in zip(corners, [] if found is None else found.ravel(), strict=True):
            numbers.append(int(number))
            centres.append(np.asarray(corner).reshape(4, 2).mean(axis=0))
            owner.append(k)
    return np.array(numbers, dtype=int), np.array(centres).reshape(-1, 2), np.array(owner, int)


def _layout_rms(numbers: np.ndarray, centres: Array, owner: np.ndarray, across: int) -> float:
    """Distance of the markers from those of a flat board with this number of squares across, px
    rms.

    Markers are in the squares of one colour, numbered row by row.
    """
    place = 2 * numbers + 1
    row = place // across
    column = place % across
    if across % 2 == 0:  # the colours of the next row are shifted
        column = np.where(row % 2 == 1, column - 1, column)
    flat = np.stack([column, row], axis=-1).astype(float)
    squares: list[float] = []
    for k in np.unique(owner):
        own = owner == k
        if own.sum() < 6:
            continue
        H, _ = opencv().findHomography(flat[own], centres[own])
        if H is None:
            return float("inf")
        mapped = np.concatenate([flat[own], np.ones((int(own.sum()), 1))], axis=-1) @ H.T
        squares += ((mapped[:, :2] / mapped[:, 2:] - centres[own]) ** 2).sum(axis=-1).tolist()
    return float(np.sqrt(np.mean(squares))) if squares else float("inf")


def _other_checkerboard(images: Sequence[Any], board: BoardDescription) -> str | None:
    """The numbers of squares that the images show."""
    cv2 = opencv()
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_LARGER
    for image in images:
        whole, _, meta = cv2.findChessboardCornersSBWithMeta(image, (3, 3), flags)
        if whole:
            down, across = (count + 1 for count in np.asarray(meta).shape[:2])
            if {across, down} != set(board.squares):
                return f"they show {across} × {down} squares"
    return None


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")
