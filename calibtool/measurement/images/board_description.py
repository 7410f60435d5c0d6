"""The description of a board, `--board FILE.toml`."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from calibtool.errors import InputError, near_names
from calibtool.measurement.images.opencv import opencv
from calibtool.robot.se3 import Array
from calibtool.robot.toml_text import parse_toml, validation_message

Length = Annotated[float, Field(gt=0, lt=1e4)]
Squares = Annotated[int, Field(ge=2, le=200)]


class BoardDescription(BaseModel):
    """A ChArUco board or a checkerboard.

    squares    across and down, corner squares included
    square_mm  edge of a square
    marker_mm  edge of a marker, and its dictionary (OpenCV's name without DICT_), ChArUco only
    legacy     printed by OpenCV before 4.6 with an even number of squares down
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    kind: Literal["charuco", "checkerboard"]
    squares: tuple[Squares, Squares]
    square_mm: Length
    marker_mm: Length | None = None
    dictionary: str | None = None
    legacy: bool = False

    @model_validator(mode="after")
    def _whole(self) -> "BoardDescription":
        if self.kind == "checkerboard":
            if self.marker_mm is not None or self.dictionary is not None:
                raise ValueError("marker_mm and dictionary belong to kind = 'charuco'")
            if self.squares[0] == self.squares[1]:
                raise ValueError(
                    "a checkerboard with as many squares across as down looks the same when "
                    "turned; use another, or a ChArUco board"
                )
        elif self.marker_mm is None or self.dictionary is None:
            raise ValueError("a ChArUco board needs marker_mm and dictionary, such as '5x5_100'")
        elif self.marker_mm >= self.square_mm:
            raise ValueError("marker_mm has to be below square_mm: markers stand inside squares")
        return self

    @property
    def corners(self) -> Array:
        """Inner corners (m, 3) in the frame of the board: x across, y down, m."""
        across, down = self.squares
        x, y = np.meshgrid(np.arange(1, across), np.arange(1, down))
        flat = self.square_mm * 1e-3 * np.stack([x.ravel(), y.ravel()], axis=-1)
        return np.concatenate([flat, np.zeros((len(flat), 1))], axis=-1)

    @property
    def words(self) -> str:
        """Its name in messages."""
        across, down = self.squares
        of = f" of {self.dictionary}" if self.dictionary else ""
        return f"{self.kind} of {across} × {down} squares of {self.square_mm:g} mm{of}"

    def aruco(self) -> Any:
        """OpenCV's board. UsageError without OpenCV, InputError for markers too many."""
        cv2 = opencv()
        assert self.dictionary is not None
        assert self.marker_mm is not None
        dictionary = cv2.aruco.getPredefinedDictionary(dictionary_number(self.dictionary))
        markers, known = self.squares[0] * self.squares[1] // 2, len(dictionary.bytesList)
        if markers > known:
            raise InputError(
                f"the board needs {markers} markers, {self.dictionary} has {known}; check squares "
                "and dictionary"
            )
        size = (self.square_mm * 1e-3, self.marker_mm * 1e-3)
        board = cv2.aruco.CharucoBoard(self.squares, *size, dictionary)
        board.setLegacyPattern(self.legacy)
        return board


def dictionaries() -> dict[str, int]:
    """OpenCV's predefined dictionaries by name, such as 5x5_100."""
    aruco = opencv().aruco
    names = [name for name in dir(aruco) if name.startswith("DICT_")]
    return {name.removeprefix("DICT_").lower(): getattr(aruco, name) for name in sorted(names)}


def dictionary_number(name: str) -> int:
    """OpenCV's number of a dictionary. InputError for an unknown one."""
    known = dictionaries()
    key = name.lower().removeprefix("dict_")
    if key not in known:
        raise InputError(f"no dictionary '{name}'; {near_names(key, list(known))}")
    return known[key]


def parse_board(text: str, name: str) -> BoardDescription:
    """A board from TOML text. Raises InputError with the key that is wrong."""
    try:
        return BoardDescription.model_validate(parse_toml(text, name))
    except ValidationError as error:
        raise InputError(f"{name}: {validation_message(error, BoardDescription)}") from None
