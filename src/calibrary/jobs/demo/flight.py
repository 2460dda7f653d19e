"""Files of a flight with different cameras: good images, and examples of common faults.

The pictures compress well: drawn small and enlarged smoothly.

Metadata that the demo's cameras write into their images: tags as the makers spell them, with invented values.

Tags, namespaces and forms follow real files of these cameras; all calibrations, serial numbers, hosts and
positions are invented. ``example`` is a reserved domain (RFC 2606).
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from datetime import datetime, timedelta
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary.calibration import Grade, ImageSize
from calibrary.records import replace
from calibrary.synthetic import (
    ExifValue,
    Head,
    Position,
    Rational,
    description,
    headed,
    jpeg,
    packet,
    write_image,
)

T = TypeVar("T")

_DJI_PACKET_BYTES = 8159
"""DJI pads its XMP segment to 8190 bytes, of which 29 are the segment's name and two its length."""


_DJI_CONSTANTS: dict[str, ExifValue] = {
    "XResolution": (72, 1),
    "YResolution": (72, 1),
    "ResolutionUnit": 2,
    "YCbCrPositioning": 1,
    "ExifVersion": b"0230",
    "ComponentsConfiguration": b"\1\2\3\0",
    "ShutterSpeedValue": (9643, 1000),
    "ApertureValue": (497, 100),
    "SubjectDistance": (0, 0),
    "FlashPixVersion": b"0100",
    "ColorSpace": 1,
    "FileSource": b"\3",
    "SceneType": b"\1",
    "MakerNote": b"DJI MakerNotes\0",
}
"""Tags that are equal in all DJI images; the resolution is that of a print, not of the focal plane."""


class Shot(Struct, frozen=True, kw_only=True):
    """The values that differ between images of one camera."""

    taken: datetime
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    yaw_deg: float

    @property
    def exif_time(self) -> str:
        """Date and time in EXIF's format."""
        return f"{self.taken:%Y:%m:%d %H:%M:%S}"

    @property
    def position(self) -> Position:
        """Position for EXIF's GPS directory."""
        return Position(
            latitude_deg=self.latitude_deg, longitude_deg=self.longitude_deg, altitude_m=self.altitude_m
        )

    @property
    def private(self) -> tuple[str, ...]:
        """The position truncated (not rounded) to 10 m, so that it is a prefix of every more precise form."""
        return tuple(f"{degrees:.8f}"[:-4] for degrees in (self.latitude_deg, self.longitude_deg))


class Band(Struct, frozen=True, kw_only=True):
    """One lens of a multispectral rig and its factory calibration.

    Attributes:
        name, index: as in XMP.
        wavelength_nm, width_nm: of the filter.
        focal_mm: calibrated focal length.
        principal_point_mm: from the upper left corner.
        distortion: k1, k2, k3, p1, p2, in MicaSense's order.
    """

    name: str
    index: int
    wavelength_nm: int
    width_nm: int
    focal_mm: float
    principal_point_mm: tuple[float, float]
    distortion: tuple[float, float, float, float, float]


def phantom_4_rtk(shot: Shot) -> Head:
    """FC6310R: individual calibration in DewarpData, principal point as an offset from the image centre."""
    serial = "5f1d0c7a9be24d3c8a60e1b2d4f79a35"
    calibrated = {
        "CalibratedFocalLength": "3666.666504",
        "CalibratedOpticalCenterX": "2736.000000",
        "CalibratedOpticalCenterY": "1824.000000",
        "DewarpData": "2018-09-07;3659.410000000000,3652.870000000000,-4.610000000000,23.480000000000,"
        "-0.267130000000,0.112460000000,0.000812000000,-0.000104000000,-0.033910000000",
        "DewarpFlag": "0",
    }
    exif = _dji_exif(
        shot,
        model="FC6310R",
        software="v01.09.1691",
        body_serial=serial,
        focal_mm=(88, 10),
        focal_35mm=24,
        digital_zoom=(0, 0),
        pixel_size=(5472, 3648),
    )
    rtk = {"RtkFlag": "50", "RtkStdLon": "0.01102", "RtkStdLat": "0.01187", "RtkStdHgt": "0.02519"}
    return _dji_head(shot, exif, "FC6310R", calibrated | rtk, serial)


