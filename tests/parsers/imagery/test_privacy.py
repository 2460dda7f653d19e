"""Where somebody flew, over whose base station and with which body stays in the image."""

from __future__ import annotations

import itertools

import pytest

from calibrary.known_camera import hash_serial
from calibrary.parsers.imagery.facts import clean_serial
from calibrary.parsers.imagery.xmp import PROPERTIES
from tests.imagery import ExifField, ExifTags, GpsPosition, XmpItem, attributes
from tests.imagery.jpeg import exif_segment, xmp_segments
from tests.imagery.xmp import DRONE_DJI, DRONE_SKYDIO, XMP
from tests.parsers.imagery.build import jpeg, packet, read

SECRETS = {
    "GpsLatitude": "+48.137154",
    "GpsLongtitude": "+11.576124",
    "AbsoluteAltitude": "+519.73",
    "NTRIPHost": "caster.example.org",
    "NTRIPPort": "2101",
    "NTRIPMountPoint": "VRS47XY",
    "UTCAtExposure": "2031:07:19 07:39:52.944920",
    "LRFTargetLat": "48.1371999",
    "CameraSerialNumber": "CAM7SERIAL7RAW",
    "DroneSerialNumber": "DRONE7SERIAL7RAW",
}


def serial_of(body: str | None = None, dng: str | None = None, make: str = "DJI", **xmp: str) -> str | None:
    """The hashed serial of an image with these raw ones."""
    exif = ExifTags(
        make=make,
        body_serial=body,
        overrides=() if dng is None else (ExifField("CameraSerialNumber", dng),),
    )
    items: tuple[XmpItem, ...] = attributes(DRONE_DJI, **xmp)
    return read(jpeg(exif_segment(exif), *xmp_segments(packet(*items)))).serial


def test_positions_times_casters_and_raw_serials_never_leave_the_file() -> None:
    exif = ExifTags(
        make="DJI",
        date_time="2031:07:19 09:39:34",
        body_serial="BODY7SERIAL7RAW",
        position=GpsPosition(latitude_deg=48.137154, longitude_deg=11.576124, altitude_m=519.73),
    )
    items = (*attributes(DRONE_DJI, **SECRETS), *attributes(XMP, CreateDate="2031-07-19"))
    shown = repr(read(jpeg(exif_segment(exif), *xmp_segments(packet(*items)))))
    for secret in (*SECRETS.values(), "BODY7SERIAL7RAW", "2031", "48.13", "11.57", "519"):
        assert secret not in shown
    assert "DJI" in shown


def test_two_flights_of_one_camera_give_equal_records() -> None:
    def shot(day: int) -> bytes:
        exif = ExifTags(
            make="DJI",
            focal_mm=(88, 10),
            date_time=f"2031:07:{day} 09:39:34",
            position=GpsPosition(latitude_deg=48.0 + day, longitude_deg=11.0, altitude_m=500.0),
        )
        xmp = attributes(DRONE_DJI, GpsLatitude=f"{48 + day}.0", DewarpFlag="0", GimbalYawDegree=f"+{day}.0")
        return jpeg(exif_segment(exif), *xmp_segments(packet(*xmp)))

    assert read(shot(12)) == read(shot(19))
    assert hash(read(shot(12))) == hash(read(shot(19)))


@pytest.mark.parametrize(
    "word", ["gps", "latitude", "longitude", "serial", "ntrip", "rtk", "owner", "date", "when"]
)
def test_no_property_that_is_taken_is_of_a_private_kind(word: str) -> None:
    names = itertools.chain.from_iterable((name, *members) for _, name, members in PROPERTIES.values())
    assert [name for name in names if word in name.lower()] == []


def test_the_serial_tied_most_closely_to_the_camera_counts() -> None:
    every = {"CameraSerialNumber": "C1", "DroneSerialNumber": "D1", "LensSerialNumber": "L1"}
    assert serial_of(body="B1", **every) == hash_serial("DJI", "C1")
    del every["CameraSerialNumber"]
    assert serial_of(body="B1", **every) == hash_serial("DJI", "D1")
    del every["DroneSerialNumber"]
    assert serial_of(body="B1", **every) == hash_serial("DJI", "L1")
    assert serial_of(body="B1") == hash_serial("DJI", "B1")
    assert serial_of(dng="P1") == hash_serial("DJI", "P1")
    assert serial_of() is None


@pytest.mark.parametrize("nothing", ["", "0", "000000", "   ", "\0\0", "00-00", "----"])
def test_what_cameras_write_for_no_serial_is_none(nothing: str) -> None:
    assert clean_serial(nothing) is None
    assert serial_of(body=nothing) is None
    assert serial_of(body="B1", CameraSerialNumber=nothing.replace("\0", "")) == hash_serial("DJI", "B1")


def test_a_serial_is_hashed_with_its_maker() -> None:
    assert serial_of(body="1", make="DJI") != serial_of(body="1", make="Parrot")
    assert serial_of(body="1", make="DJI") == serial_of(body=" 1\0", make="DJI ")


def test_the_hash_is_pinned_for_registries_depend_on_it() -> None:
    assert hash_serial("DJI", "1581F6GKP0000") == "6ece109d55c80110"
    assert hash_serial(None, "1581F6GKP0000") == "187542b0ae658968"


def test_a_skydio_vehicle_is_a_serial() -> None:
    items = attributes(DRONE_SKYDIO, VehicleId="sim-12345")
    metadata = read(jpeg(*xmp_segments(packet(*items))))
    assert metadata.serial == hash_serial(None, "sim-12345")
    assert "12345" not in repr(metadata)
