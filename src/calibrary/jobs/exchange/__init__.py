"""Files and images in and out of a registry: add, import, export, resolve, and one calibration by its name."""
