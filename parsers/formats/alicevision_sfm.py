"""AliceVision's and Meshroom's ``.sfm`` (and ``cameraInit.sfm``, also as ``.json``): JSON whose values are strings.

In the format's own words, as of version 1.2.11::

    {"version": ["1", "2", "11"],
     "intrinsics": [{"intrinsicId": "7", "width": "4092", "height": "2048", "sensorWidth": "36",
       "sensorHeight": "24", "type": "pinhole", "initializationMode": "estimated", "initialFocalLength": "-1",
       "focalLength": "17.59", "pixelRatio": "2", "principalPoint": ["-26", "16"],
       "distortionType": "radialk3", "distortionParams": ["0.1", "0.05", "-0.001"], …}]}

An empty list is written "". What the numbers mean has changed with the version:

* before 1.2.2 ``pxFocalLength`` is in pixels, one number before 1.2.0 and two since;
* since 1.2.2 ``focalLength`` is in mm: of fx, with fy = fx / pixelRatio, and since 1.2.5 fy = fx · pixelRatio;
  since 1.2.11 it is of fy, with fx = fy / pixelRatio;
* ``principalPoint`` counts from the image's corner before 1.2.1, and since then from W/2, H/2;
* before 1.2.8 ``type`` names the lens too: radial1, radial3, brown, fisheye4, fisheye1.

The millimetres of an upright image are ambiguous: AliceVision divides by the longer side when it writes a file and by
the width when it reads one. Whether its pixels count from their corners or centres is not documented; features and
images are sampled at pixel centres, so calibrary reads them as OpenCV's. brown is k1 k2 k3 t1 t2 with OpenCV's p1, p2
as t1, t2.

Sources: AliceVision, ``src/aliceVision/sfmDataIO/jsonIO.cpp`` and ``src/aliceVision/camera``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize
from calibrary.distortion import BrownConrady, Distortion, FieldOfView, KannalaBrandt, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, Option, ReadContext, Sniff, Sure
from calibrary.parsers.formats._json_text import loaded

Version: TypeAlias = tuple[int, int, int]

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "k3", "t1", "t2"),
    remarks=(
        "the principal point is in the file as an offset from W/2, H/2, before version 1.2.1 from the corner",
        "the origin is not documented: it is read as the centre of the top-left pixel",
    ),
)
NOTE = (
    "AliceVision does not state whether it counts from the centre of the first pixel or its corner; "
    "it was read as the centre"
)
FOCAL_SIDE = Option(
    name="focal_side",
    values=("width", "longer"),
    meaning="which side of an upright image its focal length in mm and sensorWidth go with",
)
LENS_BEFORE_1_2_8 = {
    "pinhole": "none", "radial1": "radialk1", "radial3": "radialk3", "brown": "brown",
    "fisheye4": "fisheye", "fisheye": "fisheye", "fisheye1": "fisheye1",
}  # fmt: skip
LENSES: Mapping[str, tuple[int, Callable[..., Distortion]]] = {
    "none": (0, NoDistortion),
    "radialk1": (1, lambda k1: BrownConrady(k1=k1, k2=0.0, p1=0.0, p2=0.0)),
    "radialk3": (3, lambda k1, k2, k3: BrownConrady(k1=k1, k2=k2, p1=0.0, p2=0.0, k3=k3)),
    "brown": (5, lambda k1, k2, k3, t1, t2: BrownConrady(k1=k1, k2=k2, p1=t1, p2=t2, k3=k3)),
    "fisheye": (4, lambda k1, k2, k3, k4: KannalaBrandt(k1=k1, k2=k2, k3=k3, k4=k4)),
    "fisheye1": (1, lambda omega: FieldOfView(omega=omega)),
}
GRADES = {"calibrated": Grade.CALIBRATED, "estimated": Grade.DERIVED, "unknown": Grade.SEED}
"""By how a camera that was not adjusted was initialised: by the user, by EXIF and a table of sensors, by a guess."""
SENSOR_WIDTH_MM = 36.0
MAX_CAMERAS = 10_000


def sniff(content: Content) -> Sniff | None:
    """A version that is a list, and intrinsics with an id."""
    document = content.json
    if not isinstance(document, dict) or not isinstance(document.get("version"), list):
        return None
    intrinsics = document.get("intrinsics")
    first = intrinsics[0] if isinstance(intrinsics, list) and intrinsics else None
    if isinstance(first, dict) and "intrinsicId" in first:
        return Sniff(Sure.MAGIC, "JSON with a version and intrinsics that have an intrinsicId")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every intrinsic, in order."""
    document = loaded(data, context)
    version = _version(document["version"])
    intrinsics = _items(document["intrinsics"])
    if len(intrinsics) > MAX_CAMERAS:
        raise ParseError(f"there are over {MAX_CAMERAS} intrinsics")
    posed = bool(_items(document["poses"])) if "poses" in document else False
    makers = _makers(document)
    return [
        _calibration(item, version, context, posed=posed, several=len(intrinsics) > 1, makers=makers)
        for item in intrinsics
    ]


