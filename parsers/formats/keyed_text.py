"""Key-value calibration sheets: what manufacturers and laboratories send as a text of keys and values.

In the format's own words::

    # any comment
    model = X-20
    calibrated by: A. Laboratory
    date: 2019-05-14
    image size: 5472 x 3648
    pixel pitch [µm] = 2.41
    focal_length_mm = 8.7969
    principal_point_x_mm = 6.6065          # from the top-left corner, y down
    principal_point_y_mm = 4.3763
    distortion_model = brown               # OpenCV's k1 k2 p1 p2 k3 on x/z, y/z
    k1 = -0.1131

There is no standard, only names and units with one meaning; ``SPELLINGS`` lists them. K as a matrix of nine numbers
and the coefficients as a vector are read by their shape (``_by_shape``) and are OpenCV's. A unit is part of the key
or follows the value. Refused, with what is missing: millimetres without pixel pitch or sensor size, a principal
point far off the middle, or counted from it without the direction of y, coefficients that may be per mm², and two
cameras in one sheet. Section headings only divide a sheet.

Source: none but the sheets; photogrammetric usage and OpenCV's documentation for the names.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from msgspec import Struct, field

from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Origin, Quality
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt, NoDistortion, Rational
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.image_size import ASPECT_TOLERANCE
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, YAxis
from calibrary.parsers.document import Node
from calibrary.parsers.format import (
    STATED,
    Capacity,
    Format,
    Option,
    ReadContext,
    Sniff,
    Sure,
    UnknownLens,
    WriteContext,
)
from calibrary.parsers.formats._by_shape import lens_of
from calibrary.parsers.formats._one_camera import native_of
from calibrary.parsers.formats._text_rows import text_of
from calibrary.parsers.names import MATRIX, simplified
from calibrary.records import Json, replace

MAX_BYTES = 256 * 1024
"""Longest file, about a hundred pages."""
LONGEST_ROW = 2000

CAMERA = ("make", "model", "sub_camera", "lens", "firmware", "capture_mode")
COEFFICIENTS = Rational.names()
SPELLINGS = {
    **{name: name for name in (*CAMERA, *STATED, *COEFFICIENTS, "skew", "y_axis", "grade", "points")},
    "f": "f focal_length calibrated_focal_length camera_constant principal_distance",
    "fx": "fx focal_length_x",
    "fy": "fy focal_length_y",
    "cx": "cx principal_point_x ppx",
    "cy": "cy principal_point_y ppy",
    "pitch": "pixel_pitch pixel_size",
    "sensor": "sensor sensor_size sensor_width",
    "size": "size image-size resolution",
    "width": "width image_width columns",
    "height": "height image_height rows",
    "origin": "origin principal_point_origin",
    "distortion": "distortion distortion_model lens_model",
    "make": "make manufacturer",
    "model": "model camera camera_model",
    "date": "date calibration_date calibrated_on",
    "tool": "tool software",
    "operator": "operator calibrated_by laboratory",
    "rms": "rms reprojection_error rms_error",
    "views": "views number_of_views number_of_images",
}
"""Spellings of the known keys by meaning. Case, spaces and punctuation are ignored."""
TERMS = {re.sub("[^a-z0-9]", "", word): name for name, words in SPELLINGS.items() for word in words.split()}
NUMBERS = frozenset(
    {"f", "fx", "fy", "cx", "cy", "skew", "pitch", "width", "height", "rms", "points", "views", *COEFFICIENTS}
)
PAIRS = frozenset({"size", "sensor"})
UNITS = {
    "pixel": "px",
    "pixels": "px",
    "um": "um",
    "µm": "um",
    "μm": "um",
    "micron": "um",
    "px": "px",
    "mm": "mm",
}
MM = {"mm": 1.0, "um": 1e-3}

_ROW = re.compile(r"([^\W\d][^=:]{0,119}?)\s*[=:]\s*(\S.*)")
SEPARATOR = re.compile(r"(?:#|;|//|%).*|\[[^\[\]]{1,80}\]|")
COMMENT = re.compile(r"\s(?:#|;|//|%).*")
_KEY_WITH_UNIT = re.compile(
    r"(.*?)\s*[\[(]([^\[\]()]{1,20})[\])]|(.*[\w)])[\s_-](px|pixels?|mm|um|µm|μm)", re.IGNORECASE
)
_VALUE = re.compile(
    r"([+-]?[\d.,]++(?:e[+-]?\d+)?+|nan|inf)\s*([^\W\d_]{1,20})?"
    r"(?:(?:(?<=\d)|\s)\s*[x×*]\s*([+-]?[\d.,]++)\s*([^\W\d_]{1,20})?)?",
    re.IGNORECASE,
)


class Entry(Struct, frozen=True):
    """One known line: its key as written, its text, its numbers, and their unit if one is stated."""

    key: str
    text: str
    numbers: tuple[float, ...] = ()
    unit: str | None = None


class Sheet(Struct):
    """A parsed sheet: the entries by meaning, and the lines with an unknown key."""

    entries: dict[str, Entry] = field(default_factory=dict)
    rest: list[tuple[str, str]] = field(default_factory=list)

    def __contains__(self, name: str) -> bool:
        return name in self.entries

    def text(self, name: str) -> str | None:
        """The entry as written, None if there is none."""
        return self.entries[name].text if name in self.entries else None

    def mm(self, name: str) -> tuple[float, ...]:
        """The positive lengths in mm of an entry that must state its unit."""
        entry = self.entries[name]
        if entry.unit not in MM or not min(entry.numbers) > 0:
            raise ParseError("expected a positive length with its unit, mm or µm", place=entry.key)
        return tuple(number * MM[entry.unit] for number in entry.numbers)


def _taken_apart(data: bytes) -> Sheet:
    sheet = Sheet()
    text = text_of(data, most=MAX_BYTES)
    for number, raw in enumerate(strict.lines(text), start=1):
        row = raw.strip()
        if SEPARATOR.fullmatch(row):
            continue
        found = _matched(row)
        if found is None:
            raise ParseError(
                f"{strict.shown(row)} is neither key = value nor key: value", place=f"line {number}"
            )
        key, value = found[1], COMMENT.sub("", found[2]).strip()
        name, unit = term(key)
        if name is None:
            sheet.rest.append((key, value))
        elif name in sheet:
            raise ParseError(
                f"it means the same as {strict.shown(sheet.entries[name].key)}; expected one", place=key
            )
        else:
            sheet.entries[name] = _entry(name, Entry(key, value, unit=unit))
    return sheet


def _entry(name: str, entry: Entry) -> Entry:
    """The entry with its numbers, if its key has numbers, and the unit stated by key or value."""
    if name not in NUMBERS | PAIRS:
        return entry
    found = _VALUE.fullmatch(entry.text)
    if found is None or (found[3] is None and name == "size") or (found[3] is not None and name in NUMBERS):
        wanted = "width x height" if name in PAIRS else "a number"
        raise ParseError(f"{strict.shown(entry.text)} is not {wanted}", place=entry.key)
    unit = entry.unit
    for word in (found[2], found[4]):
        stated = UNITS.get(word.lower(), word) if word else unit
        if unit not in (None, stated):
            raise ParseError(f"it is stated in {unit} and in {stated}", place=entry.key)
        unit = stated
    texts = (found[1], found[3])
    numbers = tuple(strict.number(part, place=entry.key) for part in texts if part)
    return replace(entry, numbers=numbers, unit=unit)


def _matched(row: str) -> re.Match[str] | None:
    return _ROW.fullmatch(row) if len(row) <= LONGEST_ROW else None


def term(key: str) -> tuple[str | None, str | None]:
    """The meaning of a key and the unit in it; an unknown unit in brackets is kept and refused where it matters."""
    found = _KEY_WITH_UNIT.fullmatch(key)
    name, unit = (found[1] or found[3], found[2] or found[4]) if found else (key, None)
    return TERMS.get(re.sub("[^a-z0-9]", "", name.lower())), unit and UNITS.get(unit.lower(), unit)


CONVENTION = Convention(
    origin=Origin.CORNER,
    remarks=("pixels or millimetres, as each key states", "principal_point_origin and y_axis are followed"),
)
PREFIX = "keyed_text/"
ORIGINS = {
    "corner": Origin.CORNER,
    "centre": Origin.PIXEL_CENTRE,
    "pixel-centre": Origin.PIXEL_CENTRE,
    "image-centre": Origin.IMAGE_CENTRE,
}
LENSES: dict[str, type[Distortion]] = {
    kind.model: kind for kind in (NoDistortion, BrownConrady, Rational, KannalaBrandt)
}
OTHER_NAMES = {
    "brown-conrady": "brown",
    "opencv": "brown",
    "equidistant": "kannala-brandt",
    "fisheye": "kannala-brandt",
    "plumb-bob": "brown",
    "radtan": "brown",
}
_OF_A_LENS = re.compile(
    r"(?:opencv.)?fish.?eye|equidistant|kannala.?brandt\d?|kb\d|rad.?tan|plumb.?bob|brown(?:.?conrady)?|rational|omni|mei"
    r"|scaramuzza|division|fov|double.?sphere|eucm",
    re.IGNORECASE,
)
FARTHEST = 0.25
"""A principal point farther off the middle than this share of a side was counted from elsewhere."""
SHORTEST_PX = 0.2
"""Shares of the longer side: a shorter focal length without a unit may be in millimetres."""

UNIT = Option(name="unit", values=("px", "mm"), meaning="the unit of lengths that state none")
ORIGIN = Option(
    name="origin",
    values=tuple(ORIGINS),
    meaning="what the principal point is counted from: the outer corner of the top-left pixel, that pixel's "
    "centre, or the middle of the image",
)
Y_AXIS = Option(name="y_axis", values=("down", "up"), meaning="direction of y, in image and distortion")
DISTORTION = Option(
    name="distortion", values=tuple(LENSES), meaning="which model k1, k2 … belong to, on x/z and y/z"
)

_LENS_TERM = re.compile(
    r"(?:[kpsbart]|kc|kr|tau)_?\d+|.{0,60}(?:distort|radial|tangent|decentr|affin).{0,60}"
)


_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_VECTOR = re.compile(rf"[\[({{]*{_NUMBER.pattern}(?:[\s,;\[\]]+{_NUMBER.pattern}){{1,15}}[\])}}]*")


def sniff(content: Content) -> Sniff | None:
    """Keys and values to the end, among them a focal length; with its unit, few other texts can mean it."""
    if content.xml_tags or content.json is not None or content.first_line.startswith(("%YAML", "---")):
        return None
    claim = None
    for row in content.lines:
        found = _matched(row)
        if row.startswith(("[LEFT_CAM_", "[RIGHT_CAM_")) or not (found or SEPARATOR.fullmatch(row)):
            return None  # a ZED camera's sections have their own format
        name, unit = term(found[1]) if found else (None, None)
        if (
            found
            and (name in {"f", "fx"} or _is_matrix(found[1], found[2]))
            and (claim is None or claim.sure is Sure.WEAK)
        ):
            sure = Sure.SHAPE if unit or found[2].rstrip()[-1:].isalpha() else Sure.WEAK
            claim = Sniff(sure, f"keys and values, with {strict.shown(found[1])}")
    return claim


def _is_matrix(key: str, text: str) -> bool:
    return bool(
        MATRIX.fullmatch(simplified(key)) and _VECTOR.fullmatch(text) and len(_NUMBER.findall(text)) == 9
    )


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the sheet."""
    sheet = _by_shape(_taken_apart(data), context)
    focals = _focals(sheet)
    size = context.size(_size(sheet))
    K, metric, assumptions = _intrinsics(sheet, focals, size, context)
    up = _word(sheet, "y_axis", Y_AXIS, context) == "up"
    distortion, assumed = _distortion(sheet, metric=metric, up=up, asked=context.option(DISTORTION.name))
    for key, text in sheet.rest:
        if _LENS_TERM.fullmatch(key.strip().lower()) and any(digit in text for digit in "123456789"):
            raise UnsupportedModelError(
                f"it looks like a distortion coefficient and is not one of {', '.join(COEFFICIENTS)}; remove it if it "
                "is something else",
                place=key,
            )
    grade = (sheet.text("grade") or Grade.CALIBRATED).lower()
    if grade not in list(Grade):
        raise ParseError(
            f"{strict.shown(grade)} is not a grade, expected one of {', '.join(Grade)}", place="grade"
        )
    if "grade" not in sheet:
        assumptions += ("the sheet does not state how its numbers came about; taken as calibrated",)
    return [
        Calibration(
            camera=replace(
                CameraKey(image_size=size),
                **{name: sheet.text(name) for name in CAMERA if name != "model" or not _names_a_lens(sheet)},
            ),
            intrinsics=K,
            distortion=distortion,
            grade=Grade(grade),
            quality=_quality(sheet),
            provenance=replace(
                context.provenance(assumptions=(*assumptions, *assumed)),
                **{name: sheet.text(name) for name in STATED},
            ),
            extras=tuple((PREFIX + key, text) for key, text in sheet.rest),
        )
    ]


