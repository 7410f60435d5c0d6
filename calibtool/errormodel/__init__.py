"""Errors of a robot by family, one file each: effect on the robot, identification, storage,
simulation and text.
"""