def _version(node: Node) -> Version:
    numbers = [item.whole() for item in node.items()]
    if len(numbers) != 3 or numbers[0] != 1:
        shown = ".".join(map(str, numbers[:4]))
        node.fail(
            f"version {shown} is not known here, expected 1.x.y; save it again with an AliceVision of today"
        )
    return numbers[0], numbers[1], numbers[2]


def _calibration(
    item: Node,
    version: Version,
    context: ReadContext,
    *,
    posed: bool,
    several: bool,
    makers: Mapping[str, tuple[str | None, str | None]],
) -> Calibration:
    name = _text(item, "intrinsicId")
    size = context.size(item.image_size("width", "height"))
    fx, fy, assumptions = _focals(item, size, version, context)
    cx, cy = item["principalPoint"].numbers(2)
    if version >= (1, 2, 1):
        cx, cy = cx + size[0] / 2, cy + size[1] / 2
    make, model = makers.get(name, (None, None))
    return Calibration(
        camera=CameraKey(make=make, model=model, image_size=size, sub_camera=name if several else None),
        intrinsics=CONVENTION.intrinsics(Native(fx=fx, fy=fy, cx=cx, cy=cy), size),
        distortion=_lens(item, version),
        grade=_grade(item, posed=posed),
        provenance=context.provenance(
            tag=f"intrinsic {name}",
            assumptions=assumptions,
            tool=f"AliceVision, file version {'.'.join(map(str, version))}",
        ),
        notes=(NOTE,),
    )


def _focals(
    item: Node, size: ImageSize, version: Version, context: ReadContext
) -> tuple[float, float, tuple[str, ...]]:
    """Fx and fy in px, and what had to be assumed."""
    if "pxFocalLength" in item:
        node = item["pxFocalLength"]
        focals = node.numbers(2) if isinstance(node.value, list) else (node.number(),) * 2
        return focals[0], focals[1], ()
    assumptions: tuple[str, ...] = ()
    if "sensorWidth" in item:
        sensor_mm = item["sensorWidth"].number()
    else:
        sensor_mm, assumptions = SENSOR_WIDTH_MM, (f"the sensor is {SENSOR_WIDTH_MM:g} mm wide",)
    if not sensor_mm > 0:
        item.fail(f"sensorWidth is {sensor_mm:g} mm, expected more, to make pixels of a focal length in mm")
    focal = item["focalLength"].number() / sensor_mm * _side(size, context, item.place)
    ratio = item["pixelRatio"].number() if "pixelRatio" in item else 1.0
    if not ratio > 0:
        item.fail(f"pixelRatio is {ratio:g}, expected more than 0")
    if version < (1, 2, 5):
        return focal, focal / ratio, assumptions
    if version < (1, 2, 11):
        return focal, focal * ratio, assumptions
    return focal / ratio, focal, assumptions


