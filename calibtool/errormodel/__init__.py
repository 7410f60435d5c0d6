"""Errors of a robot by family: one file each, which says how it moves the robot, is identified,
stored, told and drawn.
"""
