"""EXIF written by hand: every tag with its type as the standard has it, or wrong on purpose.

Names, numbers and types are those of CIPA DC-008 (Exif 2.32), with the few TIFF, DNG and Windows tags that
UAV cameras add. Image programs refuse to write a focal length of 5/0; some cameras have, so this can.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType

from calibrary.calibration import ImageSize
from calibrary.errors import InputError
from tests.imagery.structure import (
    ByteOrder,
    Chunks,
    Field,
    FieldType,
    FieldValues,
    Ifd,
    Rational,
    encode,
)


class Directory(Enum):
    """Where a tag lives."""

    IMAGE = "IFD0"
    EXIF = "Exif IFD"
    GPS = "GPS IFD"
    INTEROPERABILITY = "Interoperability IFD"


_EXIF_POINTER, _GPS_POINTER, _INTEROPERABILITY_POINTER = 0x8769, 0x8825, 0xA005


@dataclass(frozen=True, slots=True)
class Tag:
    """What the standard says of one tag."""

    directory: Directory
    number: int
    type: FieldType


def _tags(directory: Directory, **numbers: tuple[int, FieldType]) -> dict[str, Tag]:
    return {name: Tag(directory, number, kind) for name, (number, kind) in numbers.items()}


TAGS = MappingProxyType(
    _tags(
        Directory.IMAGE,
        ImageDescription=(0x010E, FieldType.ASCII),
        Make=(0x010F, FieldType.ASCII),
        Model=(0x0110, FieldType.ASCII),
        Orientation=(0x0112, FieldType.SHORT),
        XResolution=(0x011A, FieldType.RATIONAL),
        YResolution=(0x011B, FieldType.RATIONAL),
        ResolutionUnit=(0x0128, FieldType.SHORT),
        Software=(0x0131, FieldType.ASCII),
        DateTime=(0x0132, FieldType.ASCII),
        Artist=(0x013B, FieldType.ASCII),
        YCbCrPositioning=(0x0213, FieldType.SHORT),
        XPComment=(0x9C9C, FieldType.BYTE),
        XPKeywords=(0x9C9E, FieldType.BYTE),
        DNGVersion=(0xC612, FieldType.BYTE),
        UniqueCameraModel=(0xC614, FieldType.ASCII),
        CameraSerialNumber=(0xC62F, FieldType.ASCII),
    )
    | _tags(
        Directory.EXIF,
        ExposureTime=(0x829A, FieldType.RATIONAL),
        FNumber=(0x829D, FieldType.RATIONAL),
        ExposureProgram=(0x8822, FieldType.SHORT),
        PhotographicSensitivity=(0x8827, FieldType.SHORT),
        ExifVersion=(0x9000, FieldType.UNDEFINED),
        DateTimeOriginal=(0x9003, FieldType.ASCII),
        DateTimeDigitized=(0x9004, FieldType.ASCII),
        ComponentsConfiguration=(0x9101, FieldType.UNDEFINED),
        CompressedBitsPerPixel=(0x9102, FieldType.RATIONAL),
        ShutterSpeedValue=(0x9201, FieldType.SRATIONAL),
        ApertureValue=(0x9202, FieldType.RATIONAL),
        ExposureBiasValue=(0x9204, FieldType.SRATIONAL),
        MaxApertureValue=(0x9205, FieldType.RATIONAL),
        SubjectDistance=(0x9206, FieldType.RATIONAL),
        MeteringMode=(0x9207, FieldType.SHORT),
        LightSource=(0x9208, FieldType.SHORT),
        Flash=(0x9209, FieldType.SHORT),
        FocalLength=(0x920A, FieldType.RATIONAL),
        MakerNote=(0x927C, FieldType.UNDEFINED),
        UserComment=(0x9286, FieldType.UNDEFINED),
        FlashpixVersion=(0xA000, FieldType.UNDEFINED),
        ColorSpace=(0xA001, FieldType.SHORT),
        PixelXDimension=(0xA002, FieldType.LONG),
        PixelYDimension=(0xA003, FieldType.LONG),
        FocalPlaneXResolution=(0xA20E, FieldType.RATIONAL),
        FocalPlaneYResolution=(0xA20F, FieldType.RATIONAL),
        FocalPlaneResolutionUnit=(0xA210, FieldType.SHORT),
        ExposureIndex=(0xA215, FieldType.RATIONAL),
        FileSource=(0xA300, FieldType.UNDEFINED),
        SceneType=(0xA301, FieldType.UNDEFINED),
        CustomRendered=(0xA401, FieldType.SHORT),
        ExposureMode=(0xA402, FieldType.SHORT),
        WhiteBalance=(0xA403, FieldType.SHORT),
        DigitalZoomRatio=(0xA404, FieldType.RATIONAL),
        FocalLengthIn35mmFilm=(0xA405, FieldType.SHORT),
        SceneCaptureType=(0xA406, FieldType.SHORT),
        GainControl=(0xA407, FieldType.SHORT),
        Contrast=(0xA408, FieldType.SHORT),
        Saturation=(0xA409, FieldType.SHORT),
        Sharpness=(0xA40A, FieldType.SHORT),
        SubjectDistanceRange=(0xA40C, FieldType.SHORT),
        BodySerialNumber=(0xA431, FieldType.ASCII),
        LensSpecification=(0xA432, FieldType.RATIONAL),
        LensMake=(0xA433, FieldType.ASCII),
        LensModel=(0xA434, FieldType.ASCII),
        LensSerialNumber=(0xA435, FieldType.ASCII),
    )
    | _tags(
        Directory.GPS,
        GPSVersionID=(0x0000, FieldType.BYTE),
        GPSLatitudeRef=(0x0001, FieldType.ASCII),
        GPSLatitude=(0x0002, FieldType.RATIONAL),
        GPSLongitudeRef=(0x0003, FieldType.ASCII),
        GPSLongitude=(0x0004, FieldType.RATIONAL),
        GPSAltitudeRef=(0x0005, FieldType.BYTE),
        GPSAltitude=(0x0006, FieldType.RATIONAL),
        GPSMapDatum=(0x0012, FieldType.ASCII),
        GPSDateStamp=(0x001D, FieldType.ASCII),
    )
    | _tags(
        Directory.INTEROPERABILITY,
        InteroperabilityIndex=(0x0001, FieldType.ASCII),
        InteroperabilityVersion=(0x0002, FieldType.UNDEFINED),
    )
)
"""Every tag that can be written by its name."""


@dataclass(frozen=True, slots=True)
class ExifField:
    """One tag by its name.

    Attributes:
        name: a key of :data:`TAGS`.
        values: text, bytes, or a tuple of numbers (a rational is itself a pair).
        type: another type than the standard's, on purpose.
        count: how many values it claims, where that is a lie.
        offset: where it claims they are, where that is a lie.
    """

    name: str
    values: FieldValues
    type: int | None = None
    count: int | None = None
    offset: int | None = None

    def field(self) -> tuple[Directory, Field]:
        """The directory it belongs to, and its entry there.

        Raises:
            InputError: no tag has this name.
        """
        tag = TAGS.get(self.name)
        if tag is None:
            raise InputError(f"no tag is called {self.name!r}; expected one of {', '.join(TAGS)}")
        kind = tag.type if self.type is None else self.type
        entry = Field(tag=tag.number, type=kind, values=self.values, count=self.count, offset=self.offset)
        return tag.directory, entry


@dataclass(frozen=True, slots=True, kw_only=True)
class GpsPosition:
    """Where a camera was: degrees north and east, metres above the ellipsoid."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float

    def fields(self) -> Iterator[ExifField]:
        """Degrees, minutes and seconds as the GPS directory wants them."""
        yield ExifField("GPSVersionID", (2, 3, 0, 0))
        yield ExifField("GPSLatitudeRef", "N" if self.latitude_deg >= 0 else "S")
        yield ExifField("GPSLatitude", _sexagesimal(self.latitude_deg))
        yield ExifField("GPSLongitudeRef", "E" if self.longitude_deg >= 0 else "W")
        yield ExifField("GPSLongitude", _sexagesimal(self.longitude_deg))
        yield ExifField("GPSAltitudeRef", (0 if self.altitude_m >= 0 else 1,))
        yield ExifField("GPSAltitude", ((round(abs(self.altitude_m) * 1000), 1000),))
        yield ExifField("GPSMapDatum", "WGS-84")


