"""The K's of a run for the cameras of a COLMAP database: the rows of the images of one camera get its K."""

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
        slug: its name in messages.
        camera: as COLMAP takes it; None where it has no K that may be used.
        names: its images, relative to the image directory.
    """

    slug: str
    camera: ColmapCamera | None
    names: tuple[str, ...]


def plan_database(path: Path, cameras: Sequence[DatabaseCamera]) -> DatabaseChange:
    """Find each camera's rows; nothing is written.

    Raises:
        InputError: the file is not a COLMAP database, has none of the images, or one of its cameras is of images that
            are of several cameras here.
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
