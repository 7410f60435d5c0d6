"""Looking at it: the arm, its targets, and where they really are, as a page of its own
or live by viser.
"""
