"""The version of this package, for what names it in files, pages and requests."""

__version__ = "0.1.0"