def mavic_3t_wide(shot: Shot) -> Head:
    """M3T, the visible wide camera: 24 mm equivalent on a half-inch sensor, no calibration."""
    return _mavic_3t_head(
        shot, source="WideCamera", focal_mm=(4400, 1000), focal_35mm=24, pixel_size=(8000, 6000)
    )


def mavic_3t_infrared(shot: Shot) -> Head:
    """M3T, the thermal camera, with the same EXIF Model."""
    return _mavic_3t_head(
        shot, source="InfraredCamera", focal_mm=(9100, 1000), focal_35mm=40, pixel_size=(640, 512)
    )


def _mavic_3t_head(
    shot: Shot, *, source: str, focal_mm: Rational, focal_35mm: int, pixel_size: ImageSize
) -> Head:
    drone, camera = "1581F5EXAMPLE00C42V7", "5L4EXAMPLE42C9"
    host, mount = "caster.survey.example", "VRSDEMO42"
    exif = _dji_exif(
        shot,
        model="M3T",
        software="10.12.05.45",
        body_serial=drone,
        focal_mm=focal_mm,
        focal_35mm=focal_35mm,
        digital_zoom=(1, 1),
        pixel_size=pixel_size,
    )
    stated = {
        "ImageSource": source,
        "GpsStatus": "RTK",
        "RtkFlag": "50",
        "NTRIPMountPoint": mount,
        "NTRIPPort": "2101",
        "NTRIPHost": host,
        "CameraSerialNumber": camera,
        "DroneModel": "M3T",
        "DroneSerialNumber": drone,
    }
    return _dji_head(shot, exif, "M3T", stated, drone, camera, host, mount)


def phantom_4_pro(shot: Shot, pixel_size: ImageSize, *, zoom: int | None = None) -> Head:
    """FC6310: only a focal length, no calibration; ``zoom`` is digital."""
    serial = "a41c66e07b9d4f0f93d25ce8170b6e42"
    exif = _dji_exif(
        shot,
        model="FC6310",
        software="v01.05.5432",
        body_serial=serial,
        focal_mm=(88, 10),
        focal_35mm=24,
        digital_zoom=(zoom, 1) if zoom is not None else (0, 0),
        pixel_size=pixel_size,
    )
    return _dji_head(shot, exif, "FC6310", {}, serial)


def phantom_4(shot: Shot) -> Head:
    """FC330 with early firmware, which writes 0/0 as the focal length."""
    serial = "77b0f3d2c1a84e6e9f5b3a2d1c0e8f64"
    exif = _dji_exif(
        shot,
        model="FC330",
        software="v01.00.1312",
        body_serial=serial,
        focal_mm=(0, 0),
        focal_35mm=20,
        digital_zoom=(0, 0),
        pixel_size=(4000, 3000),
    )
    return _dji_head(shot, exif, "FC330", {}, serial)


def rededge_m(shot: Shot, band: Band) -> Head:
    """RedEdge-M with firmware 3, which writes its calibration in mm and states the unit."""
    serial, light_sensor = "RM01-4200042-EX", "DL06-4200042-EX"
    about = "Pix4D Camera Information"
    flight: dict[str, str | tuple[str, ...]] = {
        "BootTimestamp": "395",
        "FlightId": "exampleFlight0042",
        "TriggerMethod": "0",
    }
    camera: dict[str, str | tuple[str, ...]] = {
        "BandName": band.name,
        "CentralWavelength": str(band.wavelength_nm),
        "WavelengthFWHM": str(band.width_nm),
        "ModelType": "perspective",
        "PrincipalPoint": "{:.5f},{:.5f}".format(*band.principal_point_mm),
        "PerspectiveFocalLength": f"{band.focal_mm:.14f}",
        "PerspectiveFocalLengthUnits": "mm",
        "PerspectiveDistortion": tuple(f"{value:.12f}" for value in band.distortion),
        "RigCameraIndex": str(band.index),
    }
    exif: dict[str, ExifValue] = {
        "Make": "MicaSense",
        "Model": "RedEdge-M",
        "Software": "v3.3.0",
        "DateTime": shot.exif_time,
        "DateTimeOriginal": shot.exif_time,
        "DateTimeDigitized": shot.exif_time,
        "Orientation": 1,
        "ExposureTime": (1, 1250),
        "FNumber": (28, 10),
        "ExifVersion": b"0230",
        "FocalLength": (55, 10),
        "FocalPlaneXResolution": (266_666_667, 1_000_000),
        "FocalPlaneYResolution": (266_666_667, 1_000_000),
        "FocalPlaneResolutionUnit": 4,
        "BodySerialNumber": serial,
    }
    xmp = packet(
        (
            description(about, elements=_prefixed("MicaSense", flight)),
            description(about, elements=_prefixed("Camera", camera)),
            description(about, elements={"DLS:Serial": light_sensor, "DLS:SwVersion": "v1.0.1"}),
        ),
        toolkit="XMP Core 4.4.0",
    )
    return Head(exif=exif, position=shot.position, xmp=xmp, private=(*shot.private, serial, light_sensor))


