"""Calibrations for other programs: as_json, c_code, structured_text, as_onnx, as_urdf."""
