"""Assignment of a run's cameras to the rows of a COLMAP database: the rows of a camera's images get its K."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct

from calibrary.errors import InputError
from calibrary.interop.colmap import ColmapCamera
from calibrary.interop.colmap_database import DatabaseChange, change_of, read_database

__all__ = ["RESTORE", "DatabaseCamera", "plan_database"]

RESTORE = "colmap.database-before.sql"


class DatabaseCamera(Struct, frozen=True, kw_only=True):
    """A camera for the database.

    Attributes:
        slug: name in messages.
        camera: in COLMAP's form; None without a usable K.
        names: its images, relative to the image directory.
    """

    slug: str
    camera: ColmapCamera | None
    names: tuple[str, ...]


def plan_database(path: Path, cameras: Sequence[DatabaseCamera]) -> DatabaseChange:
    """Find the rows of each camera; writes nothing.

    Raises:
        InputError: the file is not a COLMAP database, contains none of the images, or has a camera with
            images of several cameras of this run.
    """
    stored = read_database(path)
    owner = {name: camera for camera in cameras for name in camera.names}
    owners: dict[int, dict[str, DatabaseCamera | None]] = {}
    for name, number in stored.images:
        camera = owner.get(name)
        owners.setdefault(number, {})[camera.slug if camera is not None else ""] = camera
    updates: dict[int, ColmapCamera] = {}
    for number, found in sorted(owners.items()):
        usable = [one.camera for one in found.values() if one is not None and one.camera is not None]
        if not usable or number not in stored.cameras:
            continue
        if len(found) > 1:
            names = " and ".join(sorted(slug or "images that are not here" for slug in found))
            raise InputError(
                f"its camera {number} is that of the images of {names}; extract features with one run a camera, as "
                "colmap.sh does, or with --ImageReader.single_camera 0",
                source=str(path),
            )
        updates[number] = usable[0]
    if not updates:
        raise InputError("it has none of these images under their names here", source=str(path))
    return change_of(path, stored, updates)