def _by_shape(sheet: Sheet, context: ReadContext) -> Sheet:
    """The sheet with what it states as a matrix or a vector under the terms of the single numbers."""
    rows = [*sheet.rest, *((entry.key, entry.text) for entry in sheet.entries.values() if not entry.numbers)]
    vectors: dict[str, Json] = {
        key: list[Json](map(float, _NUMBER.findall(text))) for key, text in rows if _VECTOR.fullmatch(text)
    }
    if not vectors:
        return sheet
    kind = _stated_model(sheet, context.option(DISTORTION.name))
    keys, _, lens = lens_of(
        Node(vectors, source=context.name), fisheye=None if kind is None else kind is KannalaBrandt
    )
    entries = dict(sheet.entries)
    if lens is not None and not any(name in sheet for name in COEFFICIENTS):
        entries = {name: entry for name, entry in entries.items() if entry.key not in keys}
        entries |= {name: Entry(keys[0], str(value), (value,)) for name, value in lens.coefficients.items()}
        if "distortion" not in entries:
            entries["distortion"] = Entry(keys[0], lens.model)
    matrix = next((key for key in vectors if MATRIX.fullmatch(simplified(key)) and key not in keys), None)
    if matrix is not None and not any(name in sheet for name in ("f", "fx", "fy", "cx", "cy")):
        native = native_of(Node(vectors, source=context.name)[matrix])
        numbers = {"fx": native.fx, "fy": native.fy, "cx": native.cx, "cy": native.cy, "skew": native.skew}
        entries |= {name: Entry(matrix, str(value), (value,)) for name, value in numbers.items()}
        entries.setdefault("origin", Entry(matrix, "centre"))
        keys = (*keys, matrix)
    return Sheet(entries, [(key, text) for key, text in sheet.rest if key not in keys])


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """Pixels from the corner; K comes last, so that a sheet cut short lacks it."""
    [item] = calibrations
    native, quality, lens = CONVENTION.native(item.intrinsics), item.quality or Quality(), item.distortion
    known: list[tuple[str, object]] = [(name, getattr(item.camera, name)) for name in CAMERA]
    known += [(name, getattr(item.provenance, name)) for name in STATED]
    known += [("grade", item.grade.value), ("rms_px", quality.rms_px)]
    known += [("points", quality.points), ("views", quality.views)]
    known += [(key.removeprefix(PREFIX), text) for key, text in item.extras if key.startswith(PREFIX)]
    known += [] if lens is None else [("distortion_model", lens.model), *lens.coefficients.items()]
    known += [("principal_point_origin", "corner"), ("y_axis", "down")]
    known += zip(("image_width_px", "image_height_px"), item.intrinsics.image_size, strict=True)
    known += [("skew_px", native.skew or None)]
    known += [(f"{name}_px", getattr(native, name)) for name in ("fx", "fy", "cx", "cy")]
    rows = [f"{key} = {value}" for key, value in known if value is not None]
    body = "".join(
        f"{row}\n"
        for row in rows
        if row.isprintable() and row == COMMENT.sub("", row).strip() and "=  " not in row
    )
    return f"# Camera calibration: one key to a line, its unit in its name.\n{body}".encode()


