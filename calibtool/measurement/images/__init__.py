"""Images of a board: detection, the lens, and measurements of its corners. Needs OpenCV, the extra
`camera`.
"""
