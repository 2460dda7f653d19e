"""Metadata that the demo's cameras write into their images: tags as the makers spell them, with invented values.

Tags, namespaces and forms follow real files of these cameras; all calibrations, serial numbers, hosts and
positions are invented. ``example`` is a reserved domain (RFC 2606).
"""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import TypeVar

from msgspec import Struct

from calibrary.calibration import ImageSize
from calibrary.synthetic import ExifValue, Head, Position, Rational, description, packet

__all__ = [
    "Band",
    "Shot",
    "mavic_3t_infrared",
    "mavic_3t_wide",
    "phantom_4",
    "phantom_4_pro",
    "phantom_4_rtk",
    "rededge_m",
]

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
    return _mavic_3t(shot, source="WideCamera", focal_mm=(4400, 1000), focal_35mm=24, pixel_size=(8000, 6000))


def mavic_3t_infrared(shot: Shot) -> Head:
    """M3T, the thermal camera, with the same EXIF Model."""
    return _mavic_3t(
        shot, source="InfraredCamera", focal_mm=(9100, 1000), focal_35mm=40, pixel_size=(640, 512)
    )


def _mavic_3t(shot: Shot, *, source: str, focal_mm: Rational, focal_35mm: int, pixel_size: ImageSize) -> Head:
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
