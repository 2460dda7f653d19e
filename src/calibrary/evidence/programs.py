"""Programs that write their name into an image, and what each does to where its pixels are.

A new program is a word in :data:`PROGRAMS`; the first row that fits counts. EXIF Software, XMP CreatorTool and the
agents of XMP's history are searched. A camera writes its firmware into Software, so a word names a program, and is no
bare version.
"""

from __future__ import annotations

import re
from enum import IntEnum
from functools import lru_cache
from typing import Final

from msgspec import Struct

__all__ = ["Does", "Program", "program_in"]


class Does(IntEnum):
    """What a program may have done to an image that it names itself in, in ascending order."""

    TAGS = 0
    """Writes tags, and copies the pixels as they are."""
    SAVES = 1
    """Saves the image again: it may have been cropped, turned or resized, and the tags do not say."""
    DEVELOPS = 2
    """As before, and corrects the lens by a profile, most of them without being asked."""
    STITCHES = 3
    """Joins several images to one, or projects them."""


class Program(Struct, frozen=True):
    """A program that an image names.

    Attributes:
        name: as the image writes it, version included.
        does: what it does to the geometry.
    """

    name: str
    does: Does


PROGRAMS: Final = {
    Does.STITCHES: r"ptgui|hugin|nona|enblend|autopano|kolor|image composite editor|autostitch|photostitch|panoweaver|"
    r"panorama ?(?:studio|maker|factory|stitcher)|realviz|dji (?:media maker|stitch)",
    Does.TAGS: r"exiftool|exiv2|geosetter|nikon transfer|pmb|playmemories|jhead|exifer|mapillary_tools",
    Does.DEVELOPS: r"lightroom|camera raw|dxo|darktable|rawtherapee|capture one|on1|luminar|affinity|silkypix|"
    r"capture nx\w*|nx studio|digital photo professional|phocus|photo ninja|aperture|raw power|iridient|lightzone|"
    r"rawstudio|ufraw|exposure x\d?|olympus (?:viewer|workspace)|om workspace|imaging edge|image data converter|"
    r"raw file converter|digital camera utility|sigma photo pro|zoner|pix4d\w*|metashape|photoscan|undistort\w*",
    Does.SAVES: r"adobe|photoshop|bridge|gimp|picasa|photo ?(?:viewer|gallery|editor|desk|scape|shop|works|suite)|"
    r"gallery|photos|windows(?! phone)|microsoft|paint(?:shop|\.net)?|irfanview|acdsee|acd systems|xnview\w*|"
    r"faststone|digikam|corel|polarr|snapseed|vsco|instagram|whatsapp|google|imagemagick|graphicsmagick|"
    r"graphicconverter|pillow|opencv|ffmpeg|quicktime|vuescan|noise ninja|viewnx\w*|(?:image|zoom)browser|"
    r"camedia master|finepixviewer|shotwell|gthumb|krita|pixelmator|preview|thumbsplus|meitu|picsart|topaz|skylum|"
    r"pixlr|canva|libvips|gd-jpeg",
}
"""What each program does, in the order in which they are searched for."""

_ROWS: Final = [(does, re.compile(rf"\b(?:{names})\b", re.IGNORECASE)) for does, names in PROGRAMS.items()]


@lru_cache(maxsize=256)
def program_in(text: str) -> Program | None:
    """The program that a text names, or None for a camera's firmware and anything else.

    >>> program_in("Adobe Photoshop Lightroom Classic 12.0 (Windows)").does.name
    'DEVELOPS'
    >>> program_in("v01.09.1691")
    """
    return next((Program(text, does) for does, names in _ROWS if names.search(text)), None)
