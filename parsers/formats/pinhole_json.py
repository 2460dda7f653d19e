"""fx, fy, cx and cy by name in JSON: Polycam's camera files, and what scripts write of ARKit or OpenCV.

In the format's own words::

    {"fx": 1360.2, "fy": 1360.2, "cx": 514.9, "cy": 385.3, "width": 1024, "height": 768,
     "t_00": 0.7, …, "blur_score": 120.3}                                                   Polycam, one for each image
    {"fx": 433.2, "fy": 432.9, "cx": 371.6, "cy": 238.3, "k1": -0.21, "k2": 0.04, "p1": 0, "p2": 0}

Polycam's numbers are ARKit's, which count from the corner of the image. For other programs nothing states the origin,
so it is read as OpenCV's; ``--pixel-origin`` chooses another. Coefficients are OpenCV's by name; without coefficients
the distortion is unknown. Many files do not state the image size.

Sources: Polycam, "Raw data export", whose program is closed; nerfstudio, ``process_data/polycam_utils.py``, which
copies the numbers unchanged to a transforms.json, and ``cameras/cameras.py``, ``get_image_coords``, which has the
pixels' centres at 0.5, 1.5, … of it.
"""

from __future__ import annotations

from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import Distortion
from calibrary.errors import ParseError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, Option, ReadContext, Sniff, Sure
from calibrary.parsers.formats._by_shape import lens_of, lifted
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._one_camera import camera
from calibrary.parsers.formats._opencv_lens import smallest_lens
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    remarks=("every number has its name", "Polycam counts from the outer corner of the top-left pixel"),
)
ORIGIN = Option(
    name="origin",
    values=("corner", "centre"),
    meaning="whether cx and cy count from the top-left pixel's outer corner or, as OpenCV's, from its centre",
)
PLACE = ("fx", "fy", "cx", "cy")
SIZES = (("width", "height"), ("w", "h"), ("image_width", "image_height"))
POLYCAM = ("t_00", "t_01")
FOREIGN = frozenset({"model", "camera_model", "type", "distortion_model", "coeffs", "projection_type", "ppx"})
"""Of programs whose coefficients need more than a name."""


def sniff(content: Content) -> Sniff | None:
    """The four names, and none of a program with a model of its own."""
    keys = set(content.json_keys)
    if not set(PLACE) <= keys or FOREIGN & keys:
        return None
    if set(POLYCAM) <= keys:
        return Sniff(Sure.MAGIC, "JSON with fx, fy, cx, cy and Polycam's t_00")
    return Sniff(Sure.SHAPE, "JSON with fx, fy, cx and cy")


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera."""
    document = lifted(loaded(data, context))
    foreign = min(FOREIGN.intersection(document.keys()), default=None)
    if foreign:
        document.fail(f"{foreign} belongs to a program with a model of its own")
    fx, fy, cx, cy = (document[key].number() for key in PLACE)
    is_polycam = all(key in document for key in POLYCAM)
    origin, sentence = chosen_origin(context, Origin.CORNER if is_polycam else Origin.PIXEL_CENTRE)
    convention = replace(CONVENTION, origin=origin)
    native = Native(fx=fx, fy=fy, cx=cx, cy=cy)
    return [camera(context, convention, native, _size(document), _lens(document), assumptions=(sentence,))]


def chosen_origin(context: ReadContext, usual: Origin) -> tuple[Origin, str]:
    """Where the principal point counts from, as the caller says or as is usual, and that in words."""
    asked = context.option(ORIGIN.name)
    if asked is None:
        taken = f"{usual.value} was taken, unless --pixel-origin says otherwise"
        return usual, f"the file does not say where cx and cy count from; {taken}"
    origin = Origin.CORNER if asked == "corner" else Origin.PIXEL_CENTRE
    return origin, f"cx and cy count from {origin.value}, as the caller says"


def _size(document: Node) -> ImageSize | None:
    for width, height in SIZES:
        if width in document and height in document:
            return document.image_size(width, height)
    return None


def _lens(document: Node) -> Distortion | None:
    """OpenCV's model of the coefficients that are there, None where there is none."""
    names = CONVENTION.coefficients
    if not any(name in document for name in names):
        return lens_of(document)[2]
    if "k3" in document and "k4" in document and not {"p1", "p2", "k5"} & set(document.keys()):
        raise ParseError(
            "k1 to k4 without p1 and p2 look like a fisheye's, and the file does not say so; write them into an "
            "OpenCV file"
        )
    return smallest_lens([document[name].number() if name in document else 0.0 for name in names])


FORMAT = Format(
    name="pinhole_json",
    title="fx, fy, cx, cy in JSON (Polycam and others)",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://github.com/PolyCam/polyform",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    options=(ORIGIN,),
)
