"""Cameras that people and scripts write down by hand, in whatever container: one K, a lens and an image size by name.

In the words of some of them::

    fx = 812.5                                              text; also fx: 812.5, fx,812.5 and below [sections]
    {"camera_matrix": [[812.5, 0, 330.2], …], "dist_coeffs": [-0.31, 0.11, 0.0004, -0.0002, 0.02], "size": "640x480"}
    camera matrix:
     [[812.5   0.  330.2] …                                 print() of numpy, OpenCV's samples, a terminal
    np.savez("calibration.npz", mtx=mtx, dist=dist)         members of npz and mat
    <intrinsics fx="812.5" fy="811.9" cx="330.2" cy="242.1"/>

Every container becomes one tree of names (``_tree``), in which one list of names says what each number is
(:mod:`calibrary.parsers.names`) and one rule what a camera is (``_by_hand``). It is asked after all formats of
programs. The names are those of OpenCV's functions, so the principal point counts from the centre of the top-left
pixel, lengths in millimetres from the edge of the sensor, and the number of coefficients determines the model: 5
Brown-Conrady, 8 rational, 12 thin prism, 14 tilted. Four are Brown's k1 k2 p1 p2 or a fisheye's k1 k2 k3 k4, and the
file has to state which. With ``xi`` they are those of ``cv2.omnidir``, whose focal lengths are (1 + xi) times those of
the pinhole near the axis.

Sources: OpenCV, "Camera Calibration and 3D Reconstruction" and its samples; opencv_contrib,
``modules/ccalib/src/omnidir.cpp``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from typing import NoReturn

from calibrary.calibration import Calibration, Grade, ImageSize, Intrinsics, Quality
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt, NoDistortion, Rational, Unified
from calibrary.errors import InputError, MissingSizeError, ParseError, UnsupportedModelError
from calibrary.image_size import ASPECT_TOLERANCE
from calibrary.parsers import names
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax, ended
from calibrary.parsers.convention import Convention, Native, Origin, YAxis
from calibrary.parsers.document import Node, hand_on, handed_on
from calibrary.parsers.format import STATED, Format, Option, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _by_hand as by_hand
from calibrary.parsers.formats._by_hand import OF_LENS, TERMS, Entry, Part, cameras_in, statements_in
from calibrary.parsers.formats._lenses import COUNTS, lens, smallest_lens
from calibrary.parsers.formats._tree import LONGER, MAT, NPY, tree_of
from calibrary.parsers.names import Family, simplified
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"),
    remarks=(
        "cv2.fisheye's four are k1, k2, k3, k4",
        "lengths in millimetres count from the edge of the sensor",
        "with xi of cv2.omnidir, K has the file's focal lengths, (1 + xi) times those of the pinhole near the axis",
    ),
)
ORIGINS = {
    "corner": Origin.CORNER,
    "centre": Origin.PIXEL_CENTRE,
    "pixel-centre": Origin.PIXEL_CENTRE,
    "image-centre": Origin.IMAGE_CENTRE,
}
UNIT = Option(name="unit", values=("px", "mm"), meaning="the unit of lengths that state none")
ORIGIN = Option(
    name="origin",
    values=tuple(ORIGINS),
    meaning="what the principal point is counted from: the outer corner of the top-left pixel, that pixel's "
    "centre, or the middle of the image",
)
Y_AXIS = Option(name="y_axis", values=("down", "up"), meaning="direction of y, in image and distortion")
DISTORTION = Option(
    name="distortion",
    values=("brown", "fisheye"),
    meaning="whether the coefficients are those of OpenCV's pinhole (k1 k2 p1 p2 …) or of cv2.fisheye (k1 k2 k3 k4)",
)
MM = {"mm": 1.0, "um": 1e-3}
OWN_KEYS = frozenset({("cameramatrix", "distortioncoefficients"), ("m", "d")})
"""Keys of OpenCV's calibration and stereo samples; their coefficients are Brown's unless stated otherwise."""
NEAR = 0.15
FAR = 0.25
"""Shares of a side: how near the middle a principal point is in the right frame, and how far off in a wrong one."""
CORNER = 0.1
"""Share of a side: a principal point nearer the corner was counted from elsewhere."""
LONGEST_EXTRA = 4096
SHORTEST = 0.05
"""Of the longer side: a shorter focal length without a unit may be in millimetres."""
_TELLING = re.compile(
    r"camera.?matrix|\bfx\b|intrinsic|dist.?coef|distortion|\bmtx\b|!!python", re.IGNORECASE
)


def sniff(content: Content) -> Sniff | None:
    """A camera by its names, or a text that is damaged and speaks of one."""
    if content.data.startswith(NPY):
        return None
    data = content.data if content.text is None else ended(content.data)
    try:
        tree = _tree(data, content.name)
    except ParseError:
        if content.syntax is Syntax.JSON:
            return None
        is_told = content.text is not None and _TELLING.search(content.text)
        return Sniff(Sure.WEAK, "its words are those of a camera") if is_told else None
    try:
        found = cameras_in(tree)
        hand_on(tree, found)
    except ParseError:
        return Sniff(Sure.WEAK, "it states numbers of a camera")
    if not found:
        return None
    listed = ", ".join(
        dict.fromkeys(strict.shown(entry.node.place or "") for entry in found[0].all("matrix", "fx", "f"))
    )
    return Sniff(Sure.WEAK, f"it states a camera by {listed}")


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera of the file, in its order."""
    return cameras(_tree(data, context.name), context, prefix="hand_made/")


