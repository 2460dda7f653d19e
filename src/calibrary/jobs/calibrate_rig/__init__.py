"""Calibration of a rig from frames of several cameras: lenses, relative poses, a page and registry entries."""
