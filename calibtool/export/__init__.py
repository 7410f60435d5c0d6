"""Calibrations in forms that other programs read: as_json, c_code."""
