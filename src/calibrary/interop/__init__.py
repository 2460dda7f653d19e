"""Lens models of OpenCV and COLMAP: the matching model of a lens, and its parameters in their order."""
