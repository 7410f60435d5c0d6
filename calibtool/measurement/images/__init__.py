"""Images of a board: detection, lens, measured corners. Needs OpenCV, the extra `camera`."""