def _size(sheet: Sheet) -> ImageSize | None:
    for name in ("size", "width", "height"):
        if name in sheet and sheet.entries[name].unit not in (None, "px"):
            raise ParseError(
                "an image size is in px; for the sensor's, write sensor_width_mm",
                place=sheet.entries[name].key,
            )
    if ("width" in sheet) != ("height" in sheet):
        raise ParseError("only one of image width and image height is stated")
    stated = [sheet.entries["size"].numbers] if "size" in sheet else []
    if "width" in sheet:
        stated.append((*sheet.entries["width"].numbers, *sheet.entries["height"].numbers))
    sizes = [strict.image_size(*sides, place="image size") for sides in stated]
    if len(set(sizes)) > 1:
        raise ParseError("it states two image sizes: " + " and ".join(f"{w}×{h}" for w, h in sizes))
    return sizes[0] if sizes else None


def _focals(sheet: Sheet) -> list[str]:
    """The terms that state the focal length, one or two."""
    given = [name for name in ("f", "fx", "fy") if name in sheet]
    if given not in (["f"], ["fx", "fy"]) or not {"cx", "cy"} <= sheet.entries.keys():
        raise ParseError(
            "expected the focal length (fx and fy, or focal_length for square pixels) and the principal point (cx and "
            f"cy), each with its unit, such as fx_px; found {', '.join(given) or 'no focal length'}"
        )
    return given