def _dji_exif(
    shot: Shot,
    *,
    model: str,
    software: str,
    body_serial: str,
    focal_mm: Rational,
    focal_35mm: int,
    digital_zoom: Rational,
    pixel_size: ImageSize,
) -> dict[str, ExifValue]:
    return _DJI_CONSTANTS | {
        "Make": "DJI",
        "Model": model,
        "Software": software,
        "ImageDescription": "default",
        "DateTime": shot.exif_time,
        "DateTimeOriginal": shot.exif_time,
        "DateTimeDigitized": shot.exif_time,
        "Orientation": 1,
        "ExposureTime": (1, 800),
        "FNumber": (56, 10),
        "ISOSpeedRatings": 100,
        "FocalLength": focal_mm,
        "FocalLengthIn35mmFilm": focal_35mm,
        "DigitalZoomRatio": digital_zoom,
        "ExifImageWidth": pixel_size[0],
        "ExifImageHeight": pixel_size[1],
        "BodySerialNumber": body_serial,
    }


def _dji_head(
    shot: Shot, exif: dict[str, ExifValue], model: str, stated: dict[str, str], *private: str
) -> Head:
    local = f"{shot.taken:%Y-%m-%dT%H:%M:%S}+02:00"
    utc = shot.taken - timedelta(hours=2)
    pose = {
        "GpsLatitude": f"{shot.latitude_deg:+.8f}",
        # The misspelling is DJI's.
        "GpsLongtitude": f"{shot.longitude_deg:+.8f}",
        "AbsoluteAltitude": f"{shot.altitude_m:+.3f}",
        "RelativeAltitude": "+80.013",
        "GimbalRollDegree": "+0.00",
        "GimbalYawDegree": f"{shot.yaw_deg:+.2f}",
        "GimbalPitchDegree": "-90.00",
        "FlightRollDegree": "+1.20",
        "FlightYawDegree": f"{shot.yaw_deg:+.2f}",
        "FlightPitchDegree": "-2.10",
        "CamReverse": "0",
        "GimbalReverse": "0",
        "SelfData": "",
        "UTCAtExposure": f"{utc:%Y-%m-%dT%H:%M:%S}.000000",
    }
    editing = {"Version": "7.0", "HasSettings": "False", "HasCrop": "False", "AlreadyApplied": "False"}
    attributes = {
        **_prefixed("xmp", {"ModifyDate": local, "CreateDate": local}),
        **_prefixed("tiff", {"Make": "DJI", "Model": model}),
        **_prefixed("dc", {"format": "image/jpg"}),
        **_prefixed("drone-dji", pose | stated),
        **_prefixed("crs", editing),
    }
    xmp = packet([description("DJI Meta Data", attributes=attributes)], length=_DJI_PACKET_BYTES)
    return Head(exif=exif, position=shot.position, xmp=xmp, private=(*shot.private, *private))


def _prefixed(prefix: str, properties: dict[str, T]) -> dict[str, T]:
    return {f"{prefix}:{name}": value for name, value in properties.items()}