def _side(size: ImageSize, context: ReadContext, place: str | None) -> int:
    """The side that sensorWidth goes with.

    Raises:
        ParseError: the image is upright, and the caller did not say.
    """
    width, height = size
    asked = context.option(FOCAL_SIDE.name)
    if height > width and asked is None:
        raise ParseError(
            f"the image is {width}×{height}, and AliceVision writes the mm of an upright one by its longer side but "
            "reads them by its width; say which is meant with --set focal_side=longer or "
            "focal_side=width",
            place=place,
        )
    return max(size) if asked == "longer" else width


def _lens(item: Node, version: Version) -> Distortion:
    kind = _text(item, "type")
    if version < (1, 2, 8):
        lens = LENS_BEFORE_1_2_8.get(kind)
    else:
        lens = _text(item, "distortionType") if "distortionType" in item else "none"
        lens = lens if kind == "pinhole" else None
    if lens is None or lens not in LENSES:
        name = f"{kind} with {lens}" if lens else kind
        raise UnsupportedModelError(
            f"{strict.shown(name)} has no counterpart here; expected a pinhole with one of {', '.join(LENSES)}",
            source=item.source,
            place=item.place,
        )
    _refuse_undistortion(item)
    count, build = LENSES[lens]
    node = item.get("distortionParams")
    numbers = () if node is None else tuple(entry.number() for entry in _items(node))
    # AliceVision fills up a list that is empty.
    numbers = numbers or (0.0,) * count
    strict.check_count(len(numbers), count, source=item.source, place=item.place)
    distortion = build(*numbers)
    straight = isinstance(distortion, BrownConrady) and not any(numbers)
    return NoDistortion() if straight else distortion


def _refuse_undistortion(item: Node) -> None:
    """A second lens, of 3DEqualizer's models, that takes the distorted point to the undistorted one."""
    kind = _text(item, "undistortionType") if "undistortionType" in item else "none"
    given = _items(item["undistortionParams"]) if "undistortionParams" in item else ()
    if kind != "none" and any(entry.number() for entry in given):
        raise UnsupportedModelError(
            f"it is corrected by {strict.shown(kind)}, which has no counterpart here; undistort the images first",
            source=item.source,
            place=item.place,
        )


def _grade(item: Node, *, posed: bool) -> Grade:
    """Adjusted where there are poses, or where the focal length is no longer the initial one."""
    mode = _text(item, "initializationMode") if "initializationMode" in item else ""
    moved = any(
        after in item and before in item and item[after].value != item[before].value
        for before, after in (
            ("initialFocalLength", "focalLength"),
            ("pxInitialFocalLength", "pxFocalLength"),
        )
    )
    return Grade.ADJUSTED if posed or moved else GRADES.get(mode, Grade.ADJUSTED)


def _makers(document: Node) -> Mapping[str, tuple[str | None, str | None]]:
    """Make and Model out of the EXIF of the first image of each intrinsic."""
    views = document["views"].value if "views" in document else None
    found: dict[str, tuple[str | None, str | None]] = {}
    for view in views if isinstance(views, list) else ():
        key = view.get("intrinsicId") if isinstance(view, dict) else None
        if not isinstance(view, dict) or not isinstance(key, str | int) or str(key) in found:
            continue
        metadata = view.get("metadata")
        tags = metadata if isinstance(metadata, dict) else {}
        make, model = (tags.get(f"Exif:{name}", tags.get(name)) for name in ("Make", "Model"))
        found[str(key)] = (
            make if isinstance(make, str) and make else None,
            model if isinstance(model, str) and model else None,
        )
    return found


def _items(node: Node) -> tuple[Node, ...]:
    """A list, of which an empty one is written ""."""
    return () if node.value == "" else node.items()


def _text(item: Node, key: str) -> str:
    """Text, or a whole number as files of other programs have it."""
    value = item[key].value
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else item[key].text()


FORMAT = Format(
    name="alicevision_sfm",
    title="AliceVision and Meshroom .sfm",
    suffixes=(".sfm", ".json"),
    syntaxes=(Syntax.JSON,),
    reference="https://github.com/alicevision/AliceVision/blob/develop/src/aliceVision/sfmDataIO/jsonIO.cpp",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    states=("tool",),
    options=(FOCAL_SIDE,),
)