def _intrinsics(
    sheet: Sheet, given: list[str], size: ImageSize, context: ReadContext
) -> tuple[Intrinsics, bool, tuple[str, ...]]:
    """K, whether a focal length is in millimetres, and what had to be assumed."""
    names = (given[0], given[-1], "cx", "cy", *(["skew"] if "skew" in sheet else []))
    bare = [sheet.entries[name].key for name in names if sheet.entries[name].unit is None]
    unit = context.option(UNIT.name)
    assumptions: tuple[str, ...] = ()
    shortest = min(sheet.entries[name].numbers[0] for name in given)
    metric = any(entry.unit in MM for entry in sheet.entries.values())
    if bare and unit is None:
        if metric or shortest < SHORTEST_PX * max(size):
            raise ParseError(
                f"it has no unit; write {bare[0]}_px or {bare[0]}_mm, or give --set unit=px", place=bare[0]
            )
        unit = "px"
        assumptions = (
            f"{', '.join(dict.fromkeys(bare))} without a unit are in pixels, being too long for mm",
        )
    fx, fy, cx, cy, *skew = (_pixels(sheet, sheet.entries[name], unit, size) for name in names)
    origin, y_axis = _word(sheet, "origin", ORIGIN, context), _word(sheet, "y_axis", Y_AXIS, context)
    if origin == "image-centre" and cy and y_axis is None:
        raise ParseError(
            "it is counted from the middle; state y_axis = up or down, or give --set y_axis=up", place="cy"
        )
    convention = replace(
        CONVENTION, origin=ORIGINS[origin or "corner"], y_axis=YAxis.UP if y_axis == "up" else YAxis.DOWN
    )
    native = Native(fx=fx, fy=fy, cx=cx, cy=cy, skew=skew[0] if skew else 0.0)
    K = convention.intrinsics(native, size)
    if origin is None:
        assumptions += ("the principal point counts from the outer corner of the top-left pixel, y down",)
        if max(abs(K.cx / size[0] - 0.5), abs(K.cy / size[1] - 0.5)) > FARTHEST:
            raise ParseError(
                "counted from the top-left corner, it is far off the middle; state principal_point_origin = "
                f"{' or '.join(ORIGINS)}, or give --set origin=image-centre",
                place="principal point",
            )
    return K, any((sheet.entries[name].unit or unit) != "px" for name in given), assumptions


