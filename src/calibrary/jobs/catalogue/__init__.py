"""List the known cameras, with their pixels and the source of each number.

>>> from calibrary.jobs.catalogue import known_cameras
>>> [camera.title for camera in known_cameras("FC6310R").cameras]
['Phantom 4 RTK']
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.catalogue import CatalogueListing

__all__ = ["known_cameras"]


def known_cameras(model: str = "") -> CatalogueListing:
    """List the cameras of the catalogue.

    Args:
        model: part of a make, EXIF Model, name or lens.
    """
    from calibrary.catalogue import CatalogueListing, search_catalogue

    return CatalogueListing(cameras=tuple(search_catalogue(model)))
