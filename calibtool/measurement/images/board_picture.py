"""A picture of the detection: corners, and their reprojection errors enlarged."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calibtool.measurement.images.detection import read_image
from calibtool.measurement.images.lens import Lens
from calibtool.measurement.images.opencv import opencv
from calibtool.robot.se3 import Array

_WIDTH = 480  # px of an image on the sheet
_MOST = 60  # number of images on the sheet
_FOUND, _ERROR, _TEXT = (40, 170, 40), (30, 30, 230), (255, 255, 255)  # BGR
_ENLARGED = 40.0  # length of an error's line on the sheet, px per px


def picture(paths: Sequence[Path], pixels: Array, lens: Lens, lost: Sequence[Path]) -> bytes:
    """A PNG with every image: found corners (N, m, 2) as circles, reprojection errors as lines
    `_ENLARGED` times as long. Images without a board come last, with their names.
    """
    cv2 = opencv()
    tiles = []
    for k, path in list(enumerate(paths))[:_MOST]:
        tile, scale = _tile(path)
        for corner, residual in zip(pixels[k], lens.residual[k], strict=True):
            if not np.isfinite(corner).all():
                continue
            at = tuple(np.round(corner * scale).astype(int).tolist())
            to = tuple(np.round(corner * scale + _ENLARGED * scale * residual).astype(int).tolist())
            cv2.circle(tile, at, 3, _FOUND, 1, cv2.LINE_AA)
            cv2.line(tile, at, to, _ERROR, 1, cv2.LINE_AA)
        _written(tile, f"{path.name}  {lens.image_rms[k]:.2f} px")
        tiles.append(tile)
    for path in lost[: max(_MOST - len(tiles), 0)]:
        tile, _ = _tile(path)
        _written(tile, f"{path.name}  not found")
        tiles.append(tile)
    across = int(np.ceil(np.sqrt(len(tiles))))
    height = max(tile.shape[0] for tile in tiles)
    down = -(-len(tiles) // across)
    sheet = np.zeros((down * height, across * _WIDTH, 3), dtype=np.uint8)
    for k, tile in enumerate(tiles):
        row, column = divmod(k, across)
        sheet[row * height : row * height + tile.shape[0], column * _WIDTH :][:, :_WIDTH] = tile
    written, data = cv2.imencode(".png", sheet)
    assert written
    return bytes(data)


def _tile(path: Path) -> tuple[Array, float]:
    """An image in the width of the sheet's, in colour, and its scale; black for no image."""
    cv2, image = opencv(), read_image(path)
    if image is None:
        return np.zeros((_WIDTH // 2, _WIDTH, 3), dtype=np.uint8), 1.0
    scale = _WIDTH / image.shape[1]
    height = max(round(image.shape[0] * scale), 1)
    small = cv2.resize(image, (_WIDTH, height), interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(small, cv2.COLOR_GRAY2BGR), scale


def _written(tile: Array, text: str) -> None:
    """A line of text at the foot of an image."""
    cv2 = opencv()
    x, y = 8, tile.shape[0] - 10
    for at, colour in (((x + 1, y + 1), (0, 0, 0)), ((x, y), _TEXT)):
        cv2.putText(tile, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