@dataclass(frozen=True, slots=True, kw_only=True)
class ExifTags:
    """What a camera writes about a picture; what is None is not written.

    Attributes:
        make, model, software, description: of IFD0.
        date_time: "2024:05:17 09:30:00", written to all three date tags.
        orientation: 1 … 8.
        exposure_time, f_number, iso: of the exposure.
        focal_mm: FocalLength.
        focal_35mm: FocalLengthIn35mmFilm.
        digital_zoom: DigitalZoomRatio.
        pixel_size: PixelXDimension × PixelYDimension.
        focal_plane_resolution: (x, y).
        focal_plane_unit: 2 inch, 3 cm, 4 mm, 5 µm.
        lens_make, lens_model, body_serial: as text.
        lens_specification: shortest and longest focal length in mm, f-number at each.
        maker_note: the maker's own block.
        position: makes a GPS directory.
        thumbnail: a JPEG, makes IFD1.
        overrides: further tags; one of these replaces the tag of its name from the attributes above.
        byte_order: of the whole block.
    """

    make: str | None = None
    model: str | None = None
    software: str | None = None
    description: str | None = None
    date_time: str | None = None
    orientation: int | None = None
    exposure_time: Rational | None = None
    f_number: Rational | None = None
    iso: int | None = None
    focal_mm: Rational | None = None
    focal_35mm: int | None = None
    digital_zoom: Rational | None = None
    pixel_size: ImageSize | None = None
    focal_plane_resolution: tuple[Rational, Rational] | None = None
    focal_plane_unit: int | None = None
    lens_make: str | None = None
    lens_model: str | None = None
    lens_specification: tuple[Rational, Rational, Rational, Rational] | None = None
    body_serial: str | None = None
    maker_note: bytes | None = None
    position: GpsPosition | None = None
    thumbnail: bytes | None = None
    overrides: tuple[ExifField, ...] = ()
    byte_order: ByteOrder = ByteOrder.LITTLE

    def encode(self) -> bytes:
        """The TIFF part of an EXIF block; a JPEG wants "Exif" and two zero bytes before it.

        Raises:
            InputError: an override has an unknown name, or values that do not fit its type.
        """
        return encode(self.directories(), self.byte_order)

    def directories(self) -> tuple[Ifd, ...]:
        """IFD0 with its children, and IFD1 where there is a thumbnail."""
        fields: dict[Directory, list[Field]] = {directory: [] for directory in Directory}
        for item in self._items():
            directory, field = item.field()
            fields[directory].append(field)
        interoperability = _child(_INTEROPERABILITY_POINTER, fields[Directory.INTEROPERABILITY])
        exif = _child(_EXIF_POINTER, fields[Directory.EXIF], interoperability)
        gps = _child(_GPS_POINTER, fields[Directory.GPS])
        image = Ifd(fields=tuple(fields[Directory.IMAGE]), children=exif + gps)
        return (image,) if self.thumbnail is None else (image, _thumbnail(self.thumbnail))

    def _items(self) -> Iterator[ExifField]:
        replaced = {item.name for item in self.overrides}
        yield from (item for item in self._told() if item.name not in replaced)
        yield from self.overrides

    def _told(self) -> Iterator[ExifField]:
        texts = {
            "ImageDescription": self.description,
            "Make": self.make,
            "Model": self.model,
            "Software": self.software,
            "DateTime": self.date_time,
            "DateTimeOriginal": self.date_time,
            "DateTimeDigitized": self.date_time,
            "LensMake": self.lens_make,
            "LensModel": self.lens_model,
            "BodySerialNumber": self.body_serial,
        }
        numbers = {
            "Orientation": self.orientation,
            "PhotographicSensitivity": self.iso,
            "FocalLengthIn35mmFilm": self.focal_35mm,
            "FocalPlaneResolutionUnit": self.focal_plane_unit,
            "PixelXDimension": self.pixel_size[0] if self.pixel_size else None,
            "PixelYDimension": self.pixel_size[1] if self.pixel_size else None,
        }
        ratios = {
            "ExposureTime": self.exposure_time,
            "FNumber": self.f_number,
            "FocalLength": self.focal_mm,
            "DigitalZoomRatio": self.digital_zoom,
            "FocalPlaneXResolution": self.focal_plane_resolution[0] if self.focal_plane_resolution else None,
            "FocalPlaneYResolution": self.focal_plane_resolution[1] if self.focal_plane_resolution else None,
        }
        yield from (ExifField(name, text) for name, text in texts.items() if text is not None)
        yield from (ExifField(name, (number,)) for name, number in numbers.items() if number is not None)
        yield from (ExifField(name, (ratio,)) for name, ratio in ratios.items() if ratio is not None)
        if self.lens_specification is not None:
            yield ExifField("LensSpecification", self.lens_specification)
        if self.maker_note is not None:
            yield ExifField("MakerNote", self.maker_note)
        if self.position is not None:
            yield from self.position.fields()


def _child(
    pointer: int, fields: list[Field], children: tuple[tuple[int, Ifd], ...] = ()
) -> tuple[tuple[int, Ifd], ...]:
    return ((pointer, Ifd(fields=tuple(fields), children=children)),) if fields or children else ()


def _thumbnail(jpeg: bytes) -> Ifd:
    compression = Field(tag=0x0103, type=FieldType.SHORT, values=(6,))
    return Ifd(fields=(compression,), chunks=Chunks(offsets_tag=0x0201, counts_tag=0x0202, chunks=(jpeg,)))


def _sexagesimal(degrees: float) -> tuple[Rational, ...]:
    # Ten-thousandths of a second (3 mm on the ground), counted as whole numbers so that 59.99996″ carries.
    minutes, ticks = divmod(round(abs(degrees) * 36_000_000), 600_000)
    whole, minutes = divmod(minutes, 60)
    return ((whole, 1), (minutes, 1), (ticks, 10_000))