def _pixels(sheet: Sheet, entry: Entry, unit: str | None, size: ImageSize) -> float:
    """A length in px, through the pitch of the pixels if it is metric."""
    unit = entry.unit or unit
    if unit == "px":
        return entry.numbers[0]
    if unit not in MM:
        raise ParseError(
            f"its unit {strict.shown(unit or '')} is not known, expected px or mm", place=entry.key
        )
    pitches = list(sheet.mm("pitch")) if "pitch" in sheet else []
    if "sensor" in sheet:
        pitches += [side / count for side, count in zip(sheet.mm("sensor"), size, strict=False)]
    if not pitches:
        raise ParseError(
            "millimetres need the pixel pitch; add pixel_pitch_um or sensor_width_mm", place=entry.key
        )
    if max(pitches) > min(pitches) * (1 + ASPECT_TOLERANCE):
        listed = " and ".join(f"{pitch * 1e3:.4g} µm" for pitch in pitches)
        raise ParseError(f"pixel pitch and sensor size contradict each other: {listed}, for square pixels")
    return entry.numbers[0] * MM[unit] / pitches[0]


def _word(sheet: Sheet, name: str, option: Option, context: ReadContext) -> str | None:
    """The caller's answer, else the sheet's own word, which must be one of the option's."""
    stated = sheet.text(name)
    if context.option(option.name) is not None or stated is None:
        return context.option(option.name)
    word = "-".join(stated.lower().replace("center", "centre").replace("_", " ").split())
    if word not in option.values:
        raise ParseError(
            f"{strict.shown(stated)} is not known, expected {' or '.join(option.values)}", place=name
        )
    return word


