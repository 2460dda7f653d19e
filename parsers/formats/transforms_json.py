"""``transforms.json`` of instant-ngp and nerfstudio: the cameras of a radiance field.

In the format's own words::

    {"camera_model": "OPENCV", "w": 1920, "h": 1080, "fl_x": 1375.5, "fl_y": 1374.5, "cx": 960.1, "cy": 540.3,
     "k1": 0.05, "k2": -0.08, "p1": -0.001, "p2": 0.0002,
     "frames": [{"file_path": "images/0001.jpg", "transform_matrix": […]}, …]}

Each frame may have these keys itself instead; frames with the same numbers are one camera. Pixels count from the outer
corner of the top-left one: nerfstudio takes half a pixel off before it calls OpenCV. A missing coefficient is zero, and
a missing principal point is in the middle. Blender's files have ``camera_angle_x``, the field of view in radians,
instead of ``fl_x``, and state no size either. ``camera_model`` OPENCV_FISHEYE, or ``is_fisheye``, makes k1 to k4 those
of OpenCV's fisheye. In a perspective camera k4 means two things: nerfstudio projects with it as a factor of r⁸ and
undistorts with it as OpenCV's k4, so a file that has one is refused. Scripts put the coefficients under other names
(``D``, ``K1``, a table ``distortion``); those are read by their shape (``hand_made``).

Sources: instant-ngp, ``src/nerf_loader.cu``; nerfstudio, ``data/dataparsers/nerfstudio_dataparser.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set

from msgspec import Struct

from calibrary.calibration import Calibration, Grade, ImageSize, Quality
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt, NoDistortion, required
from calibrary.errors import MissingTagError, ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._json_text import Writable, dumped, extra, loaded, restored
from calibrary.parsers.formats.hand_made import lens_in
from calibrary.parsers.names import Family
from calibrary.records import Json, replace

CONVENTION = Convention(
    origin=Origin.CORNER,
    coefficients=("k1", "k2", "p1", "p2", "k3", "k4"),
    remarks=("every number is named, and a missing coefficient is zero",),
)
PLACE = ("fl_x", "fl_y", "cx", "cy")
ANGLES = ("camera_angle_x", "camera_angle_y")
SIZE = ("w", "h")
LENS = ("k1", "k2", "k3", "k4", "p1", "p2")
NUMBERS = (*SIZE, *PLACE, *ANGLES, *LENS)
PERSPECTIVE = frozenset({"PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"})
FISHEYE = "OPENCV_FISHEYE"
OTHER_LENSES = ("is_latlong", "latlong", "equirectangular", "orthographic", "ftheta_p0")
"""instant-ngp's keys for cameras that have no K."""
MAX_FRAMES = 1_000_000
PREFIX = "transforms_json/"
KNOWN = frozenset({*NUMBERS, "camera_model", "is_fisheye", "frames"})
AGREEMENT = 1e-3


class _Images(Struct, frozen=True):
    """A camera's numbers, and the names of the images that it took."""

    numbers: dict[str, float]
    names: list[str]


