"""Ready-made camera states, each with the numbers of a camera that exists and values of our own."""

from __future__ import annotations

from calibrary.evidence.metadata import FocalPlaneUnit, ImageMetadata, XmpProperty
from calibrary.known_camera import KnownCamera

P4_RTK = KnownCamera(
    make="DJI",
    models=("FC6310R",),
    title="Phantom 4 RTK",
    native_size=(5472, 3648),
    pitch_um=2.4,
    focal_mm=8.8,
    fx_over_w=0.6684,
)
M3T_WIDE = KnownCamera(
    make="DJI",
    models=("M3T",),
    title="Mavic 3T wide",
    sub_camera="wide",
    native_size=(8000, 6000),
    pitch_um=0.804,
    focal_mm=4.4,
    fx_over_w=0.6842,
)
M3T_THERMAL = KnownCamera(
    make="DJI",
    models=("M3T",),
    title="Mavic 3T thermal",
    sub_camera="thermal",
    native_size=(640, 512),
    pitch_um=12.0,
    focal_mm=9.1,
    fx_over_w=1.185,
)
SKYDIO_2 = KnownCamera(
    make="Skydio",
    models=("2",),
    title="Skydio 2",
    native_size=(4056, 3040),
    pitch_um=1.55,
    focal_mm=3.7,
    fx_over_w=0.5865,
    exif_focal_trusted=False,
)
PHANTOM_3 = KnownCamera(
    make="DJI",
    models=("FC300S",),
    title="Phantom 3",
    native_size=(4000, 3000),
    pitch_um=1.54,
    focal_mm=3.61,
    fx_over_w=0.5931,
)


def xmp(schema: str, **values: str | tuple[str, ...]) -> tuple[XmpProperty, ...]:
    """XMP properties of one schema; a double underscore stands for the slash of a structure's member."""
    return tuple(
        XmpProperty(schema, name.replace("__", "/"), (value,) if isinstance(value, str) else value)
        for name, value in values.items()
    )


def p4_rtk(
    *,
    size: tuple[int, int] = (5472, 3648),
    exif_size: tuple[int, int] | None = (5472, 3648),
    dewarp: str = "2019-03-05;3660.5,3655.25,-4.5,22.75,-0.268,0.112,0.0008,-0.0001,-0.034",
    **dji: str,
) -> ImageMetadata:
    """A Phantom 4 RTK frame with its unit's DewarpData."""
    return ImageMetadata(
        size=size,
        exif_size=exif_size,
        make="DJI",
        model="FC6310R",
        software="v01.09.1691",
        focal_mm=8.8,
        focal_35mm=24.0,
        xmp=xmp("drone-dji", DewarpData=dewarp, **dji),
        has_exif=True,
    )


def micasense(
    focal: str, *, unit: str | None = None, centre: str = "2.36,1.81", band: str = "Blue"
) -> ImageMetadata:
    """A RedEdge band; firmware 2 wrote pixels without a unit, later firmware writes mm with one."""
    units = {"PerspectiveFocalLengthUnits": unit} if unit is not None else {}
    return ImageMetadata(
        size=(1280, 960),
        make="MicaSense",
        model="RedEdge",
        focal_mm=5.5,
        focal_plane_resolution=(266.666667, 266.666667),
        focal_plane_unit=FocalPlaneUnit.MILLIMETRE,
        xmp=xmp(
            "Camera",
            ModelType="perspective",
            PerspectiveFocalLength=focal,
            PrincipalPoint=centre,
            PerspectiveDistortion=("-0.1", "0.14", "-0.02", "0.0003", "-0.0004"),
            BandName=band,
            **units,
        ),
        has_exif=True,
    )