def _tree(data: bytes, source: str) -> Node:
    if data.startswith(MAT):
        from calibrary.parsers.formats._mat5 import variables  # noqa: PLC0415  for MATLAB's files alone

        return Node(variables(data, source=source).values, source=source)
    return tree_of(data, source=source)


def cameras(
    tree: Node, context: ReadContext, *, prefix: str, origin: Origin | None = None, why: str | None = None
) -> list[Calibration]:
    """The cameras of a tree.

    Args:
        tree: names and values.
        context: of the reader.
        prefix: of the keys of extras.
        origin: of the principal points, where the container says it; None if it does not.
        why: how it says it; None if that goes without saying.
    """
    parts: list[Part] = handed_on(tree) or cameras_in(tree)
    if not parts:
        _refuse_without_camera(tree)
    extras = _extras(tree, parts, prefix)
    labels = _names(parts)
    found: dict[object, Calibration] = {}
    for part, name in zip(parts, labels, strict=True):
        made = _Camera(part, context, origin, why).calibration(name if len(parts) > 1 else None)
        # A list repeats the camera of its images; cameras with names may have equal numbers.
        is_an_item = name.endswith("]") or name.startswith("document ") or not name
        same = (made.intrinsics, made.distortion, "" if is_an_item else name)
        found.setdefault(same, replace(made, extras=extras))
    if len(found) == 1 < len(parts):
        return [replace(item, camera=replace(item.camera, sub_camera=None)) for item in found.values()]
    return list(found.values())


def lens_in(
    tree: Node, context: ReadContext, *, family: Family | None = None
) -> tuple[tuple[str, ...], Distortion | None]:
    """The lens that a table states beside another program's K: its keys, and the lens.

    Args:
        tree: the table.
        context: of the reader.
        family: of the lens, where the program's own words say it.

    Returns:
        None for the lens where there are no coefficients, or nothing says of which model they are.
    """
    parts = statements_in(tree)
    part = parts[0] if len(parts) == 1 else Part((), "", ())
    try:
        made = _Camera(part, replace(context, options={}), None, None).distortion(family)
    except InputError:
        made = None
    return tuple(dict.fromkeys(entry.top for entry in part.entries if entry.kind in OF_LENS)), made


def _refuse_without_camera(tree: Node) -> None:
    """Say what is missing of a K.

    Raises:
        ParseError: always.
    """
    kinds = {entry.kind for part in statements_in(tree) for entry in part.entries}
    if kinds & {"f", "fx", "fy", "c", "cx", "cy"}:
        found = [kind for kind in ("f", "fx", "fy") if kind in kinds]
        raise ParseError(
            "expected the focal length (fx and fy, or focal_length for square pixels) and the principal point (cx and "
            f"cy), each with its unit, such as fx_px; found {', '.join(found) or 'no focal length'}"
        )
    for key, node in tree.entries():
        if node.value == LONGER and names.MATRIX.fullmatch(simplified(key)):
            node.fail("the array is longer than any camera's, so it is no camera matrix")
    listed = ", ".join(strict.shown(key) for key in tree.keys()[:12])
    tree.fail(f"there is no camera matrix; the keys are {listed or 'none'}")


def _names(parts: Sequence[Part]) -> list[str]:
    """Of each camera its label, or the keys above it."""
    short = [
        part.label or next((key for key in reversed(part.path) if simplified(key) not in by_hand.AROUND), "")
        for part in parts
    ]
    if len(set(short)) == len(short) and all(short):
        return short
    return [
        "/".join(filter(None, (*part.path, part.label if part.label not in part.path else ""))) or str(n)
        for n, part in enumerate(parts, start=1)
    ]