def sniff(content: Content) -> Sniff | None:
    """Frames with a transform, or a focal length under instant-ngp's name."""
    document = content.json
    if not isinstance(document, dict):
        return None
    frames = document.get("frames")
    first = frames[0] if isinstance(frames, list) and frames else None
    posed = isinstance(first, dict) and ("transform_matrix" in first or "fl_x" in first)
    camera = next((key for key in ("fl_x", "camera_angle_x") if key in document), None)
    if posed or (camera and isinstance(frames, list)):
        return Sniff(Sure.MAGIC, f"JSON with frames and {camera or 'their transforms'}")
    return Sniff(Sure.SHAPE, "JSON with fl_x") if camera == "fl_x" else None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera that differs, in the order of the frames, by the name of its first image."""
    document = loaded(data, context)
    fisheye = _is_fisheye(document)
    shared = _numbers(document)
    keys, elsewhere = (
        ((), None) if set(LENS) & shared.keys() else _lens_elsewhere(document, context, fisheye=fisheye)
    )
    images: dict[object, _Images] = {}
    for index, frame in enumerate(_frames(document.get("frames"))):
        numbers = _merged(shared, frame)
        # A frame without a pose is not an image of a scene: it is there for its camera.
        own = None if "transform_matrix" in frame else index
        one = images.setdefault((own, *sorted(numbers.items())), _Images(numbers, []))
        path = frame.get("file_path")
        one.names.append("" if path is None else path.text())
    if not images:
        images[None] = _Images(shared, [])
    extras = tuple(_extras(document, {*KNOWN, *keys}))
    return [
        _calibration(
            one, context, fisheye=fisheye, elsewhere=elsewhere, several=len(images) > 1, extras=extras
        )
        for one in images.values()
    ]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """One camera beside an empty list of frames, several in a frame each; nerfstudio needs the poses too.

    Raises:
        UnsupportedModelError: the file can say only of all cameras together whether they are fisheyes.
    """
    kinds = {_kind(item.distortion) for item in calibrations}
    if FISHEYE in kinds and len(kinds) > 1:
        raise UnsupportedModelError(
            "fisheye and other cameras cannot share a transforms.json; write two files"
        )
    [kind] = kinds if len(kinds) == 1 else {"OPENCV"}
    head: dict[str, Writable] = {"camera_model": kind}
    if kind == FISHEYE:
        head["is_fisheye"] = True
    for key, text in calibrations[0].extras:
        if key.startswith(PREFIX) and key.removeprefix(PREFIX) not in KNOWN:
            head[key.removeprefix(PREFIX)] = restored(text)
    if len(calibrations) == 1:
        return dumped({**head, **_written(calibrations[0]), "frames": []})
    frames: list[Writable] = [
        {"file_path": item.camera.sub_camera or f"camera {index}", **_written(item)}
        for index, item in enumerate(calibrations, start=1)
    ]
    return dumped({**head, "frames": frames})


def _frames(frames: Node | None) -> tuple[Node, ...]:
    found = () if frames is None else frames.items()
    if len(found) > MAX_FRAMES and frames is not None:
        frames.fail(f"{len(found)} frames; at most {MAX_FRAMES} are read")
    return found


def _is_fisheye(document: Node) -> bool:
    """Whether k1 to k4 are OpenCV's fisheye's.

    Raises:
        UnsupportedModelError: the cameras have no K, or none that is known here.
        ParseError: the two keys that say it contradict one another.
    """
    other = next((key for key in OTHER_LENSES if key in document and document[key].value), None)
    node = document.get("camera_model")
    model = None if node is None else node.text()
    if other or (model is not None and model != FISHEYE and model not in PERSPECTIVE):
        raise UnsupportedModelError(
            f"the cameras are {strict.shown(other or model or '')}, which has no counterpart here; expected "
            f"{', '.join(sorted(PERSPECTIVE))} or {FISHEYE}",
            source=document.source,
        )
    mark = document.get("is_fisheye")
    if model is None or mark is None:
        return model == FISHEYE or (mark is not None and bool(mark.value))
    if bool(mark.value) != (model == FISHEYE):
        document.fail(f"camera_model is {model} and is_fisheye is {mark.value!r}; remove the wrong one")
    return model == FISHEYE


def _numbers(node: Node) -> dict[str, float]:
    return {key: node[key].number() for key in NUMBERS if key in node}


def _merged(shared: Mapping[str, float], frame: Node) -> dict[str, float]:
    """A frame's numbers; where the file says them twice they must agree.

    nerfstudio takes those above the frames, instant-ngp those of the frame.
    """
    own = _numbers(frame)
    clash = next((key for key, value in own.items() if shared.get(key, value) != value), None)
    if clash is not None:
        frame.fail(
            f"{clash} is {own[clash]:g} here and {shared[clash]:g} above the frames; nerfstudio takes that one, "
            "instant-ngp this one: remove one of them"
        )
    both = {**shared, **own}
    missing = [key for key in SIZE if key not in both]
    if len(missing) == 1:
        frame.fail(f"it states no {missing[0]}, and nor does the file above its frames")
    return both


def _calibration(
    images: _Images,
    context: ReadContext,
    *,
    fisheye: bool,
    elsewhere: Distortion | None,
    several: bool,
    extras: tuple[tuple[str, str], ...],
) -> Calibration:
    numbers, names = images.numbers, images.names
    size = context.size(_size(numbers))
    native, assumptions = _native(numbers, size)
    name = (names[0] or None) if names else None
    calibration = context.calibration(
        CONVENTION.intrinsics(native, size),
        elsewhere
        if elsewhere is not None and not set(LENS) & numbers.keys()
        else _lens(numbers, fisheye=fisheye),
        name=name if several else None,
        tag=name,
        assumptions=assumptions,
        grade=Grade.ADJUSTED if "fl_x" in numbers else Grade.DESIGN,
        quality=Quality(views=len(names)) if names else None,
        notes=_contradiction(numbers, size),
    )
    return replace(calibration, extras=extras)


def _size(numbers: Mapping[str, float]) -> ImageSize | None:
    if not any(key in numbers for key in SIZE):
        return None
    missing = [key for key in SIZE if key not in numbers]
    if missing:
        raise ParseError(f"it states no {missing[0]}")
    return strict.image_size(numbers["w"], numbers["h"])


def _native(numbers: Mapping[str, float], size: ImageSize) -> tuple[Native, tuple[str, ...]]:
    """K, and what had to be assumed."""
    width, height = size
    assumptions: list[str] = []
    if "fl_x" in numbers:
        fx = numbers["fl_x"]
    elif "camera_angle_x" in numbers:
        fx = _focal(numbers["camera_angle_x"], width)
        assumptions.append("fl_x was taken from camera_angle_x")
    else:
        raise MissingTagError("there is neither fl_x nor camera_angle_x, so no focal length")
    if "fl_y" in numbers:
        fy = numbers["fl_y"]
    elif "camera_angle_y" in numbers:
        fy = _focal(numbers["camera_angle_y"], height)
        assumptions.append("fl_y was taken from camera_angle_y")
    else:
        fy = fx
        assumptions.append("pixels are square")
    if not ("cx" in numbers and "cy" in numbers):
        assumptions.append("the principal point is in the middle of the image")
    cx, cy = numbers.get("cx", width / 2), numbers.get("cy", height / 2)
    return Native(fx=fx, fy=fy, cx=cx, cy=cy), tuple(assumptions)


def _focal(angle_rad: float, side_px: int) -> float:
    """The focal length of a pinhole that sees the whole side under an angle."""
    if not 0 < angle_rad < math.pi:
        raise ParseError(f"the field of view is {angle_rad:g}, expected radians between 0 and 3.1416")
    return 0.5 * side_px / math.tan(0.5 * angle_rad)


def _lens(numbers: Mapping[str, float], *, fisheye: bool) -> Distortion:
    c = {key: numbers.get(key, 0.0) for key in LENS}
    odd = next((key for key in (("p1", "p2") if fisheye else ("k4",)) if c[key]), None)
    if odd is not None:
        meaning = "a fisheye has no tangential terms" if fisheye else "nerfstudio uses it in two meanings"
        raise UnsupportedModelError(
            f"{odd} is {c[odd]:g} and {meaning}; undistort the images first, or fit the camera without it",
            place=odd,
        )
    if fisheye:
        return KannalaBrandt(k1=c["k1"], k2=c["k2"], k3=c["k3"], k4=c["k4"])
    if not any(c.values()):
        return NoDistortion()
    return BrownConrady(k1=c["k1"], k2=c["k2"], p1=c["p1"], p2=c["p2"], k3=c["k3"])


def _lens_elsewhere(
    document: Node, context: ReadContext, *, fisheye: bool
) -> tuple[tuple[str, ...], Distortion | None]:
    """The lens that a script put there in other words, and the keys that state it; None where there is none."""
    rest = {key: value for key, value in _table(document).items() if key not in {"frames", "camera_model"}}
    stated = "camera_model" in document or "is_fisheye" in document
    family = (Family.FISHEYE if fisheye else Family.OPENCV) if stated else None
    keys, lens = lens_in(Node(rest, source=document.source), context, family=family)
    if lens is None or (stated and isinstance(lens, KannalaBrandt) is not fisheye):
        return (), None
    return (*keys, "distortion_model"), lens


def _table(document: Node) -> dict[str, Json]:
    return document.value if isinstance(document.value, dict) else {}


def _contradiction(numbers: Mapping[str, float], size: ImageSize) -> tuple[str, ...]:
    """A field of view that is not the focal length's own; both programs take the focal length."""
    notes: list[str] = []
    for angle, focal, side in zip(ANGLES, ("fl_x", "fl_y"), size, strict=True):
        if angle in numbers and focal in numbers and numbers[focal] > 0:
            own = 2.0 * math.atan(0.5 * side / numbers[focal])
            if abs(own - numbers[angle]) > AGREEMENT * own:
                notes.append(
                    f"{angle} is {numbers[angle]:.4g} rad, {focal} means {own:.4g}; {focal} was taken"
                )
    return tuple(notes)


