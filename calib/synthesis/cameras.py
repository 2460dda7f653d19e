"""Simulated cameras: a unit of a known model, and the metadata in its images."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt
from calibrary.errors import InputError
from calibrary.known_camera import KnownCamera, Projection
from calibrary.synthetic import ExifValue, Head, Rational, description, packet

EXAMPLE = KnownCamera(
    make="Example",
    models=("Board 2.8",),
    title="made-up camera",
    native_size=(1920, 1440),
    pitch_um=3.3,
    focal_mm=4.8,
    fx_over_w=0.7576,
)
"""Example camera for testing how well a board of some size works."""

_PITCH: Rational = (1_000_000, 3300)
"""Pixels per millimetre of the example camera, as an EXIF rational."""

FOCAL_SPREAD, CENTRE_SPREAD = 0.004, 0.004
"""Relative standard deviations between units of one model: of f, and of the principal point by the width."""
RADIAL = (-0.075, 0.03, -0.008)
"""Terms k1 r², k2 r⁴ and k3 r⁶ of Brown's polynomial at the image corner: a typical UAV lens, six percent inwards."""
TANGENTIAL = 2e-4
FIRST_FRAME = datetime(2024, 5, 17, 9, 30, 12)
"""Time of the first image; EXIF dates have no time zone."""


_REQUIRED: dict[str, ExifValue] = {
    "XResolution": (72, 1),
    "YResolution": (72, 1),
    "ResolutionUnit": 2,
    "YCbCrPositioning": 1,
    "ExifVersion": b"0230",
    "ComponentsConfiguration": b"\1\2\3\0",
    "FlashPixVersion": b"0100",
    "ColorSpace": 1,
}
"""Tags that the standard requires in a JPEG; the resolution is that of paper."""


def example_camera(seed: int) -> Calibration:
    """Return an example camera of 1920×1440 px with a wide lens."""
    return unit_of(EXAMPLE, seed)


def unit_of(camera: KnownCamera, seed: int) -> Calibration:
    """Simulate a unit of a camera model, with realistic deviations of focal length, principal point and distortion.

    Args:
        camera: known facts about the model.
        seed: selects the unit.

    Raises:
        InputError: the focal length of the model in pixels is unknown.
    """
    if camera.native_size is None or camera.fx_over_w is None:
        raise InputError(
            f"{camera.title}: its frame and focal length in pixels are not known; expected another camera, or its "
            "calibration as a file"
        )
    random = np.random.default_rng([seed, 3])
    width, height = camera.native_size
    fx = camera.fx_over_w * width * (1 + FOCAL_SPREAD * random.standard_normal())
    shift = CENTRE_SPREAD * width * random.standard_normal(2)
    intrinsics = Intrinsics(
        fx=fx,
        fy=fx * (1 + 0.0005 * random.standard_normal()),
        cx=width / 2 + shift[0],
        cy=height / 2 + shift[1],
        image_size=camera.native_size,
    )
    return Calibration(
        camera=CameraKey(
            make=camera.make,
            model=camera.names[0],
            sub_camera=camera.sub_camera,
            lens=camera.lens,
            focal_mm=camera.focal_mm,
            image_size=camera.native_size,
        ),
        intrinsics=intrinsics,
        distortion=_lens(camera, intrinsics, random),
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="synthesis", source=camera.title, tag=f"seed {seed}"),
        notes=("a made-up unit: the truth of rendered frames, not of any camera",),
    )


def _lens(camera: KnownCamera, K: Intrinsics, random: np.random.Generator) -> Distortion:
    if camera.projection is Projection.FISHEYE:
        k1, k2 = random.normal((0.01, -0.004), 0.004)
        return KannalaBrandt(k1=k1, k2=k2, k3=0.0, k4=0.0)
    width, height = K.image_size
    corner = float(np.hypot(width / K.fx, height / K.fy)) / 2
    k1, k2, k3 = (
        share * (1 + 0.1 * random.standard_normal()) / corner ** (2 * power)
        for power, share in enumerate(RADIAL, start=1)
    )
    p1, p2 = TANGENTIAL * random.standard_normal(2)
    return BrownConrady(k1=k1, k2=k2, p1=float(p1), p2=float(p2), k3=k3)


def head(calibration: Calibration, known: KnownCamera | None, number: int) -> Head:
    """Return the metadata of image ``number``, counted from 0.

    Args:
        calibration: the camera.
        known: known facts about its model.
        number: number of the image; one is taken every four seconds.
    """
    key = calibration.camera
    taken = FIRST_FRAME + timedelta(seconds=4 * number)
    date = f"{taken:%Y:%m:%d %H:%M:%S}"
    width, height = calibration.intrinsics.image_size
    exif: dict[str, ExifValue | None] = {
        "Make": key.make,
        "Model": key.model,
        "ImageDescription": "rendered frame of a calibration board",
        "DateTime": date,
        "DateTimeOriginal": date,
        "DateTimeDigitized": date,
        "Orientation": 1,
        "ExposureTime": (1, 320),
        "FNumber": (56, 10),
        "ISOSpeedRatings": 100,
        "FocalLength": _rational(key.focal_mm),
        "FocalLengthIn35mmFilm": round(known.focal_35mm) if known is not None and known.focal_35mm else None,
        "ExifImageWidth": width,
        "ExifImageHeight": height,
        "LensModel": key.lens,
    }
    if key.make == EXAMPLE.make:
        # The real models here do not write these tags; without them the pitch of the example camera would be unknown.
        exif |= {
            "FocalPlaneXResolution": _PITCH,
            "FocalPlaneYResolution": _PITCH,
            "FocalPlaneResolutionUnit": 4,
        }
    stated = {name: value for name, value in exif.items() if value is not None}
    return Head(exif=_REQUIRED | stated, xmp=_sub_camera_tag(key))


def _sub_camera_tag(key: CameraKey) -> bytes | None:
    """Return DJI's ImageSource tag, which alone distinguishes the cameras of a drone with the same Model."""
    if key.sub_camera is None or key.make is None or key.make.upper() != "DJI":
        return None
    words = {"thermal": "InfraredCamera"}
    source = words.get(key.sub_camera, f"{key.sub_camera.title().replace('-', '')}Camera")
    return packet([description("DJI Meta Data", attributes={"drone-dji:ImageSource": source})])


def _rational(value: float | None) -> Rational | None:
    return (round(value * 1000), 1000) if value is not None else None
