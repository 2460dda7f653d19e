"""The Python door: one module per job; the names are public on :mod:`calibrary` itself."""