def _extras(document: Node, used: Set[str]) -> list[tuple[str, str]]:
    kept = ((key, extra(node.value)) for key, node in document.entries() if key not in used)
    return [(PREFIX + key, text) for key, text in kept if text is not None]


def _kind(distortion: Distortion | None) -> str:
    if isinstance(distortion, KannalaBrandt):
        return FISHEYE
    return "PINHOLE" if distortion is None or isinstance(distortion, NoDistortion) else "OPENCV"


def _written(calibration: Calibration) -> dict[str, Writable]:
    native = CONVENTION.native(calibration.intrinsics)
    width, height = calibration.intrinsics.image_size
    numbers: dict[str, Writable] = {
        "w": width, "h": height, "fl_x": native.fx, "fl_y": native.fy, "cx": native.cx, "cy": native.cy,
    }  # fmt: skip
    lens = calibration.distortion
    if isinstance(lens, KannalaBrandt):
        return {**numbers, **lens.coefficients}
    brown = required(lens, BrownConrady)
    coefficients = {name: value for name, value in brown.coefficients.items() if value or name != "k3"}
    return {**numbers, **coefficients}


FORMAT = Format(
    name="transforms_json",
    title="nerfstudio and instant-ngp transforms.json",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://docs.nerf.studio/quickstart/data_conventions.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(NoDistortion, BrownConrady, KannalaBrandt), several_cameras=True),
)
