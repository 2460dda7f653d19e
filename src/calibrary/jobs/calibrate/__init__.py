"""Calibration of a camera from frames of a board, with a report, a file and a registry entry."""
