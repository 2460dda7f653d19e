"""Z/I Imaging's camera file, as Pix4D exports it for ImageStation (``.ssk``).

In the format's own words, a block for each camera::

    begin camera_parameters NAME
        focal_length:               8.7602                     mm
        ppac:                       0.0279 -0.0218             mm, x to the right and y up
        ppbs:                       0 0
        film_format:                8.7552 13.1328             mm, height first
        lens_distortion_flag:       off
        camera_type:                frame
        media_type:                 digital
        pixel_size:                 2.4 2.4                    µm, of a row first
        image_size_in_pixels:       3648 5472                  rows first
        scanline_orientation:       4
        photo_coord_sys_orientation: 1
        photo_coord_sys_origin:     1823.5 2735.5              row first: the image's middle, so that the centre
    end camera_parameters                                      of the top-left pixel is (0, 0)

With the flag off the images are free of distortion: Pix4D writes this file for the images that it undistorted,
so its focal length is not that of the camera's own images.

Source: files that Pix4D exported.
"""

from __future__ import annotations

import re

from msgspec import Struct, field

from calibrary.calibration import Calibration, Grade
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential, Unit
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._text_rows import rows_of

BEGIN, END = "begin camera_parameters", "end camera_parameters"
ONLY_KNOWN = {
    "camera_type": "frame",
    "media_type": "digital",
    "scanline_orientation": "4",
    "photo_coord_sys_orientation": "1",
}
"""Values that other ones of which no file shows the meaning."""

CONVENTION = Convention(
    unit=Unit.MILLIMETRE,
    origin=Origin.PIXEL_CENTRE,
    tangential=Tangential.NONE,
    remarks=(
        "pairs name the row first",
        "ppac is x to the right and y up from photo_coord_sys_origin",
        "with lens_distortion_flag off the images are free of distortion",
    ),
)
UNDISTORTED = "it describes images that are free of distortion; those the camera took may not be"
LENS_LEFT = "lens_distortion_flag is on, but no source describes its lens model, so the distortion is unknown"

_ROW = re.compile(r"(\w{1,60})\s*:\s*(.*)")


class _Camera(Struct):
    """One block."""

    name: str
    place: str
    rows: dict[str, str] = field(default_factory=dict)

    def numbers(self, key: str, count: int) -> tuple[float, ...]:
        """A row's numbers."""
        return strict.numbers(self.text(key), count=count, place=f"{self.place}, {key}")

    def text(self, key: str) -> str:
        """What stands behind the colon."""
        if key not in self.rows:
            raise ParseError(f"there is no {key}", place=self.place)
        return self.rows[key].strip()


def sniff(content: Content) -> Sniff | None:
    """A block's first line."""
    if any(line.startswith(BEGIN) for line in content.lines):
        return Sniff(Sure.MAGIC, f"there is a line '{BEGIN} …'")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in order."""
    cameras = _blocks(data)
    several = len(cameras) > 1
    return [_calibration(camera, context, several=several) for camera in cameras]


def _blocks(data: bytes) -> list[_Camera]:
    cameras: list[_Camera] = []
    inside = False
    for index, line in enumerate(rows_of(data), start=1):
        row = line.strip()
        if row.startswith(BEGIN):
            cameras.append(_Camera(row.removeprefix(BEGIN).strip(), f"line {index}"))
            inside = True
        elif row == END:
            inside = False
        elif inside and (found := _ROW.match(row)):
            key, value = found.groups()
            if key in cameras[-1].rows:
                raise ParseError(f"{key} is a duplicate key", place=f"line {index}")
            cameras[-1].rows[key] = value
    if not cameras:
        raise ParseError(f"there is no '{BEGIN}'")
    if inside:
        raise ParseError(f"there is no '{END}'", place=cameras[-1].place)
    return cameras


def _calibration(camera: _Camera, context: ReadContext, *, several: bool) -> Calibration:
    for key, known in ONLY_KNOWN.items():
        if camera.text(key) != known:
            raise UnsupportedModelError(
                f"{key} is {strict.shown(camera.text(key))}; what other values than {known} mean is not known; "
                "export the camera from the adjustment in another format",
                place=camera.place,
            )
    rows, columns = camera.numbers("image_size_in_pixels", 2)
    size = context.size(strict.image_size(columns, rows, place=camera.place))
    pixel_down, pixel_across = (value / 1000 for value in camera.numbers("pixel_size", 2))
    if not (pixel_down > 0 and pixel_across > 0):
        raise ParseError("the pixel size is not positive", place=camera.place)
    [focal] = camera.numbers("focal_length", 1)
    origin_row, origin_column = camera.numbers("photo_coord_sys_origin", 2)
    x, y = camera.numbers("ppac", 2)
    native = Native(fx=focal, fy=focal, cx=origin_column * pixel_across + x, cy=origin_row * pixel_down - y)
    sensor = (size[0] * pixel_across, size[1] * pixel_down)
    free = camera.text("lens_distortion_flag") == "off"
    return context.calibration(
        CONVENTION.intrinsics(native, size, sensor_mm=sensor),
        NoDistortion() if free else None,
        name=(camera.name or camera.place) if several else None,
        tag=camera.name or None,
        grade=Grade.ADJUSTED,
        notes=(UNDISTORTED if free else LENS_LEFT,),
    )


FORMAT = Format(
    name="zi_ssk",
    title="Z/I Imaging camera (.ssk)",
    suffixes=(".ssk",),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/UTokyo-FieldPhenomics-Lab/EasyIDP",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
