"""Images of a board: what they show of it, the lens, and measurements of its corners. Needs OpenCV,
the extra `camera`.
"""
