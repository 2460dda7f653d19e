"""Calibrating a camera from the images of a flight: from a folder to a report, a file and an entry of the registry."""
