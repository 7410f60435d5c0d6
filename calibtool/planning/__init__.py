"""Configurations to measure, constraints, visiting order, poses of an acceptance test."""
