"""The catalogue: known camera models."""

from __future__ import annotations

from calibrary.catalogue import CatalogueListing, search_catalogue
from calibrary.errors import InputError
from calibrary.known_camera import KnownCamera

__all__ = ["CatalogueListing", "known_cameras", "the_known_camera"]


def known_cameras(word: str = "") -> list[KnownCamera]:
    """Return the cameras that contain ``word`` in their make, EXIF Model, name or lens; by default all cameras.

    >>> from calibrary.api.cameras import known_cameras
    >>> [camera.title for camera in known_cameras("FC6310R")]
    ['Phantom 4 RTK']
    """
    return search_catalogue(word)


def the_known_camera(name: str) -> KnownCamera:
    """Return the one camera of the catalogue with this name, or with a name that contains it.

    Raises:
        InputError: no camera matches, or several do.
    """
    found, wanted = known_cameras(name), name.strip().casefold()
    exact = [
        camera
        for camera in found
        if wanted in {camera.title.casefold(), *(model.casefold() for model in camera.models)}
    ]
    found = exact or found
    if len(found) == 1:
        return found[0]
    titles = "; ".join(camera.title for camera in found[:8]) + (" …" if len(found) > 8 else "")
    like = f"{len(found)} like it ({titles})" if found else "none like it"
    raise InputError(
        f"camera {name!r}: the catalogue has {like}; expected one Model or title of those that 'calibrary catalogue' "
        "lists"
    )
