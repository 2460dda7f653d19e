"""Exchange between a registry and files or images: add, import, export, resolve, and reading of one calibration."""
