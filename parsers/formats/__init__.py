"""One module per file format, found by folder; :mod:`calibrary.parsers.format` says how to add one."""
