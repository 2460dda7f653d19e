"""The XMP properties that concern the camera, with their namespaces.

This is a closed list: anything else (positions, times, RTK casters, owners) is never read from a file. In XMP
the prefix has no meaning, only the URI has, and makers spell theirs in several ways.
"""

from __future__ import annotations

from enum import IntEnum
from types import MappingProxyType
from typing import Final

__all__ = ["NAMESPACES", "PROPERTIES", "SERIALS", "SOFTWARE", "TIFF_MAKE", "TIFF_MODEL", "SerialRank"]

_PERSPECTIVE_AND_FISHEYE = (
    "BandName",
    "CentralWavelength",
    "RigName",
    "RigCameraIndex",
    "RigRelatives",
    "ModelType",
    "PrincipalPoint",
    "PerspectiveFocalLength",
    "PerspectiveFocalLengthUnits",
    "PerspectiveDistortion",
    "FisheyePolynomial",
    "FisheyeAffineMatrix",
    "FisheyeAffineSymmetric",
)

NAMESPACES: Final = {
    "drone-dji": ("http://www.dji.com/drone-dji/1.0/",),
    # As written by RedEdge, Altum and DJI, Sequoia, Parrot Disco, in this order.
    "Camera": (
        "http://pix4d.com/1.0",
        "http://pix4d.com/camera/1.0",
        "http://pix4d.com/camera/1.0/",
        "Camera/",
    ),
    "drone-skydio": ("https://www.skydio.com/drone-skydio/1.0/",),
    "sensefly": ("http://ns.sensefly.com/Camera/1.0/",),
    "MicaSense": ("http://micasense.com/MicaSense/1.0/",),
    "FLIR": ("http://ns.flir.com/xmp/1.0/",),
    "exif": ("http://ns.adobe.com/exif/1.0/",),
    "exifEX": ("http://cipa.jp/exif/1.0/",),
    "tiff": ("http://ns.adobe.com/tiff/1.0/",),
    "aux": ("http://ns.adobe.com/exif/1.0/aux/",),
    "crs": ("http://ns.adobe.com/camera-raw-settings/1.0/",),
    "GPano": ("http://ns.google.com/photos/1.0/panorama/",),
    "xmp": ("http://ns.adobe.com/xap/1.0/",),
    "xmpMM": ("http://ns.adobe.com/xap/1.0/mm/",),
}

_NAMES: Final = {
    "drone-dji": (
        "BandName",
        "CalibratedFocalLength",
        "CalibratedOpticalCenterX",
        "CalibratedOpticalCenterY",
        "CameraSource",
        "DewarpData",
        "DewarpDataK6",
        "DewarpFlag",
        "DroneModel",
        "ImageSource",
        "ProductName",
        "ShutterType",
    ),
    "Camera": _PERSPECTIVE_AND_FISHEYE,
    "drone-skydio": (
        "CalibratedFocalLength",
        "CalibratedFocalLength/X",
        "CalibratedFocalLength/Y",
        "CalibratedFocalLengthX",
        "CalibratedFocalLengthY",
        "CalibratedOpticalCenter",
        "CalibratedOpticalCenter/X",
        "CalibratedOpticalCenter/Y",
        "CalibratedOpticalCenterX",
        "CalibratedOpticalCenterY",
        "CameraSource",
        "DewarpData",
        "DewarpFlag",
        "ImageSource",
    ),
    "sensefly": _PERSPECTIVE_AND_FISHEYE,
    "MicaSense": ("BandName", "RigCameraIndex"),
    "FLIR": ("CameraHorizontalFOV", "CameraVerticalFOV", "FocalLength", "LensModel"),
    # Teledyne FLIR writes the fields of view here; the others survive a conversion that drops EXIF.
    "exif": (
        "CameraHorizontalFOV",
        "CameraVerticalFOV",
        "DigitalZoomRatio",
        "FocalLength",
        "FocalLengthIn35mmFilm",
        "FocalPlaneResolutionUnit",
        "FocalPlaneXResolution",
        "FocalPlaneYResolution",
        "PixelXDimension",
        "PixelYDimension",
    ),
    "exifEX": ("LensMake", "LensModel", "LensSpecification"),
    "tiff": ("Make", "Model", "Orientation"),
    "aux": ("DistortionCorrectionAlreadyApplied", "Lens", "LensID", "LensInfo"),
    "crs": (
        "AlreadyApplied",
        "CropAngle",
        "CropBottom",
        "CropLeft",
        "CropRight",
        "CropTop",
        "HasCrop",
        "HasSettings",
        "LensManualDistortionAmount",
        "LensProfileEnable",
        "LensProfileName",
        "PerspectiveUpright",
    ),
    "GPano": ("ProjectionType", "StitchingSoftware"),
    "xmp": ("CreatorTool",),
    "xmpMM": ("History/action", "History/parameters", "History/softwareAgent"),
}


class SerialRank(IntEnum):
    """How closely a serial number is associated with the camera; the highest rank counts.

    A drone may carry several cameras, and EXIF's BodySerialNumber is that of the drone or the camera, or
    truncated, depending on the model.
    """

    BODY = 0
    LENS = 1
    DRONE = 2
    CAMERA = 3


def _clark(schema: str, name: str) -> tuple[str, ...]:
    """A property's names in lxml's notation, one for each URI of its schema."""
    return tuple(f"{{{uri}}}{name}" for uri in NAMESPACES[schema])


PROPERTIES = MappingProxyType(
    {
        clark: (
            schema,
            top,
            frozenset(name.partition("/")[2] for name in names if name.partition("/")[0] == top),
        )
        for schema, names in _NAMES.items()
        for top in dict.fromkeys(name.partition("/")[0] for name in names)
        for clark in _clark(schema, top)
    }
)
"""(schema, local name, members to read; "" is the property itself), by name in lxml's notation."""

SERIALS = MappingProxyType(
    {
        clark: rank
        for rank, schema, name in (
            (SerialRank.CAMERA, "drone-dji", "CameraSerialNumber"),
            (SerialRank.CAMERA, "FLIR", "CameraSerialNumber"),
            (SerialRank.CAMERA, "Camera", "CameraSerialNumber"),
            (SerialRank.DRONE, "drone-dji", "DroneSerialNumber"),
            (SerialRank.DRONE, "drone-skydio", "VehicleId"),
            (SerialRank.LENS, "drone-dji", "LensSerialNumber"),
            (SerialRank.LENS, "exifEX", "LensSerialNumber"),
            (SerialRank.LENS, "aux", "LensSerialNumber"),
            (SerialRank.BODY, "exifEX", "BodySerialNumber"),
            (SerialRank.BODY, "aux", "SerialNumber"),
        )
        for clark in _clark(schema, name)
    }
)
"""Properties with serial numbers, of which only a hash is kept."""

SOFTWARE = frozenset(_clark("drone-skydio", "ReleaseKey") + _clark("tiff", "Software"))
(TIFF_MAKE,) = _clark("tiff", "Make")
(TIFF_MODEL,) = _clark("tiff", "Model")
