"""One module per file format, found by folder; :mod:`calibrary.parsers.format` describes how to add one."""
