"""Comparison of two calibrations of one camera: size of the difference, its significance, and its likely cause."""