def _extras(tree: Node, parts: Sequence[Part], prefix: str) -> tuple[tuple[str, str], ...]:
    """All other keys of the file, and of its tables that state cameras, as JSON."""
    used = {entry.node.place for part in parts for entry in part.entries}
    limit = None if prefix == "opencv_storage/" else LONGEST_EXTRA
    found: list[tuple[str, str]] = []
    todo = [*tree.entries()]
    while todo:
        key, node = todo.pop(0)
        if node.place in used or not key:
            continue
        if isinstance(node.value, dict) and any((place or "").startswith(f"{node.place}.") for place in used):
            todo = [*node.entries(), *todo]
            continue
        text = json.dumps(node.value, ensure_ascii=False)
        if limit is None or len(text) <= limit:
            found.append((prefix + key, text))
    return tuple(dict(found).items())


class _Camera:
    """One camera: its statements, and what is not stated as the caller says it, or as is usual."""

    def __init__(self, part: Part, context: ReadContext, origin: Origin | None, why: str | None) -> None:
        self.part = part
        self.said: dict[str, list[Entry]] = {}
        for entry in part.entries:
            self.said.setdefault(entry.kind, []).append(entry)
        self.context = context
        self.origin = origin
        self.why = why
        self.notes: list[str] = []
        self.assumptions: list[str] = []
        self.metric = False

    def calibration(self, name: str | None) -> Calibration:
        """The calibration of the camera, whose name it is if there are several."""
        part, context = self.part, self.context
        size = context.size(
            self._size()
            if context.image_size is None or context.size_is_tried or not part.all("shape")
            else None
        )
        K, up = self._intrinsics(size)
        distortion = self.distortion(up=up)
        if isinstance(distortion, Unified):
            near = K.fx / (1 + distortion.xi)
            self.notes.append(
                f"K's fx is the file's; near the axis the camera is a pinhole of {near:.6g} px, fx/(1 + xi)"
            )
        elif K.skew:
            self.notes.append(
                f"skew of {K.skew:g} px was kept; OpenCV's own projectPoints does not look at it"
            )
        stated = self._grade()
        if stated is None and len(part.entries) == 1:
            self.assumptions.append("a bare matrix does not say how it came about; taken as derived")
            stated = Grade.DERIVED
        item = context.calibration(
            K,
            distortion,
            name=name or self._word("sub_camera"),
            tag=", ".join(
                dict.fromkeys(
                    entry.node.place or ""
                    for entry in part.entries
                    if entry.kind in {"matrix", "fx", "f", "coefficients"}
                )
            ),
            grade=stated or Grade.CALIBRATED,
            quality=self._quality(),
            notes=(*self.notes, *self.assumptions),
            assumptions=self.assumptions,
        )
        facts = {word: self._word(word) for word in ("make", "lens", "firmware", "capture_mode")}
        return replace(
            item,
            camera=replace(item.camera, model=self._model(), **facts),
            provenance=replace(item.provenance, **{word: self._word(word) for word in STATED}),
        )

    def _one(self, kind: str) -> Entry | None:
        """The statement of a kind, the nearest one; equal repetitions are one.

        Raises:
            ParseError: two at one depth differ.
        """
        found = self.said.get(kind)
        if not found:
            return None
        depth = max(entry.depth for entry in found)
        nearest = [entry for entry in found if entry.depth == depth]
        for other in nearest[1:]:
            if (other.numbers, other.text) != (nearest[0].numbers, nearest[0].text):
                other.node.fail(
                    f"it means the same as {_place(nearest[0])}, which is stated as well; expected one"
                )
        return nearest[0]

    def _word(self, kind: str) -> str | None:
        entry = self._one(kind)
        return entry.text or None if entry is not None else None

    def _model(self) -> str | None:
        """The camera's own model, where the word is no lens's."""
        words = [entry.text for entry in self.part.all("model", "name") if names.family(entry.text) is None]
        return words[0] if words else None

    # the image size

    def _size(self) -> ImageSize | None:
        """The image size nearest to K; zeros are none."""
        depth = max(entry.depth for entry in self.part.all("matrix", "fx", "f"))
        found: dict[int, list[tuple[tuple[float, ...], Entry]]] = {}
        for entry in self.part.all("size", "shape"):
            width, height = entry.numbers[:2]
            sides = (height, width) if entry.kind == "shape" else (width, height)
            found.setdefault(abs(entry.depth - depth), []).append((sides, entry))
        widths, heights = self.part.all("width"), self.part.all("height")
        for width_of in widths:
            beside = [entry for entry in heights if entry.depth == width_of.depth] or heights
            if not beside:
                raise ParseError(
                    "only one of image width and image height is stated", place=width_of.node.place
                )
            found.setdefault(abs(width_of.depth - depth), []).append(
                ((*width_of.numbers, *beside[0].numbers), width_of)
            )
        if heights and not widths:
            raise ParseError(
                "only one of image width and image height is stated", place=heights[0].node.place
            )
        for _, stated in sorted(found.items()):
            sizes = [self._checked_size(sides, entry) for sides, entry in stated if any(sides)]
            if len(set(sizes)) > 1:
                raise ParseError("it states two image sizes: " + " and ".join(f"{w}×{h}" for w, h in sizes))
            if sizes:
                return sizes[0]
        return None

    def _checked_size(self, sides: tuple[float, ...], entry: Entry) -> ImageSize:
        if entry.unit not in (None, "px"):
            raise ParseError(
                "an image size is in px; for the sensor's, write sensor_width_mm", place=entry.node.place
            )
        width, height = strict.image_size(*sides, source=self.context.name, place=entry.node.place)
        centre = self._stated_centre()
        if centre is None or entry.kind == "width" or width == height:
            return width, height
        if entry.kind == "shape" and simplified((entry.node.place or "").rpartition(".")[2]).endswith(
            "shape"
        ):
            return self._of_shape((width, height), centre, entry)
        as_stated, turned = (
            max(abs(centre[0] / w - 0.5), abs(centre[1] / h - 0.5))
            for w, h in ((width, height), (height, width))
        )
        if turned < NEAR and as_stated > FAR:
            order = "rows and columns, as numpy has them" if entry.kind == "size" else "width and height"
            self.notes.append(
                f"{entry.node.place} is {order}: the principal point is in the middle of {height}×{width}"
            )
            return height, width
        return width, height

    def _of_shape(self, size: ImageSize, centre: tuple[float, float], entry: Entry) -> ImageSize:
        """Columns and rows, or the other way round where K says so.

        Raises:
            MissingSizeError: the principal point does not tell which is the width.
        """
        near = [
            sum(abs(c - side / 2) for c, side in zip(centre, sides, strict=True))
            for sides in (size, size[::-1])
        ]
        if near[0] * 2 < near[1]:
            return size
        if near[1] * 2 < near[0]:
            return size[1], size[0]
        raise MissingSizeError(
            "rows and columns, or width and height: K does not tell which; give --image-size WxH",
            source=self.context.name,
            place=entry.node.place,
        )

    def _stated_centre(self) -> tuple[float, float] | None:
        """The principal point in px as the file states it."""
        matrices = self.part.all("matrix")
        if matrices:
            K = _matrix(matrices[0])
            return K.cx, K.cy
        both = self.part.all("c") or [*self.part.all("cx")[:1], *self.part.all("cy")[:1]]
        numbers = [number for entry in both for number in entry.numbers if entry.unit in (None, "px")]
        return (numbers[0], numbers[1]) if len(numbers) == 2 else None

    # K

    def _intrinsics(self, size: ImageSize) -> tuple[Intrinsics, bool]:
        """K, and whether y points up."""
        entry = self._one("matrix")
        lengths = {
            kind: one
            for kind in ("f", "fx", "fy", "c", "cx", "cy", "skew")
            if (one := self._one(kind)) is not None
        }
        if entry is not None:
            native = _matrix(entry)
            self._refuse_other(native, lengths, entry)
        else:
            native = self._by_name(lengths, size)
        origin, y_axis = self._asked("origin", ORIGIN), self._asked("y_axis", Y_AXIS)
        taken = (
            ORIGINS[origin]
            if origin
            else self.origin or (Origin.CORNER if self.metric else CONVENTION.origin)
        )
        if origin == "image-centre" and native.cy and y_axis is None:
            raise ParseError(
                "it is counted from the middle; state y_axis = up or down, or give --set y_axis=up",
                place="cy",
            )
        is_known = not self.context.size_is_tried and native.fx >= SHORTEST * max(size)
        if origin is None and is_known and min(native.cx / size[0], native.cy / size[1]) < CORNER:
            raise ParseError(
                "counted from the top-left corner, it is far off the middle; state principal_point_origin = "
                f"{' or '.join(ORIGINS)}, or give --set origin=image-centre",
                place="principal point",
            )
        if origin is not None:
            said = self.context.option(ORIGIN.name) is not None
            self.assumptions += [f"cx and cy count from {taken.value}, as the caller says"] if said else []
        elif self.origin is None:
            flag = "--pixel-origin" if not self.metric else "--set origin=…"
            self.assumptions.append(
                f"the file does not say where cx and cy count from; {taken.value} was taken, unless {flag} says "
                "otherwise"
            )
        elif self.why:
            self.assumptions.append(self.why)
        convention = replace(CONVENTION, origin=taken, y_axis=YAxis.UP if y_axis == "up" else YAxis.DOWN)
        place = (entry or next(iter(lengths.values()))).node
        try:
            return convention.intrinsics(native, size, source=self.context.name), y_axis == "up"
        except ParseError as error:
            place.fail(error.message)

    def _refuse_other(self, native: Native, lengths: dict[str, Entry], matrix: Entry) -> None:
        """Refuse single numbers beside a matrix that are not its own."""
        for kind in ("fx", "fy", "cx", "cy"):
            one = lengths.get(kind)
            if (
                one is not None
                and one.unit in (None, "px")
                and abs(one.numbers[0] - getattr(native, kind)) > 1e-3 * abs(one.numbers[0])
            ):
                one.node.fail(
                    f"it is {one.numbers[0]:g}, and {getattr(native, kind):g} in {_place(matrix)}; expected one"
                )

    def _by_name(self, lengths: dict[str, Entry], size: ImageSize) -> Native:
        """K of single numbers or of pairs, in px."""
        focal, centre = lengths.get("f"), lengths.get("c")
        values: dict[str, tuple[float, Entry]] = {}
        if "fx" in lengths and "fy" in lengths:
            values |= {kind: (lengths[kind].numbers[0], lengths[kind]) for kind in ("fx", "fy")}
        elif focal is not None and "fx" not in lengths and "fy" not in lengths:
            values |= {"fx": (focal.numbers[0], focal), "fy": (focal.numbers[-1], focal)}
        else:
            given = [kind for kind in ("f", "fx", "fy") if kind in lengths]
            raise ParseError(
                "expected the focal length (fx and fy, or focal_length for square pixels) and the principal point (cx "
                f"and cy), each with its unit, such as fx_px; found {', '.join(given)}"
            )
        if "cx" in lengths and "cy" in lengths:
            values |= {kind: (lengths[kind].numbers[0], lengths[kind]) for kind in ("cx", "cy")}
        elif centre is not None:
            values |= {"cx": (centre.numbers[0], centre), "cy": (centre.numbers[1], centre)}
        if "skew" in lengths:
            values["skew"] = (lengths["skew"].numbers[0], lengths["skew"])
        unit = self._unit(values, size)
        px = {kind: self._pixels(value, entry, unit, size) for kind, (value, entry) in values.items()}
        return Native(**px)

    def _unit(self, values: dict[str, tuple[float, Entry]], size: ImageSize) -> str:
        """The unit of the lengths that state none."""
        bare = [entry for _, entry in values.values() if entry.unit is None]
        self.metric = any(
            (entry.unit or "px") != "px" for kind, (_, entry) in values.items() if kind in {"fx", "fy"}
        )
        asked = self.context.option(UNIT.name)
        if asked is not None:
            self.metric = self.metric or bool(bare and asked == "mm")
            return asked
        shortest = min(values[kind][0] for kind in ("fx", "fy"))
        is_metric = self.metric or self._one("pitch") is not None or self._one("sensor") is not None
        if bare and (is_metric or shortest < SHORTEST * max(size)):
            key = bare[0].node.place or "fx"
            raise ParseError(f"it has no unit; write {key}_px or {key}_mm, or give --set unit=px", place=key)
        return "px"

    def _pixels(self, value: float, entry: Entry, unit: str, size: ImageSize) -> float:
        """A length in px, through the pitch of the pixels if it is metric."""
        unit = entry.unit or unit
        if unit == "px":
            return value
        if unit not in MM:
            raise ParseError(
                f"its unit {strict.shown(unit)} is not known, expected px or mm", place=entry.node.place
            )
        pitch, sensor = self._one("pitch"), self._one("sensor")
        pitches = list(_mm(pitch)) if pitch is not None else []
        if sensor is not None:
            pitches += [side / count for side, count in zip(_mm(sensor), size, strict=False)]
        if not pitches:
            raise ParseError(
                "millimetres need the pixel pitch; add pixel_pitch_um or sensor_width_mm",
                place=entry.node.place,
            )
        if max(pitches) > min(pitches) * (1 + ASPECT_TOLERANCE):
            listed = " and ".join(f"{pitch * 1e3:.4g} µm" for pitch in pitches)
            raise ParseError(
                f"pixel pitch and sensor size contradict each other: {listed}, for square pixels"
            )
        return value * MM[unit] / pitches[0]

    def _asked(self, kind: str, option: Option) -> str | None:
        """The caller's answer, else the file's own word, which must be one of the option's."""
        stated = self._word(kind)
        if self.context.option(option.name) is not None or stated is None:
            return self.context.option(option.name)
        word = "-".join(stated.lower().replace("center", "centre").replace("_", " ").split())
        if word not in option.values:
            raise ParseError(
                f"{strict.shown(stated)} is not known, expected {' or '.join(option.values)}", place=kind
            )
        return word

    # the lens

    def distortion(self, family: Family | None = None, *, up: bool = False) -> Distortion | None:
        """The lens, of a family if another program's words say it; None if the file states nothing about it."""
        family = self._family() or family
        vectors = list(self._vectors(family))
        xi = self._one("xi")
        if xi is not None and len(xi.numbers) != 1:
            xi.node.fail(
                f"xi is {', '.join(f'{value:g}' for value in xi.numbers)}, expected one number above −1"
            )
        if xi is not None and xi.numbers[0] and not vectors:
            xi.node.fail("there are no distortion coefficients beside this xi, expected four")
        if not vectors:
            self._refuse_without_coefficients(family)
            return NoDistortion() if family is Family.NONE else None
        unequal = [entry for values, entry in vectors[1:] if _trimmed(values) != _trimmed(vectors[0][0])]
        if unequal:
            first = _place(vectors[0][1])
            unequal[0].node.fail(
                f"it means the same as {first}, which is stated as well, with other numbers; expected one"
            )
        values, entry = vectors[0]
        if family is Family.NONE and any(values):
            entry.node.fail("there are coefficients of a lens that has none")
        made = self._lens(values, family, entry)
        if up and isinstance(
            made, BrownConrady | Rational
        ):  # a flipped y changes the sign of p1 and nothing else
            made = replace(made, p1=-made.p1) if made.p1 else made
        return made

    def _refuse_without_coefficients(self, family: Family | None) -> None:
        """Refuse a distortion that is named, and has no coefficients.

        Raises:
            ParseError: there is one.
        """
        named = self.part.all("distortion model")
        if named and family is not Family.NONE:
            named[0].node.fail(f"no coefficient of {named[0].text} is stated; add them, 0 if measured as 0")

    def _family(self) -> Family | None:
        """The family of lenses that the caller or the file names.

        Raises:
            UnsupportedModelError: the file names another one.
        """
        asked = self.context.option(DISTORTION.name)
        if asked is not None:
            return Family.OPENCV if asked == "brown" else Family.FISHEYE
        mark = self._one("fisheye")
        if mark is not None and (mark.numbers or mark.text):
            return Family.FISHEYE if any(mark.numbers) or mark.text == "True" else Family.OPENCV
        for kind in ("distortion model", "model"):
            entries = sorted(self.part.all(kind), key=lambda entry: -entry.depth)
            known = [found for entry in entries if (found := names.family(entry.text)) is not None]
            if Family.OTHER in known:
                _refuse_model(entries[known.index(Family.OTHER)], self.context.name)
            if known:
                return Family.FISHEYE if Family.FISHEYE in known else known[0]
            if entries and kind == "distortion model":
                _refuse_model(entries[0], self.context.name)
        above = {names.family(key.rstrip("_0123456789")) for key in self.part.path}
        return Family.FISHEYE if Family.FISHEYE in above else None

    def _vectors(self, family: Family | None) -> Iterator[tuple[tuple[float, ...], Entry]]:
        """Every statement of the coefficients, in OpenCV's order."""
        for entry in self.part.all("coefficients"):
            yield _ordered(entry), entry
        for entry in self.part.all("matrix"):
            if len(entry.numbers) in {8, 9} and by_hand.is_pinhole(entry.numbers):
                yield entry.numbers[4:], entry
        radial, tangential = self._one("radial"), self._one("tangential")
        if radial is not None:
            yield _in_order(radial.numbers, () if tangential is None else tangential.numbers, radial), radial
        terms = {term: one for term in TERMS if (one := self._one(term)) is not None}
        if terms.keys() & {"k1", "p1"}:
            first = next(iter(terms.values()))
            for entry in terms.values():
                if entry.unit is not None:
                    raise UnsupportedModelError(
                        f"a coefficient in {strict.shown(entry.unit)} acts on lengths on the sensor, and its direction "
                        "is not stated; ask for the calibration as Agisoft XML or OpenCV YAML",
                        place=entry.node.place,
                    )
            numbers = {term: entry.numbers[0] for term, entry in terms.items()}
            yield self._by_terms(numbers, family, first), first

    def _by_terms(self, numbers: dict[str, float], family: Family | None, first: Entry) -> tuple[float, ...]:
        """Coefficients that are stated one by one, in OpenCV's order.

        Raises:
            ParseError: they fit several models.
        """
        missing = next(
            (f"k{n}" for n in range(1, 6) if f"k{n}" not in numbers and f"k{n + 1}" in numbers), None
        )
        if missing is not None:
            first.node.fail(f"{missing} is not stated beside the terms after it; add it, 0 if it is 0")
        if not {"s1", "s2", "s3", "s4"} <= numbers.keys():
            numbers = {term: value for term, value in numbers.items() if term[0] not in "st"}
        is_radial = not numbers.keys() & {"p1", "p2"}
        if is_radial and "k4" in numbers and "k5" not in numbers and family is None:
            if any(numbers.values()):
                first.node.fail(
                    "k1 to k4 without p1 and p2 are a fisheye's, or those of a rational lens; say so with --set "
                    "distortion=fisheye or distortion=brown"
                )
            return (0.0,) * 5
        if family is Family.FISHEYE:
            extra = [
                term for term, value in numbers.items() if value and term not in {"k1", "k2", "k3", "k4"}
            ]
            if extra:
                raise UnsupportedModelError(
                    f"the fisheye model has no {', '.join(extra)}", place=first.node.place
                )
            return tuple(numbers.get(f"k{n}", 0.0) for n in range(1, 5))
        if self.metric and family is None and any(numbers.values()):
            first.node.fail(
                "with lengths in mm, k1 may be per mm²; state distortion_model = brown, or give --set distortion=brown"
            )
        values = tuple(numbers.get(term, 0.0) for term in TERMS)
        return values if any(values[5:]) else values[:5]

    def _lens(self, values: tuple[float, ...], family: Family | None, entry: Entry) -> Distortion:
        """The lens of coefficients in OpenCV's order."""
        xi = self._one("xi")
        if xi is not None and xi.numbers[0]:
            return _mirror(xi, values, entry)
        if family is Family.OMNI and xi is None:
            _refuse_model(self.part.all("distortion model", "model")[0], self.context.name)
        if family is Family.FISHEYE:
            if len(_trimmed(values)) > 4 or len(values) < 4:
                entry.node.fail(f"{len(values)} coefficients of a fisheye, expected 4")
            return KannalaBrandt(**dict(zip(KannalaBrandt.names(), values, strict=False)))
        word = next(
            (
                one.text
                for one in self.part.all("distortion model", "model")
                if simplified(one.text) in names.OWN["BrownConrady"]
            ),
            None,
        )
        if word is not None and len(_trimmed(values)) > 5:
            raise UnsupportedModelError(
                f"the {word} model has no k4", source=self.context.name, place=entry.node.place
            )
        if len(values) not in COUNTS:
            entry.node.fail(
                f"{len(values)} distortion coefficients, expected {', '.join(map(str, COUNTS[1:]))}"
            )
        if (
            len(values) == 4
            and any(values)
            and family is None
            and entry.kind in {"coefficients", "matrix"}
            and not self._are_own(entry)
        ):
            entry.node.fail(
                "four coefficients are Brown's k1 k2 p1 p2 or a fisheye's k1 k2 k3 k4, and the file does "
                "not state which; say so with --set distortion=brown or distortion=fisheye"
            )
        return smallest_lens(values) if len(values) > 5 else lens(values)

    def _are_own(self, entry: Entry) -> bool:
        """Whether a matrix and its coefficients have the keys of OpenCV's own samples, or name their order."""
        if entry.text:
            return True
        matrix = self._one("matrix")
        if matrix is None:
            return False
        found = [
            match[2]
            for pattern, one in ((names.MATRIX, matrix), (names.VECTOR, entry))
            if (match := pattern.fullmatch(simplified((one.node.place or "").rpartition(".")[2])))
        ]
        return tuple(found) in OWN_KEYS

    # what else is known

    def _grade(self) -> Grade | None:
        word = self._word("grade")
        if word is None:
            return None
        if word.lower() not in list(Grade):
            raise ParseError(
                f"{strict.shown(word)} is not a grade, expected one of {', '.join(Grade)}",
                place=self.part.all("grade")[0].node.place,
            )
        return Grade(word.lower())

    def _quality(self) -> Quality | None:
        """The measures that need no interpretation."""
        rms = next((entry for entry in self.part.all("rms") if entry.unit in (None, "px")), None)
        counts = {
            kind: entry.numbers[0]
            for kind in ("points", "views")
            if (entry := self._one(kind)) is not None and entry.numbers
        }
        for value in (*(rms.numbers if rms is not None else ()), *counts.values()):
            if value < 0:
                raise ParseError(f"{value:g} is less than nothing, expected a number from 0", place="rms")
        if rms is None and not counts:
            return None
        whole = {kind: int(value) for kind, value in counts.items()}
        return Quality(
            rms_px=rms.numbers[0] if rms is not None else None,
            points=whole.get("points"),
            views=whole.get("views"),
        )


