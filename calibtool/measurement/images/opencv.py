"""OpenCV, imported only when images are read or drawn."""

from typing import Any

from calibtool.errors import UsageError


def opencv() -> Any:
    """The module cv2. UsageError where it is not installed, or knows no ChArUco boards."""
    try:
        import cv2
    except ImportError:
        raise UsageError(
            "images need OpenCV; run: pip install 'calibtool[camera]' "
            "(or give a table of the board's poses)"
        ) from None
    if not hasattr(getattr(cv2, "aruco", None), "CharucoDetector"):
        raise UsageError(
            f"images need OpenCV 4.7 or newer with its contributed modules, not {cv2.__version__}; "
            "run: pip install 'calibtool[camera]'"
        )
    return cv2
