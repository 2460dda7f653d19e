"""Names of cameras in OpenSfM and ODM; these programs apply a K to the images with the same camera name.

OpenSfM uses "v2 make model width height projection focal", read from EXIF (``camera_id_``, ``extract_make``,
``extract_model`` and ``extract_focal`` in opensfm/exif.py): make and model of the lens if EXIF states them,
the make removed from the model, and the image size in EXIF unless ``use_exif_size`` is off.

ODM since mid 2022 (its pull request 1467) reads EXIF itself (``camera_id`` and ``extract_focal`` in
opendm/photo.py): the camera's make and model unchanged, the size of the image file, ``brown`` unless XMP
``Camera:ModelType`` or ``--camera-lens`` states another model, and 0.85 if EXIF states no focal length.
Earlier releases use OpenSfM's names with ``use_exif_size`` off. ``cameras.json`` contains either name without
"v2 ".
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Final

from calibrary.calibration import Calibration, ImageSize
from calibrary.catalogue import load_catalogue
from calibrary.evidence.metadata import ImageMetadata

ODM_PROJECTIONS: Final = ("perspective", "brown", "fisheye_opencv")
ODM_UNKNOWN: Final = 0.85
"""ODM's default for focal length ÷ width if EXIF states none."""
FILM_MM: Final = 36.0
DIAGONAL_MM: Final = math.hypot(36.0, 24.0)
SENSOR_MM: Final = {
    "dji fc2103": 6.07,
    "dji fc220": 6.17,
    "dji fc300c": 6.31,
    "dji fc300s": 6.16,
    "dji fc300x": 6.2,
    "dji fc330": 6.25,
    "dji fc350": 6.17,
    "dji fc350z": 6.17,
    "dji fc6310": 13.2,
    "dji fc6540": 23.5,
    "dji phantom vision fc200": 6.17,
    "dji xt2": 10.88,
    "dji zenmusep1": 35.9,
    "dji zh20t": 7.68,
    "gopro hero4 black": 6.17,
    "gopro hero4 silver": 6.17,
    "hasselblad l2d-20c": 17.5,
    "yuneec e90": 13.2,
}
"""Sensor widths of UAV cameras in OpenSfM's table (opensfm/data/sensor_data.json), which ODM uses as well."""
ROUNDING: Final = 0.06
"""Largest relative error of FocalLengthIn35mmFilm in the catalogue: 24 instead of 25.3."""


def opensfm_names(states: Iterable[ImageMetadata], *, exif_size: bool = True) -> set[str]:
    """All names that OpenSfM may give the camera of images, without "v2 ".

    Args:
        states: metadata of the images.
        exif_size: whether OpenSfM uses the image size in EXIF.
    """
    names: set[str] = set()
    for stated in states:
        # EXIF in GDAL's text is read only by GDAL.
        metadata = ImageMetadata(size=stated.size) if stated.exif_in_text else stated
        make = metadata.make or "unknown"
        model = metadata.lens or metadata.model or "unknown"
        if metadata.make:
            model = model.replace(metadata.make, "")
        sizes = {metadata.size}
        if exif_size and metadata.exif_size is not None:
            sizes.add(metadata.exif_size)
        names |= {
            _name(make, model, size, "perspective", prior)
            for size in sizes
            for prior in _opensfm_priors(metadata, size)
        }
    return names


def odm_name(metadata: ImageMetadata) -> str:
    """The name that ODM gives the camera of an image now."""
    stated = "".join(_xmp(metadata, "ModelType")).lower()
    projection = {"perspective": "perspective", "fisheye": "fisheye_opencv"}.get(stated, "brown")
    return _odm_name(metadata, projection)


def odm_band(metadata: ImageMetadata) -> str:
    """The band that ODM takes an image for, as in its ``--primary-band``; empty for a picture in colour."""
    band = re.sub("[^A-Za-z0-9]+", "", "".join(_xmp(metadata, "BandName")))
    return "" if band.lower() in {"rgb", "redgreenblue"} else band


