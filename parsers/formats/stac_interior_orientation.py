"""The interior orientation of STAC's perspective imagery extension: of an Item, a Collection, or in a file of its own.

In the format's own words, the document that a link with ``"rel": "interior-orientation"`` leads to::

    {"camera_manufacturer": "DJI", "camera_model": "FC6310R", "sensor_array_dimensions": [5472, 3648],
     "pixel_spacing": [0.0024, 0.0024], "focal_length": 8.78, "principal_point_offset": [-0.011, -0.054],
     "calibration_date": "2026-05-03"}

An Item has the same object as ``properties["pers:interior_orientation"]``, a Collection as
``"pers:interior_orientation"``. Lengths are mm; the principal point is its offset from the middle of the sensor, and
columns and rows may have different spacings. The extension does not state the direction of y. It refers to
NGA.SIG.0002, a photogrammetric standard, so calibrary assumes up. ``radial_distortion`` has four coefficients whose
direction and sign the extension leaves to that standard as well: they are not written, and a document that has them, or
``affine_distortion``, is refused. A document therefore states K but no distortion.

Source: https://github.com/stac-extensions/perspective-imagery, v1.0.0, README and ``v1.0.0/schema.json``.
"""

from __future__ import annotations

from collections.abc import Sequence

from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential, Unit, YAxis
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, UnknownLens, WriteContext
from calibrary.parsers.formats._json_text import Writable, dumped, loaded
from calibrary.parsers.formats._metric_lens import sensor_extra, sensor_mm_of
from calibrary.parsers.formats._one_camera import ORIGIN_UNKNOWN, size_of

FIELD = "pers:interior_orientation"
SENSOR = "stac_interior_orientation/sensor_mm"
REFUSED = ("radial_distortion", "affine_distortion")
CONVENTION = Convention(
    unit=Unit.MILLIMETRE,
    origin=Origin.IMAGE_CENTRE,
    y_axis=YAxis.UP,
    tangential=Tangential.NONE,
    remarks=("the extension does not state the direction of y; up is assumed", "distortion is not stated"),
)


def sniff(content: Content) -> Sniff | None:
    """The extension's field, or the keys of its object."""
    keys = {*content.json_keys}
    if keys & {FIELD, "properties"} and f'"{FIELD}"' in (content.text or ""):
        return Sniff(Sure.MAGIC, f"the key {FIELD}")
    if {"sensor_array_dimensions", "focal_length", "pixel_spacing"} <= keys:
        return Sniff(Sure.MAGIC, "the keys sensor_array_dimensions, pixel_spacing and focal_length")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the document."""
    top = loaded(data, context)
    properties = top.get("properties")
    node = (properties.get(FIELD) if properties is not None else None) or top.get(FIELD) or top
    for name in REFUSED:
        if (found := node.get(name)) is not None and any(found.numbers(len(found.items()))):
            raise UnsupportedModelError(
                f"it states {name}, whose direction and sign the extension does not describe; export the camera from "
                "the program that calibrated it",
                place=found.place,
            )
    width, height = size = size_of(node["sensor_array_dimensions"])
    x_mm, y_mm = node["pixel_spacing"].numbers(2)
    if min(x_mm, y_mm) <= 0:
        raise ParseError(f"pixels of {x_mm:g}×{y_mm:g} mm, expected positive ones", place=node.place)
    offset = node.get("principal_point_offset")
    cx, cy = offset.numbers(2) if offset is not None else (0.0, 0.0)
    focal = node["focal_length"].number()
    sensor_mm = (width * x_mm, height * y_mm)
    K = CONVENTION.intrinsics(Native(fx=focal, fy=focal, cx=cx, cy=cy), size, sensor_mm=sensor_mm)
    make, model, day = (
        found.text() if (found := node.get(name)) is not None else None
        for name in ("camera_manufacturer", "camera_model", "calibration_date")
    )
    return [
        Calibration(
            camera=CameraKey(make=make, model=model, image_size=size),
            intrinsics=K,
            distortion=None,
            grade=Grade.DERIVED,
            provenance=context.provenance(tag=node.place, date=day, assumptions=(ORIGIN_UNKNOWN,)),
            notes=(ORIGIN_UNKNOWN,),
            extras=(sensor_extra(SENSOR, sensor_mm),),
        )
    ]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The object alone, as a link of an Item or a Collection leads to it."""
    [calibration] = calibrations
    return dumped(interior_orientation(calibration))


def interior_orientation(calibration: Calibration) -> dict[str, Writable]:
    """The extension's object. Two focal lengths in px are one in mm over pixels of two spacings."""
    K, camera = calibration.intrinsics, calibration.camera
    sensor_mm = sensor_mm_of(calibration, SENSOR)
    width, height = K.image_size
    x_mm = sensor_mm[0] / width
    focal_mm = K.fx * x_mm
    y_mm = focal_mm / K.fy
    native = CONVENTION.native(K, sensor_mm=(width * x_mm, height * y_mm))
    stated: dict[str, Writable] = {
        "camera_manufacturer": camera.make,
        "camera_model": camera.model,
        "sensor_array_dimensions": [width, height],
        "pixel_spacing": [x_mm, y_mm],
        "focal_length": focal_mm,
        "principal_point_offset": [native.cx, native.cy],
        "calibration_date": calibration.provenance.date,
    }
    return {name: value for name, value in stated.items() if value is not None}


FORMAT = Format(
    name="stac_interior_orientation",
    title="STAC perspective imagery, pers:interior_orientation",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://github.com/stac-extensions/perspective-imagery",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(), unknown_lens=UnknownLens.STATED),
    states=("date",),
)
