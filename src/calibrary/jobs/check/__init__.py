"""Check of calibration files against the images of a flight."""
