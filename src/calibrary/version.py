"""The version of this package, for what names it in files, pages and requests."""

__all__ = ["__version__"]

__version__ = "0.1.0"
