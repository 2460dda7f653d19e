"""An image file as a source of a calibration: K from its metadata, with the same evidence as ``extract``."""

from __future__ import annotations

import io
from pathlib import Path

from calibrary.calibration import Calibration
from calibrary.catalogue import load_catalogue, match_image
from calibrary.errors import MissingTagError, ParseError
from calibrary.evidence.context import UNCONFIRMED, Scene
from calibrary.evidence.identity import camera_key
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.originality import originality
from calibrary.evidence.weighing import Evidence, evidence_of
from calibrary.parsers.files import display_name
from calibrary.parsers.imagery import Source, read_metadata, read_source
from calibrary.records import replace


def image_evidence(path: Path) -> Evidence:
    """All evidence about K from one image and from the catalogue's entry of its camera.

    Raises:
        InputError: the file cannot be read.
        ParseError: it is not an image.
    """
    return _evidence(read_metadata(path))


def read_image(path: Path) -> list[Calibration]:
    """Read the calibration from an image's metadata; no sensor size is assumed.

    Raises:
        InputError: the file cannot be read.
        ParseError: it is not an image, or its EXIF belongs to another image size.
        MissingTagError: nothing in it determines K.
    """
    return _calibration(image_evidence(path), display_name(path))


def decode_image(data: bytes, name: str) -> list[Calibration]:
    """As :func:`read_image`, for an image in memory.

    Raises:
        ParseError: it is not an image, or its EXIF is of another frame.
        MissingTagError: nothing in it determines K.
    """
    return _calibration(evidence_in(data, name), name)


def evidence_in(data: bytes, name: str) -> Evidence:
    """As :func:`image_evidence`, for an image in memory.

    Raises:
        ParseError: it is not an image.
    """
    return _evidence(read_source(Source(io.BytesIO(data), name=name, size=len(data))))


def _evidence(metadata: ImageMetadata) -> Evidence:
    match = match_image(load_catalogue(), metadata)
    camera, siblings = match.camera, match.siblings or match.candidates
    if camera is not None and camera.gives_k:
        return evidence_of(Scene(metadata=metadata, known=camera, siblings=siblings))
    from calibrary.catalogue.sensor_widths import listed_width  # noqa: PLC0415  rarely needed

    listed = listed_width(camera, metadata.make, metadata.model)
    return evidence_of(Scene(metadata=metadata, known=camera, siblings=siblings, weighs=True, listed=listed))


def _calibration(evidence: Evidence, name: str) -> list[Calibration]:
    if evidence.contradiction is not None:
        raise ParseError(evidence.contradiction, source=name)
    scene = evidence.scene
    inferred = scene.known.sub_camera if scene.known is not None else None
    calibration = evidence.calibration(camera_key(scene.metadata, inferred), source_name=name)
    # A width that others list of a camera's name, or that is inferred, speaks against a tag, and is no statement of the
    # image.
    chosen = evidence.chosen
    is_stated = chosen is not None and chosen.grade.is_metric and chosen.source not in UNCONFIRMED
    if calibration is not None and is_stated:
        doubts = (f"the image was {done}" for done in originality(scene.metadata, scene.known).done)
        return [replace(calibration, notes=(*calibration.notes, *doubts))]
    if scene.is_fisheye:
        raise MissingTagError("a fisheye lens, which no pinhole K describes", source=name)
    reasons = [f"{dropped.tag}: {dropped.reason}" for dropped in evidence.dropped[:1]]
    why = reasons[0] if reasons else "no tag and no catalogue entry states its focal length and pixel size"
    raise MissingTagError(
        f"nothing in the image gives K: {why}; provide the original file from the camera, as programs that export "
        "images may leave out its metadata, or a calibration file",
        source=name,
    )
