"""The Python API: one module per job. The main names are also attributes of :mod:`calibrary`."""
