"""Image files: what their heads say about the camera.

``read_metadata(path)`` is the whole of it. Inside, a container reader (jpeg, tiff, png, heif) finds the
size and the raw EXIF and XMP; exif, facts and xmp turn those into facts; reader puts them together.
"""

from __future__ import annotations

from calibrary.parsers.image_names import IMAGE_SUFFIXES
from calibrary.parsers.imagery.reader import read_metadata, read_source
from calibrary.parsers.imagery.source import Source, open_source

__all__ = ["IMAGE_SUFFIXES", "Source", "open_source", "read_metadata", "read_source"]
