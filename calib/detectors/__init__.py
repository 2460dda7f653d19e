"""Detectors, one module per pattern: they find points in a gray image, in px with OpenCV's pixel origin."""
