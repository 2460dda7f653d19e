"""What the metadata of an image states about its camera: facts only, no conclusions.

A record contains no file name, date, position or raw serial number, so all images of one camera in one state
give equal records: of a hundred thousand files, one record per camera state is kept.
"""

from __future__ import annotations

import math
from enum import StrEnum

from msgspec import Struct

from calibrary.image_size import ImageSize
from calibrary.known_camera import normalise_sub_camera

SUB_CAMERA_TAGS = (
    # The band identifies the camera of a multispectral head more precisely than its image source.
    ("Camera", "BandName"),
    ("drone-dji", "BandName"),
    ("drone-dji", "ImageSource"),
    ("drone-skydio", "CameraSource"),
)

SMALLEST_ZOOM = 1.01
"""A smaller zoom changes K by less than its uncertainty."""


class FocalPlaneUnit(StrEnum):
    """EXIF FocalPlaneResolutionUnit (0xA210); the value is the text shown to the user."""

    INCH = "pixels per inch"
    CENTIMETRE = "pixels per centimetre"
    MILLIMETRE = "pixels per millimetre"
    MICROMETRE = "pixels per micrometre"

    @property
    def millimetres(self) -> float:
        """Length of one unit in mm."""
        return {"inch": 25.4, "centimetre": 10.0, "millimetre": 1.0, "micrometre": 0.001}[self.name.lower()]


class TagFault(Struct, frozen=True):
    """A tag that is present but unusable.

    Attributes:
        tag: name as users know it, such as "EXIF FocalLength".
        found: what the tag contains, shortened.
        expected: what a usable tag contains.
    """

    tag: str
    found: str
    expected: str


class XmpProperty(Struct, frozen=True):
    """One XMP property that concerns the camera.

    Attributes:
        schema: the canonical name of its namespace ("drone-dji", "Camera", "drone-skydio", …), whatever
            prefix or spelling of the URI the file used.
        name: local name; a member of a structure is "Structure/member".
        values: one string, or the items of an rdf:Seq or rdf:Bag in order.
    """

    schema: str
    name: str
    values: tuple[str, ...]


class Encoding(Struct, frozen=True, kw_only=True):
    """How a JPEG is written: what a camera's encoder does in all its images, and what saving it again changes.

    Attributes:
        segments: the application segments that a kind of program writes ("JFIF", "Exif", "MPF", "ICC", "FPXR",
            "Photoshop", "Adobe"), in their order.
        sampling: (horizontal, vertical) of each component.
        standard_tables: whether all quantisation tables are those of the standard's annex K, scaled as libjpeg does.
        turned_tables: whether they are so with rows and columns exchanged, as turning a JPEG by 90° without decoding it
            leaves them.
        split_tables: whether each quantisation table stands in a segment of its own, as libjpeg and what builds on it
            write them; the encoders of most cameras write all into one.
        standard_codes: whether the first Huffman table is that of annex K.
        progressive: whether the frame is progressive.
        restarts: whether there are restart intervals.
    """

    segments: tuple[str, ...] = ()
    sampling: tuple[tuple[int, int], ...] = ()
    standard_tables: bool = False
    turned_tables: bool = False
    split_tables: bool = False
    standard_codes: bool = False
    progressive: bool = False
    restarts: bool = False