def _refuse_model(entry: Entry, source: str) -> NoReturn:
    raise UnsupportedModelError(
        f"the distortion's model is {strict.shown(entry.text)}, which is not known here; expected that of OpenCV "
        "(plumb_bob, radtan) or of cv2.fisheye (fisheye, equidistant)",
        source=source,
        place=entry.node.place,
    )


def _place(entry: Entry) -> str:
    return strict.shown(entry.node.place or "")


def _matrix(entry: Entry) -> Native:
    """The numbers of a K: nine, those of a 4×4 or 3×4 matrix, or fx fy cx cy in a list."""
    numbers, node = entry.numbers, entry.node
    if len(numbers) in {4, 8} or (len(numbers) == 9 and by_hand.is_pinhole(numbers)):
        if not by_hand.is_pinhole(numbers):
            node.fail("expected fx fy cx cy in px, and the coefficients after them")
        fx, fy, cx, cy = numbers[:4]
        return Native(fx=fx, fy=fy, cx=cx, cy=cy)
    width = {9: 3, 12: 4, 16: 4}.get(len(numbers), 0)
    if not width:
        node.fail(f"{len(numbers)} numbers of a camera matrix, expected 9")
    rows = [numbers[at : at + width][:3] for at in range(0, len(numbers), width)][:3]
    rest = [number for at in range(0, len(numbers), width) for number in numbers[at + 3 : at + width]]
    if any(rest[:3]):
        node.fail("this is not a camera matrix: expected zeros in its fourth column")
    if len(numbers) == 9 and (shape := _shape(node)) not in (None, (3, 3), (1, 9), (9, 1)):
        node.fail(f"the matrix is {shape[0]}×{shape[1]}, expected 3×3")
    return Native.of_matrix(rows, place=node.place, source=node.source)


