"""Calibrations in forms that other programs read: as_json, c_code, structured_text,
as_onnx, as_urdf.
"""
