"""calibrary.parsers."""
