"""Calibrating a camera: from frames of a board to a report, a file and an entry of the registry."""