def _xmp(metadata: ImageMetadata, name: str) -> tuple[str, ...]:
    return next((one.values for one in metadata.xmp if (one.schema, one.name) == ("Camera", name)), ())


def odm_names(states: Iterable[ImageMetadata]) -> set[str]:
    """All names that any release of ODM may give the camera of images."""
    names: set[str] = set()
    for stated in states:
        older = opensfm_names([stated], exif_size=False)
        names |= {name.replace(" perspective ", f" {kind} ") for name in older for kind in ODM_PROJECTIONS}
        names |= {_odm_name(stated, kind) for kind in ODM_PROJECTIONS}
    return names


def odm_entry_names(calibration: Calibration) -> set[str]:
    """The names that ODM may give a camera, derived from its registry entry.

    The last part of the name is FocalLengthIn35mmFilm ÷ 36, a whole number of mm that the catalogue may
    state. If it does not, all values are included that a maker may have written for this K.
    """
    camera, K = calibration.camera, calibration.intrinsics
    width, height = K.image_size
    found = load_catalogue().find(
        camera.make, camera.model, sub_camera=camera.sub_camera, size=K.image_size, focal_mm=camera.focal_mm
    )
    if found.camera is not None and found.camera.focal_35mm is not None:
        focals = {found.camera.focal_35mm}
    else:
        usual = [K.fx / max(width, height) * FILM_MM, K.fx / math.hypot(width, height) * DIAGONAL_MM]
        lowest, highest = min(usual) * (1 - ROUNDING), max(usual) * (1 + ROUNDING)
        focals = {float(mm) for mm in range(math.floor(lowest), math.ceil(highest) + 1)}
    return {
        _name(camera.make or "", camera.model or "", K.image_size, kind, prior)
        for kind in ODM_PROJECTIONS
        for prior in (*(focal / FILM_MM for focal in focals), ODM_UNKNOWN)
    }


def _name(make: str, model: str, size: ImageSize, projection: str, focal_over_width: float) -> str:
    words = (make.strip(), model.strip(), str(size[0]), str(size[1]), projection)
    return " ".join((*words, str(focal_over_width)[:6])).lower()


def _opensfm_priors(metadata: ImageMetadata, size: ImageSize) -> set[float]:
    """OpenSfM's possible priors of focal length ÷ width; 0 if EXIF gives none.

    FocalLengthIn35mmFilm ÷ 36 mm, in newer releases ÷ 34 mm unless the aspect ratio is 3:2 or longer; else
    FocalLength ÷ width of the focal plane, else ÷ that of the camera's sensor in its table.
    """
    if metadata.focal_35mm is None:
        return {_over_sensor(metadata, size) or 0.0}
    guesses = {metadata.focal_35mm / FILM_MM}
    aspect = max(size) / min(size)
    if abs(aspect - 4 / 3) <= abs(aspect - 3 / 2):
        guesses.add(metadata.focal_35mm / 34.0)
    return guesses


def _odm_name(stated: ImageMetadata, projection: str) -> str:
    metadata = ImageMetadata(size=stated.size) if stated.exif_in_text else stated
    if metadata.focal_35mm is not None:
        prior = metadata.focal_35mm / FILM_MM
    else:
        prior = _over_sensor(metadata, metadata.size) or ODM_UNKNOWN
    return _name(metadata.make or "", metadata.model or "", metadata.size, projection, prior)


def _over_sensor(metadata: ImageMetadata, size: ImageSize) -> float | None:
    resolution, unit = metadata.focal_plane_resolution, metadata.focal_plane_unit
    if metadata.focal_mm is None:
        return None
    if resolution is None or unit is None:
        make = metadata.make or ""
        width = SENSOR_MM.get(f"{make} {(metadata.model or '').replace(make, '').strip()}".lower())
        return metadata.focal_mm / width if width is not None else None
    return metadata.focal_mm / (size[0] / resolution[0] * unit.millimetres)