def _distortion(
    sheet: Sheet, *, metric: bool, up: bool, asked: str | None
) -> tuple[Distortion | None, tuple[str, ...]]:
    """The lens and what had to be assumed; None when the sheet states nothing about it."""
    entries = [sheet.entries[name] for name in COEFFICIENTS if name in sheet]
    for entry in entries:
        if entry.unit is not None:
            raise UnsupportedModelError(
                f"a coefficient in {strict.shown(entry.unit)} acts on lengths on the sensor, and its direction is not "
                "stated; ask for the calibration as Agisoft XML or OpenCV YAML",
                place=entry.key,
            )
    given = {name: sheet.entries[name].numbers[0] for name in COEFFICIENTS if name in sheet}
    used = {name: value for name, value in given.items() if value}
    kind = _stated_model(sheet, asked if given else None)
    assumed: tuple[str, ...] = ()
    if kind is None and used:
        _refuse_several_models(list(used), metric=metric)
        kind, assumed = BrownConrady, ("k1, k2, k3, p1, p2 are OpenCV's, on x/z and y/z",)
    if kind is None:
        return (NoDistortion() if given else None), ()
    if not given and kind is not NoDistortion:
        raise ParseError(
            f"no coefficient of {kind.model} is stated; add them, 0 if measured as 0",
            place="distortion_model",
        )
    unknown = [name for name in used if name not in kind.names()]
    if unknown:
        raise UnsupportedModelError(
            f"the {kind.model} model has no {', '.join(unknown)}", place="distortion_model"
        )
    if not used and kind is not KannalaBrandt:  # whose zeros are a lens, the equidistant one
        return NoDistortion(), ()
    if up and "p1" in used:  # a flipped y changes the sign of p1 and nothing else
        used["p1"] = -used["p1"]
    return kind(**(dict.fromkeys(kind.names(), 0.0) | used)), assumed


def _stated_model(sheet: Sheet, asked: str | None) -> type[Distortion] | None:
    """The model that the caller or the sheet names."""
    name = "model" if "distortion" not in sheet and _names_a_lens(sheet) else "distortion"
    stated = asked or sheet.text(name)
    if stated is None or _VECTOR.fullmatch(stated):
        return None
    word = "-".join(stated.lower().replace("_", " ").split())
    model = OTHER_NAMES.get(word, word)
    if model not in LENSES:
        raise UnsupportedModelError(
            f"{strict.shown(stated)} is not known, expected {', '.join(LENSES)}",
            place=sheet.entries[name].key,
        )
    return LENSES[model]


def _names_a_lens(sheet: Sheet) -> bool:
    """Whether what stands where a camera's name does is the kind of its lens, as in ``camera_model: fisheye``."""
    return _OF_A_LENS.fullmatch(sheet.text("model") or "") is not None


def _refuse_several_models(used: list[str], *, metric: bool) -> None:
    """Coefficients that may belong to more than one model need its name."""
    if metric or not set(used) <= set(BrownConrady.names()):
        reason = (
            "with lengths in mm, k1 may be per mm²" if metric else f"{', '.join(used)} fit several models"
        )
        wanted = " or ".join(LENSES)
        raise ParseError(
            f"{reason}; state distortion_model = {wanted}, or give --set distortion=brown", place=used[0]
        )


def _quality(sheet: Sheet) -> Quality | None:
    """Those of the sheet's measures that need no interpretation."""
    found = {name: sheet.entries[name].numbers[0] for name in ("points", "views") if name in sheet}
    counts = {name: int(number) for name, number in found.items() if number >= 0}
    rms = sheet.entries.get("rms")
    rms_px = rms.numbers[0] if rms is not None and rms.unit == "px" and rms.numbers[0] >= 0 else None
    if rms_px is None and not counts:
        return None
    return Quality(rms_px=rms_px, points=counts.get("points"), views=counts.get("views"))


FORMAT = Format(
    name="keyed_text",
    title="Key-value calibration sheet",
    suffixes=(".cal", ".txt"),
    syntaxes=(Syntax.TEXT,),
    reference="https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=tuple(LENSES.values()), skew=True, unknown_lens=UnknownLens.STATED),
    states=STATED,
    options=(UNIT, ORIGIN, Y_AXIS, DISTORTION),
)
