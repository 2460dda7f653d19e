"""Calibration of a camera from the images of a flight or another program's reconstruction of them."""
