"""What two cameras write into a frame, tag by tag, for the benchmarks and for stories of firmware.

Which tags, in which namespace and form, follows files of these cameras; every calibration, serial number,
host and place is made up.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta

from calibrary.jobs.demo.flight import Band, Shot
from tests.imagery import (
    ExifField,
    ExifTags,
    GpsPosition,
    XmpDescription,
    XmpItem,
    XmpPacket,
    attributes,
    elements,
)
from tests.imagery.xmp import CAMERA_RAW, DC, DLS, DRONE_DJI, MICASENSE, PIX4D_1, TIFF, XMP

__all__ = [
    "Band",
    "Head",
    "Shot",
    "phantom_4_rtk",
    "rededge_m",
]

_DJI_PACKET_BYTES = 8159
"""DJI fills its XMP segment up to 8190 bytes; 29 of them are the segment's name, two its length."""


_DJI_CONSTANTS = (
    ExifField("XResolution", ((72, 1),)),
    ExifField("YResolution", ((72, 1),)),
    ExifField("ResolutionUnit", (2,)),
    ExifField("YCbCrPositioning", (1,)),
    ExifField("ExifVersion", b"0230"),
    ExifField("ComponentsConfiguration", b"\1\2\3\0"),
    ExifField("ShutterSpeedValue", ((9643, 1000),)),
    ExifField("ApertureValue", ((497, 100),)),
    ExifField("SubjectDistance", ((0, 0),)),
    ExifField("FlashpixVersion", b"0100"),
    ExifField("ColorSpace", (1,)),
    ExifField("FileSource", b"\3"),
    ExifField("SceneType", b"\1"),
    ExifField("InteroperabilityIndex", "R98"),
    ExifField("InteroperabilityVersion", b"0100"),
)
"""What is the same in every DJI frame; the resolution is of paper, not of the focal plane."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Head:
    """What stands before a frame's pixels, and the texts in it that nobody else should ever see."""

    exif: ExifTags | None = None
    xmp: XmpPacket | None = None
    private: tuple[str, ...] = ()


def _position(shot: Shot) -> GpsPosition:
    return GpsPosition(
        latitude_deg=shot.latitude_deg, longitude_deg=shot.longitude_deg, altitude_m=shot.altitude_m
    )


def phantom_4_rtk(shot: Shot) -> Head:
    """FC6310R: a calibration of this very lens in DewarpData, centre as an offset from the frame's."""
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
    return Head(
        exif=exif, xmp=_dji_packet(shot, "FC6310R", calibrated | rtk), private=(*shot.private, serial)
    )


def rededge_m(shot: Shot, band: Band) -> Head:
    """RedEdge-M with firmware 3, which counts its calibration in millimetres and says so."""
    serial, light_sensor = "RM01-4200042-EX", "DL06-4200042-EX"
    about = "Pix4D Camera Information"
    flight = elements(MICASENSE, BootTimestamp="395", FlightId="exampleFlight0042", TriggerMethod="0")
    camera = elements(
        PIX4D_1,
        BandName=band.name,
        CentralWavelength=str(band.wavelength_nm),
        WavelengthFWHM=str(band.width_nm),
        ModelType="perspective",
        PrincipalPoint="{:.5f},{:.5f}".format(*band.principal_point_mm),
        PerspectiveFocalLength=f"{band.focal_mm:.14f}",
        PerspectiveFocalLengthUnits="mm",
        PerspectiveDistortion=tuple(f"{value:.12f}" for value in band.distortion),
        RigCameraIndex=str(band.index),
    )
    exif = ExifTags(
        make="MicaSense",
        model="RedEdge-M",
        software="v3.3.0",
        date_time=shot.exif_time,
        orientation=1,
        exposure_time=(1, 1250),
        f_number=(28, 10),
        focal_mm=(55, 10),
        focal_plane_resolution=((266_666_667, 1_000_000), (266_666_667, 1_000_000)),
        focal_plane_unit=4,
        body_serial=serial,
        position=_position(shot),
        overrides=(ExifField("ExifVersion", b"0230"),),
    )
    xmp = XmpPacket(
        toolkit="XMP Core 4.4.0",
        descriptions=(
            XmpDescription(about=about, items=flight),
            XmpDescription(about=about, items=camera),
            XmpDescription(about=about, items=elements(DLS, Serial=light_sensor, SwVersion="v1.0.1")),
        ),
    )
    return Head(exif=exif, xmp=xmp, private=(*shot.private, serial, light_sensor))


def _dji_exif(
    shot: Shot,
    *,
    model: str,
    software: str,
    body_serial: str,
    focal_mm: tuple[int, int],
    focal_35mm: int,
    digital_zoom: tuple[int, int],
    pixel_size: tuple[int, int],
) -> ExifTags:
    return ExifTags(
        make="DJI",
        model=model,
        software=software,
        description="default",
        date_time=shot.exif_time,
        orientation=1,
        exposure_time=(1, 800),
        f_number=(56, 10),
        iso=100,
        focal_mm=focal_mm,
        focal_35mm=focal_35mm,
        digital_zoom=digital_zoom,
        pixel_size=pixel_size,
        body_serial=body_serial,
        maker_note=b"DJI MakerNotes\0",
        position=_position(shot),
        overrides=_DJI_CONSTANTS,
    )


def _dji_packet(shot: Shot, model: str, expected: dict[str, str]) -> XmpPacket:
    local = f"{shot.taken:%Y-%m-%dT%H:%M:%S}+02:00"
    utc = shot.taken - timedelta(hours=2)
    items: tuple[XmpItem, ...] = (
        *attributes(XMP, ModifyDate=local, CreateDate=local),
        *attributes(TIFF, Make="DJI", Model=model),
        *attributes(DC, format="image/jpg"),
        *attributes(
            DRONE_DJI,
            GpsLatitude=f"{shot.latitude_deg:+.8f}",
            # The misspelling is DJI's.
            GpsLongtitude=f"{shot.longitude_deg:+.8f}",
            AbsoluteAltitude=f"{shot.altitude_m:+.3f}",
            RelativeAltitude="+80.013",
            GimbalRollDegree="+0.00",
            GimbalYawDegree=f"{shot.yaw_deg:+.2f}",
            GimbalPitchDegree="-90.00",
            FlightRollDegree="+1.20",
            FlightYawDegree=f"{shot.yaw_deg:+.2f}",
            FlightPitchDegree="-2.10",
            CamReverse="0",
            GimbalReverse="0",
            SelfData="",
            UTCAtExposure=f"{utc:%Y-%m-%dT%H:%M:%S}.000000",
            **expected,
        ),
        *attributes(CAMERA_RAW, Version="7.0", HasSettings="False", HasCrop="False", AlreadyApplied="False"),
    )
    description = XmpDescription(about="DJI Meta Data", items=items)
    return XmpPacket(descriptions=(description,), length=_DJI_PACKET_BYTES)
