"""A lens as OpenCV and COLMAP hold it: which of their models it is, and its parameters in their order."""
