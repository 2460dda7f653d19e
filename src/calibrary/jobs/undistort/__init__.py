"""Undistorting images: what a run reports."""
