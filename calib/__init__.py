"""Calibration boards: detection, lens estimation, uncertainty and verdict."""