_STEP = 24
"""Picture pixels per drawn cell."""
_WHOLE = 4
_CROPS = ((96, 128, 62), (128, 148, 78), (170, 160, 98), (146, 122, 84), (80, 110, 70), (186, 176, 122))
_IRON = ((12, 6, 40), (96, 12, 120), (190, 44, 90), (240, 120, 30), (252, 208, 70), (255, 252, 220))


def farmland(size: ImageSize, *, seed: int, along: float = 0.0) -> NDArray[np.uint8]:
    """Fields with tractor lines and paths between them, seen from above.

    Args:
        size: (width, height) px.
        seed: of the random landscape.
        along: distance flown, in picture heights.

    Returns:
        (H, W, 3) uint8 RGB, the same bytes for the same arguments.
    """
    x, y = _cells(size)
    y = y - along
    random = np.random.default_rng(seed)
    angle = random.uniform(0.1, 0.5)
    u, v = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    u = u + 0.03 * np.sin(5 * v + random.uniform(0, 6))
    column, row = np.floor(u * 3.1).astype(int), np.floor(v * 4.3).astype(int)
    crops = np.array(_CROPS, dtype=np.float64)[random.permutation(len(_CROPS))]
    picture = crops[(column * 7 + row * 5) % len(crops)]
    lines = 6 * np.sin(90 * u) + 10 * np.sin(7 * x + 3 * np.sin(4 * y))
    picture = picture + lines[..., None]
    path = (u * 3.1 % 1 < 0.05) | (v * 4.3 % 1 < 0.05)
    picture[path] = (206, 198, 178)
    return _enlarged(picture, size)


def infrared(size: ImageSize, *, seed: int) -> NDArray[np.uint8]:
    """Warm spots on cool ground in the iron palette of thermal cameras.

    Returns:
        (H, W, 3) uint8 RGB, the same bytes for the same arguments.
    """
    x, y = _cells(size, step=4)
    random = np.random.default_rng(seed)
    heat = 0.25 + 0.1 * np.sin(4 * x + 2 * y)
    for centre_x, centre_y, radius in random.uniform((0.1, 0.1, 0.03), (1.2, 0.9, 0.12), (9, 3)):
        heat = heat + 0.6 * np.exp(-((x - centre_x) ** 2 + (y - centre_y) ** 2) / radius**2)
    at = np.clip(heat, 0, 1) * (len(_IRON) - 1)
    iron = np.array(_IRON, dtype=np.float64)
    channels = [np.interp(at, np.arange(len(iron)), iron[:, channel]) for channel in range(3)]
    return _enlarged(np.stack(channels, axis=-1), size)