class ImageMetadata(Struct, frozen=True, kw_only=True):
    """Everything that the header of one image states about the camera.

    A number is None if its tag is absent or unusable; unusable tags are listed in ``faults``.

    Attributes:
        size: (width, height) in px as decoded, orientation not applied.
        exif_size: EXIF PixelXDimension × PixelYDimension (0xA002, 0xA003).
        related_size: RelatedImageWidth × RelatedImageHeight (0x1001, 0x1002) of EXIF's interoperability directory.
        main_size: ImageWidth × ImageLength (0x0100, 0x0101) of EXIF's first directory, which phones write.
        orientation: EXIF Orientation (0x0112), 1 … 8.
        make, model, software, lens: EXIF strings, padding stripped; XMP tiff:Make/Model if EXIF has none.
        focal_mm: EXIF FocalLength (0x920A), > 0.
        focal_35mm: EXIF FocalLengthIn35mmFilm (0xA405); 0 means unknown and is None.
        digital_zoom: EXIF DigitalZoomRatio (0xA404); 0 and undefined are None.
        focal_plane_resolution: (x, y) in ``focal_plane_unit`` (0xA20E, 0xA20F).
        focal_plane_unit: None when the tag (0xA210) is absent or unknown.
        serial: hash of the strongest serial number found.
        xmp: the properties that concern the camera, in document order.
        faults: tags that are present but unusable.
        has_exif: whether the file contains any EXIF.
        has_maker_note: whether EXIF has a MakerNote (0x927C) of more than a few bytes.
        has_thumbnail: whether EXIF has a directory for a thumbnail.
        whole_frame: whether the thumbnail shows the image and nothing beside it; None if that was not looked at or does
            not tell.
        byte_order: of EXIF, "<" or ">"; None without EXIF.
        encoding: of a JPEG; None for other files.
        exif_in_text: whether EXIF exists only in GDAL's text, where other programs do not find it.
        stated: what a person states in place of the file: "camera" is make and model, "focal" the focal length.
    """

    size: ImageSize
    exif_size: ImageSize | None = None
    related_size: ImageSize | None = None
    main_size: ImageSize | None = None
    orientation: int | None = None
    make: str | None = None
    model: str | None = None
    software: str | None = None
    lens: str | None = None
    focal_mm: float | None = None
    focal_35mm: float | None = None
    digital_zoom: float | None = None
    focal_plane_resolution: tuple[float, float] | None = None
    focal_plane_unit: FocalPlaneUnit | None = None
    serial: str | None = None
    xmp: tuple[XmpProperty, ...] = ()
    faults: tuple[TagFault, ...] = ()
    has_exif: bool = False
    has_maker_note: bool = False
    has_thumbnail: bool = False
    whole_frame: bool | None = None
    byte_order: str | None = None
    encoding: Encoding | None = None
    exif_in_text: bool = False
    stated: frozenset[str] = frozenset()

    @property
    def zoom(self) -> float:
        """Factor by which digital zoom enlarged the image; 1.0 also for values such as a phone's 1.0007."""
        zoom = self.digital_zoom or 1.0
        return zoom if zoom > SMALLEST_ZOOM else 1.0

    @property
    def sub_camera(self) -> str | None:
        """The sub-camera that a tag names, in the common vocabulary, or None if no tag does."""
        for schema, name in SUB_CAMERA_TAGS:
            values = self.xmp_values(schema, name)
            named = normalise_sub_camera(",".join(values)) if values else None
            if named is not None:
                return named
        index = self.xmp_text("Camera", "RigCameraIndex")
        return f"rig-{index}" if index is not None and index.isascii() and index.isdecimal() else None

    def xmp_values(self, schema: str, name: str) -> tuple[str, ...] | None:
        """The values of one XMP property, or None when it is absent."""
        for item in self.xmp:
            if item.schema == schema and item.name == name:
                return item.values
        return None

    def xmp_text(self, schema: str, name: str) -> str | None:
        """One XMP property as stripped text (items joined by commas), or None when absent or empty."""
        values = self.xmp_values(schema, name)
        text = ",".join(values).strip() if values else ""
        return text or None

    def fault(self, tag: str) -> TagFault | None:
        """The fault of a tag, or None if it has none."""
        return next((fault for fault in self.faults if fault.tag == tag), None)


def as_float(text: str) -> float | None:
    """The number in a tag's text: ASCII digits and finite.

    None for full-width digits, underscores, "nan", "infinity" and any other text, some of which float() accepts.
    """
    if not text.isascii() or "_" in text:
        return None
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
