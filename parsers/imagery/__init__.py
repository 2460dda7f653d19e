"""Image files: reading of camera metadata from their headers.

``read_metadata(path)`` is the public function. A container reader (jpeg, tiff, png, heif) finds the size and
the raw EXIF and XMP; exif, facts and xmp convert these to facts; reader combines them.
"""

from __future__ import annotations

from calibrary.parsers.files import IMAGE_SUFFIXES
from calibrary.parsers.imagery.reader import read_metadata, read_source
from calibrary.parsers.imagery.source import Source, open_source

__all__ = ["IMAGE_SUFFIXES", "Source", "open_source", "read_metadata", "read_source"]
