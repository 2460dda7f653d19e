"""The catalogue: what is known of cameras before any of their images is read."""

from __future__ import annotations

from calibrary.catalogue import CatalogueListing, load_catalogue
from calibrary.known_camera import KnownCamera

__all__ = ["CatalogueListing", "known_cameras"]


def known_cameras(word: str = "") -> list[KnownCamera]:
    """The cameras of which the make, EXIF Model, name or lens holds a word; all of them for none.

    >>> from calibrary.api.cameras import known_cameras
    >>> [camera.title for camera in known_cameras("FC6310R")]
    ['DJI Phantom 4 RTK']
    """
    catalogue = load_catalogue()
    return list(catalogue.search(word) if word else catalogue)
