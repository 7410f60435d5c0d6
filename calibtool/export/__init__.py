"""Exports of calibrations: JSON, C, Structured Text, ONNX, URDF and tables."""