def _cells(size: ImageSize, step: int = _STEP) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coordinates x and y of the cell centres, in picture heights."""
    width, height = size
    columns, rows = max(2, width // step), max(2, height // step)
    x = (np.arange(columns) + 0.5) / columns * (width / height)
    y = (np.arange(rows) + 0.5) / rows
    return tuple(np.meshgrid(x, y))  # type: ignore[return-value]


def _enlarged(picture: NDArray[np.float64], size: ImageSize) -> NDArray[np.uint8]:
    """Enlarge smoothly to a quarter of the size, then by whole pixels: a tenth of the time, and no eye sees it."""
    from PIL import Image

    (width, height), (quarter_width, quarter_height) = size, (-(-side // _WHOLE) for side in size)
    small = Image.fromarray(np.clip(picture, 0, 255).astype(np.uint8))
    quarter = np.asarray(small.resize((quarter_width, quarter_height), Image.Resampling.BILINEAR))
    return quarter.repeat(_WHOLE, axis=1).repeat(_WHOLE, axis=0)[:height, :width]


_QUALITY = 40
_THUMBNAIL_PX = (160, 120)
_HEAD_BYTES = 400
"""Bytes of the truncated file: fewer than its EXIF."""


class Expectation(StrEnum):
    """Expected result of the camera check for a file."""

    VALID = "valid"
    UNPROVEN = "unproven"
    REJECTED = "rejected"
    UNREADABLE = "unreadable"


class DemoImage(Struct, frozen=True, kw_only=True):
    """One file of the flight and the expected result.

    Attributes:
        name: path relative to the flight's folder, with ``/``.
        camera: common name of the camera.
        story: the case that this file demonstrates.
        outcome: expected under the ``fleet`` policy with the shipped catalogue.
        reason: of the outcome.
        fx_px: expected fx of K, as exact as the catalogue's pitch; None if no K is expected.
        grade: of that K.
        private: texts in the file that no output may contain: positions, serial numbers, RTK hosts.
    """

    name: str
    camera: str
    story: str
    outcome: Expectation
    reason: str
    fx_px: float | None = None
    grade: Grade | None = None
    private: tuple[str, ...] = ()


class _Frame(Struct, frozen=True, kw_only=True):
    """A file to write: its record, image size, metadata, and position along the flight line."""

    image: DemoImage
    size: ImageSize
    head: Head
    along: float = 0.0
    has_thumbnail: bool = False


_BLUE = Band(
    name="Blue",
    index=0,
    wavelength_nm=475,
    width_nm=20,
    focal_mm=5.4416,
    principal_point_mm=(2.40852, 1.80961),
    distortion=(-0.098214, 0.143107, -0.027352, 0.000261, 0.000518),
)
_NIR = Band(
    name="NIR",
    index=3,
    wavelength_nm=840,
    width_nm=40,
    focal_mm=5.4587,
    principal_point_mm=(2.37204, 1.76418),
    distortion=(-0.101942, 0.138260, -0.020117, -0.000347, 0.000092),
)
_REDEDGE_PX_PER_MM = 266.666667


_SURVEY = "2019-03-05;3659.5,3655.0,-4.25,22.5,-0.267,0.111,0.0008,-0.0001,-0.033"


def write_demo(out: Path, *, seed: int = 7) -> list[DemoImage]:
    """Write the folders that the README names: the flight, a survey by one camera, an odd camera, a payload.

    Returns:
        A record for each file of the flight, with its path below ``out``.
    """
    flight = write_flight(out / "flight", seed=seed)
    phantom: dict[str, ExifValue] = {"Make": "DJI", "Model": "FC6310R", "Software": "v01.09.1691"}
    phantom |= {"FocalLength": (88, 10), "FocalLengthIn35mmFilm": 24}
    xmp = packet([description("", attributes={"drone-dji:DewarpData": _SURVEY})])
    for name in ("survey/DJI_0001", "survey/DJI_0002", "payload/flight/DJI_0101", "payload/flight/DJI_0102"):
        # As the flight flies, so that these pictures need not be drawn again.
        ground = _picture((5472, 3648), seed, 0.25 * int(name[-1]))
        _put(out / f"{name}.JPG", headed(ground, Head(exif=phantom, xmp=xmp)))
    odd: dict[str, ExifValue] = {
        "Make": "Nobody",
        "Model": "Knows It",
        "FocalLength": (12, 1),
        "FocalLengthIn35mmFilm": 24,
    }
    _put(out / "odd-camera/1.jpg", headed(_picture((5184, 3896), seed), Head(exif=odd)))
    return [replace(image, name=f"flight/{image.name}") for image in flight]


def write_flight(out: Path, *, seed: int = 7) -> list[DemoImage]:
    """Write the whole flight into ``out``.

    Args:
        out: folder; created if needed, files with the same names are replaced.
        seed: of the random landscape and its position; the cameras do not depend on it.

    Returns:
        A record for each file, in the order of the folders.
    """
    frames = list(_frames(seed))
    for frame in frames:
        _write(frame, out / frame.image.name, seed)
    return [replace(frame.image, private=frame.head.private) for frame in frames]


def _frames(seed: int) -> Iterator[_Frame]:
    shots = _shots(seed)
    yield from _phantom_4_rtk(shots)
    yield from _mavic_3t(shots)
    yield from _rededge(shots)
    yield from _phantom_4_pro(shots)
    yield from _processed(shots)
    yield _Frame(
        image=DemoImage(
            name="phantom4/DJI_0007.JPG",
            camera="Phantom 4",
            story="early firmware wrote the focal length as 0/0",
            outcome=Expectation.UNPROVEN,
            fx_px=2284.0,
            grade=Grade.DESIGN,
            reason="a zero denominator is no focal length; K is the catalogue's",
        ),
        size=(4000, 3000),
        head=phantom_4(next(shots)),
    )


def _phantom_4_rtk(shots: Iterator[Shot]) -> Iterator[_Frame]:
    calibrated = DemoImage(
        name="",
        camera="Phantom 4 RTK",
        story="this lens's own calibration in DewarpData",
        outcome=Expectation.VALID,
        reason="calibrated K, distortion apart",
        fx_px=3659.41,
        grade=Grade.CALIBRATED,
    )
    for number in range(1, 5):
        image = replace(calibrated, name=f"100_0001/100_0001_{number:04}.JPG")
        yield _Frame(image=image, size=(5472, 3648), head=phantom_4_rtk(next(shots)), along=0.25 * number)
    broken = DemoImage(
        name="100_0001/100_0001_0005.JPG",
        camera="Phantom 4 RTK",
        story="the card was pulled while the file was written",
        outcome=Expectation.UNREADABLE,
        reason="the file ends within its EXIF",
    )
    yield _Frame(image=broken, size=(5472, 3648), head=phantom_4_rtk(next(shots)))


def _mavic_3t(shots: Iterator[Shot]) -> Iterator[_Frame]:
    folder = "DJI_202405170930_001"
    for number in (1, 2):
        shot = next(shots)
        stem = f"{folder}/DJI_{shot.taken:%Y%m%d%H%M%S}_{number:04}"
        wide = DemoImage(
            name=f"{stem}_W.JPG",
            camera="Mavic 3T wide",
            story="48 megapixels; shares its Model with the thermal camera",
            outcome=Expectation.VALID,
            reason="focal length over the catalogue's pitch",
            fx_px=4.4 / 6.4309 * 8000,
            grade=Grade.DERIVED,
        )
        yield _Frame(image=wide, size=(8000, 6000), head=mavic_3t_wide(shot), along=0.4 * number)
        thermal = DemoImage(
            name=f"{stem}_T.JPG",
            camera="Mavic 3T thermal",
            story="the same Model, another camera",
            outcome=Expectation.VALID,
            reason="a K of its own: 9.1 mm over 12 µm",
            fx_px=9.1 / 0.012,
            grade=Grade.DERIVED,
        )
        second = _picture((160, 120), 0)
        head = replace(mavic_3t_infrared(shot), preview=second)
        yield _Frame(image=thermal, size=(640, 512), head=head)


def _rededge(shots: Iterator[Shot]) -> Iterator[_Frame]:
    shot = next(shots)
    for band, number in ((_BLUE, 1), (_NIR, 4)):
        image = DemoImage(
            name=f"micasense/0000SET/000/IMG_0000_{number}.tif",
            camera=f"RedEdge-M {band.name}",
            story="one band of a rig, calibrated in millimetres",
            outcome=Expectation.VALID,
            reason="millimetres × pixels per millimetre; every band is a camera",
            fx_px=band.focal_mm * _REDEDGE_PX_PER_MM,
            grade=Grade.CALIBRATED,
        )
        yield _Frame(image=image, size=(1280, 960), head=rededge_m(shot, band))


def _phantom_4_pro(shots: Iterator[Shot]) -> Iterator[_Frame]:
    derived = DemoImage(
        name="phantom4pro/DJI_0101.JPG",
        camera="Phantom 4 Pro",
        story="16:9 mode: rows of the sensor left out",
        outcome=Expectation.VALID,
        reason="a crop keeps fx; only the centre moves",
        fx_px=8.8 / 0.0024,
        grade=Grade.DERIVED,
    )
    yield _Frame(image=derived, size=(5472, 3078), head=phantom_4_pro(next(shots), (5472, 3078)))
    zoomed = replace(
        derived,
        name="phantom4pro/DJI_0102.JPG",
        story="2× digital zoom, enlarged back to full size",
        outcome=Expectation.UNPROVEN,
        reason="twice the focal length in pixels by custom, which no tag proves",
        fx_px=2 * 8.8 / 0.0024,
    )
    yield _Frame(image=zoomed, size=(5472, 3648), head=phantom_4_pro(next(shots), (5472, 3648), zoom=2))


def _processed(shots: Iterator[Shot]) -> Iterator[_Frame]:
    """Images that were processed after the camera wrote them."""
    transcoded = DemoImage(
        name="video/DJI_0103_4k.jpg",
        camera="Phantom 4 Pro",
        story="a 16:9 frame transcoded to 4K; EXIF still states the original frame, and has its thumbnail",
        outcome=Expectation.VALID,
        reason="the thumbnail shows the whole frame, so it was scaled: recomputed against the true output size",
        fx_px=8.8 / 0.0024 * 3840 / 5472,
        grade=Grade.DERIVED,
    )
    head = phantom_4_pro(next(shots), (5472, 3078))
    yield _Frame(image=transcoded, size=(3840, 2160), head=head, has_thumbnail=True)
    stretched = DemoImage(
        name="video/DJI_0104_4k.jpg",
        camera="Phantom 4 Pro",
        story="a 3:2 frame forced into 4K's 16:9: fx ≠ fy, or cropped by an unknown amount",
        outcome=Expectation.REJECTED,
        reason="EXIF's frame leads to the file's neither by a scale nor by a crop",
    )
    yield _Frame(image=stretched, size=(3840, 2160), head=phantom_4_pro(next(shots), (5472, 3648)))
    equivalent = DemoImage(
        name="phone/DJI_0105.jpg",
        camera="Phantom 4 Pro",
        story="exported by an app that kept the 35 mm equivalent and dropped the focal length",
        outcome=Expectation.UNPROVEN,
        fx_px=3660.77,
        grade=Grade.DESIGN,
        reason="24 mm on film is no focal length of it; K is the catalogue's",
    )
    kept = Head(
        exif={"Make": "DJI", "Model": "FC6310", "Software": "Gallery 4.1", "FocalLengthIn35mmFilm": 24}
    )
    yield _Frame(image=equivalent, size=(5472, 3648), head=kept)
    stripped = DemoImage(
        name="cloud/IMG_0412.jpg",
        camera="unknown",
        story="a cloud uploader stripped all metadata",
        outcome=Expectation.REJECTED,
        reason="nothing in the file determines K; a seed is offered, marked as one",
    )
    yield _Frame(image=stripped, size=(5472, 3648), head=Head())


def _shots(seed: int) -> Iterator[Shot]:
    """A flight line to the north with an image every four seconds, at a position that the seed determines."""
    random = np.random.default_rng(seed)
    latitude, longitude = random.uniform((44.0, 5.0), (48.0, 9.0))
    taken = datetime(2024, 5, 17, 9, 30, 12)
    while True:
        yaw, climb = random.normal((3.0, 0.0), (0.4, 0.2))
        yield Shot(
            taken=taken,
            latitude_deg=float(latitude),
            longitude_deg=float(longitude),
            altitude_m=512.0 + float(climb),
            yaw_deg=float(yaw),
        )
        taken += timedelta(seconds=4)
        latitude += 0.0002


def _write(frame: _Frame, path: Path, seed: int) -> None:
    if path.suffix == ".tif":
        write_image(path, _band(frame.size, seed), frame.head)
        return
    picture = _picture(frame.size, seed, frame.along, thermal=path.stem.endswith("_T"))
    head = _with_thumbnail(frame.head, picture) if frame.has_thumbnail else frame.head
    file = headed(picture, head)
    _put(path, file[:_HEAD_BYTES] if frame.image.outcome is Expectation.UNREADABLE else file)


@lru_cache(maxsize=32)
def _picture(size: ImageSize, seed: int, along: float = 0.0, *, thermal: bool = False) -> bytes:
    """A JPEG without metadata; several images have the same pixels, and drawing these takes the time."""
    return jpeg(infrared(size, seed=seed) if thermal else farmland(size, seed=seed, along=along), _QUALITY)


def _with_thumbnail(head: Head, picture: bytes) -> Head:
    from PIL import Image

    with Image.open(io.BytesIO(picture)) as image:
        image.thumbnail(_THUMBNAIL_PX)
        return replace(head, thumbnail=jpeg(np.asarray(image), _QUALITY))


def _put(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def _band(size: ImageSize, seed: int) -> NDArray[np.uint16]:
    """A multispectral band: 12-bit signal in 16 bits, as the camera writes it."""
    green = farmland(size, seed=seed)[..., 1].astype(np.uint16)
    return (green << 8).astype(np.uint16)