def _shape(node: Node) -> tuple[int, int] | None:
    """Rows and columns that a matrix states."""
    value = node.value
    if not isinstance(value, dict) or not {"rows", "cols"} <= value.keys():
        return None
    return node["rows"].whole(), node["cols"].whole()


def _mm(entry: Entry) -> tuple[float, ...]:
    """The positive lengths in mm of an entry that must state its unit."""
    if entry.unit not in MM or not min(entry.numbers) > 0:
        raise ParseError("expected a positive length with its unit, mm or µm", place=entry.node.place)
    return tuple(number * MM[entry.unit] for number in entry.numbers)


def _ordered(entry: Entry) -> tuple[float, ...]:
    """Coefficients in OpenCV's order, from that which their key names."""
    order = entry.text.split()
    if len(order) != len(entry.numbers) or len(set(order)) < len(order):
        return entry.numbers
    by_term = dict(zip(order, entry.numbers, strict=True))
    known = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    if not set(order) & {"p1", "p2"} and set(order) == {"k1", "k2", "k3", "k4"}:
        return tuple(by_term[f"k{n}"] for n in range(1, 5))
    values = tuple(by_term.get(term, 0.0) for term in known)
    return values if any(values[5:]) else values[:5]


def _in_order(radial: Sequence[float], tangential: Sequence[float], entry: Entry) -> tuple[float, ...]:
    if len(radial) == 4:
        if any(tangential):
            entry.node.fail("4 radial coefficients, expected 1, 2, 3 or 6 beside tangential ones")
        return tuple(radial)
    k = [*radial, *[0.0] * 3]
    p1, p2 = tangential or (0.0, 0.0)
    return (k[0], k[1], p1, p2, *(k[2:6] if len(radial) == 6 else k[2:3]))


def _trimmed(values: Sequence[float]) -> tuple[float, ...]:
    """Coefficients without the zeros at their end."""
    used = max((index for index, value in enumerate(values, start=1) if value), default=0)
    return tuple(values[:used])


def _mirror(xi: Entry, values: tuple[float, ...], entry: Entry) -> Unified:
    """cv2.omnidir's camera: a mirror, or a lens like one, of eccentricity xi."""
    if xi.numbers[0] <= -1:
        xi.node.fail(f"xi is {xi.numbers[0]:g}, expected one number above −1")
    if len(values) != 4:
        entry.node.fail(
            f"{len(values)} distortion coefficients beside xi, expected cv2.omnidir's four, k1 k2 p1 p2"
        )
    return Unified(xi=xi.numbers[0], **dict(zip(("k1", "k2", "p1", "p2"), values, strict=True)))


FORMAT = Format(
    name="hand_made",
    title="camera written by hand (text, JSON, YAML, TOML, INI, CSV, XML, npz, mat, printed)",
    suffixes=(".txt", ".json", ".yaml", ".yml", ".toml", ".ini", ".csv", ".xml", ".npz", ".mat"),
    reference="https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    states=STATED,
    options=(UNIT, ORIGIN, Y_AXIS, DISTORTION),
)
