"""Calibrating a rig: from frames of several cameras to their lenses, their relative poses, a page and entries."""
