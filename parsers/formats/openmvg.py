"""OpenMVG's ``sfm_data.json``: cameras among views and poses, as the serialisation library cereal writes them.

In the format's own words::

    {"sfm_data_version": "0.3", "views": […], "intrinsics": [{"key": 0, "value": {
       "polymorphic_id": 2147483649, "polymorphic_name": "pinhole_radial_k3",
       "ptr_wrapper": {"id": 2147483660, "data": {"width": 4000, "height": 3000, "focal_length": 2856.4,
         "principal_point": [1992.3, 1520.1], "disto_k3": [-0.02, 0.01, 0.0]}}}}], "extrinsics": […]}

cereal names a class once: later cameras of the class have only its number, ``polymorphic_id``, without the high
bit; and a camera that occurs twice has its ``data`` once. There is one focal length, in pixels. ``disto_t2`` of
``pinhole_brown_t2`` is k1 k2 k3 t1 t2 with OpenCV's p1, p2 as t1, t2; ``fisheye`` is OpenCV's. Whether pixels
count from their corners or centres is not documented: these are read as OpenCV's.

Without extrinsics nothing has been adjusted, and the camera comes only from EXIF and a table of sensors.

Sources: OpenMVG, ``src/openMVG/cameras`` and its documentation, "SfM data format".
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from msgspec import Struct

from calibrary.calibration import Calibration, Grade
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._json_text import loaded
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "k3", "t1", "t2"),
    remarks=(
        "one focal length",
        "the origin is not documented: it is read as the centre of the top-left pixel",
    ),
)
NOTE = "OpenMVG does not state if it counts from the centre of the first pixel or its corner; the centre was assumed"
FIRST_OF_ITS_KIND = 0x80000000
"""cereal's high bit: what follows is new, its name or its data comes with it."""
PLAIN = 0x40000000
"""cereal's number for an object of the very class the pointer is declared for, which has no name."""
MAX_CAMERAS = 1_000_000


class _Class(Struct, frozen=True):
    """One of OpenMVG's cameras: where its coefficients stand, how many, and what they are here."""

    key: str | None
    count: int
    lens: Callable[..., Distortion]


CLASSES: Mapping[str, _Class] = {
    "pinhole": _Class(None, 0, NoDistortion),
    "pinhole_radial_k1": _Class("disto_k1", 1, lambda k1: BrownConrady(k1=k1, k2=0.0, p1=0.0, p2=0.0)),
    "pinhole_radial_k3": _Class(
        "disto_k3", 3, lambda k1, k2, k3: BrownConrady(k1=k1, k2=k2, p1=0.0, p2=0.0, k3=k3)
    ),
    "pinhole_brown_t2": _Class(
        "disto_t2", 5, lambda k1, k2, k3, t1, t2: BrownConrady(k1=k1, k2=k2, p1=t1, p2=t2, k3=k3)
    ),
    "fisheye": _Class("fisheye", 4, lambda k1, k2, k3, k4: KannalaBrandt(k1=k1, k2=k2, k3=k3, k4=k4)),
}


def sniff(content: Content) -> Sniff | None:
    """A key that no other format has."""
    if "sfm_data_version" in content.json_keys:
        return Sniff(Sure.MAGIC, "JSON with sfm_data_version")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every intrinsic, in order."""
    document = loaded(data, context)
    found = list(_cameras(document["intrinsics"]))
    if len(found) > MAX_CAMERAS:
        raise ParseError(f"there are over {MAX_CAMERAS} intrinsics")
    version = document["sfm_data_version"].text()
    extrinsics = document.get("extrinsics")
    posed = extrinsics is not None and bool(extrinsics.items())
    cameras = [_calibration(*item, context, posed=posed, several=len(found) > 1) for item in found]
    tool = f"OpenMVG, sfm_data version {version}"
    return [replace(item, provenance=replace(item.provenance, tool=tool)) for item in cameras]


def _cameras(intrinsics: Node) -> Iterator[tuple[str, str, Node]]:
    """Key, class and data of each, with cereal's abbreviations written out."""
    names: dict[int, str] = {}
    objects: dict[int, Node] = {}
    for entry in intrinsics.items():
        value = entry["value"]
        number = value["polymorphic_id"].whole()
        if number >= FIRST_OF_ITS_KIND:
            names[number - FIRST_OF_ITS_KIND] = value["polymorphic_name"].text()
        wrapper = value["ptr_wrapper"]
        pointer = wrapper["id"].whole()
        if pointer >= FIRST_OF_ITS_KIND:
            objects[pointer - FIRST_OF_ITS_KIND] = wrapper["data"]
        here = objects.get(pointer % FIRST_OF_ITS_KIND)
        if here is None:
            wrapper.fail(f"it points to object {pointer}, which does not come before it")
        name = names.get(number % FIRST_OF_ITS_KIND)
        if name is None and number != PLAIN:
            value.fail(f"its class has number {number}, to which no name was given before")
        yield str(entry["key"].whole()), name or _by_its_keys(here), here


def _by_its_keys(data: Node) -> str:
    """The class of a camera without a name."""
    return next(
        (name for name, kind in CLASSES.items() if kind.key is not None and kind.key in data), "pinhole"
    )


def _calibration(
    key: str, name: str, data: Node, context: ReadContext, *, posed: bool, several: bool
) -> Calibration:
    kind = CLASSES.get(name)
    if kind is None:
        raise UnsupportedModelError(
            f"{strict.shown(name)} has no counterpart here; expected one of {', '.join(CLASSES)}",
            source=data.source,
            place=data.place,
        )
    size = context.size(data.image_size("width", "height"))
    focal = data["focal_length"].number()
    cx, cy = data["principal_point"].numbers(2)
    numbers = () if kind.key is None else data[kind.key].numbers(kind.count)
    untouched = not any(numbers) and (cx, cy) == (size[0] / 2, size[1] / 2)
    straight = not any(numbers) and name != "fisheye"
    guess = not posed and untouched
    start = ("no image is posed, so this is what OpenMVG starts from, out of EXIF or a table of sensors",)
    return context.calibration(
        CONVENTION.intrinsics(Native(fx=focal, fy=focal, cx=cx, cy=cy), size),
        NoDistortion() if straight else kind.lens(*numbers),
        name=key if several else None,
        tag=f"intrinsic {key}",
        grade=Grade.PRIOR if guess else Grade.ADJUSTED,
        notes=(NOTE, *(start if guess else ())),
    )


FORMAT = Format(
    name="openmvg",
    title="OpenMVG sfm_data.json",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://openmvg.readthedocs.io/en/latest/software/SfM/SfM_OutputFormat/",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    states=("tool",),
)
