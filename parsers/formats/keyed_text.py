"""Keyed calibration sheets: what manufacturers and laboratories send as a text of keys and values.

In the format's own words::

    # any comment
    [camera]
    model = X-20
    image size: 5472 x 3648
    pixel pitch [µm] = 2.41
    [lens]
    focal_length_mm = 8.7969
    principal_point_x_mm = 6.6065          # from the top-left corner, y down
    principal_point_y_mm = 4.3763
    distortion_model = brown               # OpenCV's k1 k2 p1 p2 k3 on x/z, y/z
    k1 = -0.1131

There is no standard behind it, only names and units that leave one meaning; ``_keyed_terms`` lists them all. A
length without a unit, a sheet in millimetres without a pixel pitch or sensor size, a principal point off the
middle whose y axis nobody states, coefficients that may be per mm²: each is refused, and the message names what
is missing. Sections only part a sheet, unless several hold a focal length: then each is a camera.

Source: none but the sheets; photogrammetric usage and OpenCV's documentation for the names.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Quality
from calibrary.conventions import Origin
from calibrary.distortion import (
    BrownConrady,
    KannalaBrandt,
    MetashapeFrame,
    NoDistortion,
    Rational,
    ThinPrism,
    Tilted,
)
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content
from calibrary.parsers.convention import Convention, Native, YAxis
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats import _keyed_lens as lens
from calibrary.parsers.formats._keyed_options import OPTIONS, ORIGIN, ORIGINS, Y_AXIS
from calibrary.parsers.formats._keyed_scale import Scale
from calibrary.parsers.formats._keyed_sheet import Sheet, as_line, is_apart, matched, sheets
from calibrary.parsers.formats._keyed_terms import looks_like_a_lens_term, term
from calibrary.records import replace

__all__ = ["FORMAT"]

CONVENTION = Convention(
    origin=Origin.CORNER,
    remarks=(
        "pixels or millimetres, as each key says",
        "principal_point_offset_x and _y count from the middle of the image",
        "a file that says principal_point_origin or y_axis is taken at its word",
    ),
)
PREFIX = "keyed_text/"
NAMES = ("make", "camera", "lens", "sub_camera", "firmware", "capture_mode")
STEREOLABS = ("[LEFT_CAM_", "[RIGHT_CAM_")
"""Sections of a ZED camera's file, which has keys of its own."""
FARTHEST = 0.25
"""A principal point farther off the middle than this share of a side was counted from elsewhere."""
UNPROVEN = "the sheet does not say how its numbers came about; taken as calibrated"


def sniff(content: Content) -> Sniff | None:
    """Keys and values to the end, among them a focal length; with its unit, few others can mean it."""
    if content.xml_tags or content.json is not None or content.first_line.startswith(("%YAML", "---")):
        return None
    if any(row.startswith(STEREOLABS) for row in content.lines):
        return None
    claim = None
    for row in content.lines:
        found = matched(row)
        if found is None:
            if is_apart(row):
                continue
            return None
        known = term(found[1])
        if known is None or known[0] not in {"f", "fx"}:
            continue
        if known[2] or found[2].rstrip()[-1:].isalpha():
            claim = Sniff(Sure.SHAPE, f"keys and values, with {strict.shown(found[1])}")
        else:
            claim = claim or Sniff(Sure.WEAK, f"keys and values, with {strict.shown(found[1])}")
    return claim


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera of the file, in order."""
    return [_camera(sheet, context) for sheet in sheets(data, source=context.name)]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """Pixels from the corner; K stands last, so that a sheet cut short lacks it."""
    rows = ["# Camera calibration: one key to a line, its unit in its name."]
    if len(calibrations) == 1:
        rows += _rows(calibrations[0])
    else:
        rows.append(f"cameras = {len(calibrations)}")
        for name, calibration in zip(_section_names(calibrations), calibrations, strict=True):
            rows += ["", f"[{name}]", *_rows(calibration)]
    return "".join(f"{row}\n" for row in rows).encode()


def _camera(sheet: Sheet, context: ReadContext) -> Calibration:
    point = _Point.of(sheet, context)
    scale = Scale(sheet, context)
    convention = replace(CONVENTION, origin=point.origin, y_axis=point.y_axis)
    fx, fy = scale.focals()
    native = Native(
        fx=fx,
        fy=fy,
        cx=scale.length(point.names[0], across=True),
        cy=scale.length(point.names[1], across=False),
        skew=scale.length("skew", across=True) if "skew" in sheet.values else 0.0,
    )
    K = convention.intrinsics(native, scale.size, source=context.name)
    point.check(K, native, context.name)
    distortion, assumed = lens.read(
        sheet,
        convention,
        metric=scale.is_metric,
        asked=context.option(lens.DISTORTION.name),
        source=context.name,
    )
    _refuse_unread_terms(sheet, context.name)
    grade = _grade(sheet, context.name)
    assumptions = (*scale.assumptions, *point.assumptions, *assumed, *(() if grade else (UNPROVEN,)))
    return Calibration(
        camera=_key(sheet, K),
        intrinsics=K,
        distortion=distortion,
        grade=grade or Grade.CALIBRATED,
        quality=_quality(sheet),
        provenance=context.provenance(tag=sheet.section, assumptions=assumptions),
        extras=tuple((PREFIX + key, text) for key, text in sheet.rest),
    )


@dataclass(frozen=True, slots=True)
class _Point:
    """How the principal point is given: under which two names, from where, and which way y grows."""

    names: tuple[str, str]
    origin: Origin
    y_axis: YAxis
    stated: bool
    y_stated: bool

    @classmethod
    def of(cls, sheet: Sheet, context: ReadContext) -> _Point:
        absolute = [name for name in ("cx", "cy") if name in sheet.values]
        offset = [name for name in ("offset_x", "offset_y") if name in sheet.values]
        if absolute and offset:
            raise ParseError(
                f"{sheet.values[absolute[0]].key} and {sheet.values[offset[0]].key} say the principal point twice",
                source=context.name,
            )
        names = ("offset_x", "offset_y") if offset else ("cx", "cy")
        if len(absolute or offset) < 2:
            wanted = (
                "principal_point_offset_x and _y" if offset else "principal_point_x and principal_point_y"
            )
            raise ParseError(
                f"there is no whole principal point; add {wanted} with their unit, such as _px or _mm",
                source=context.name,
            )
        said = _word(sheet, "origin", ORIGIN.name, context)
        up = _word(sheet, "y_axis", Y_AXIS.name, context)
        origin = Origin.IMAGE_CENTRE if offset else ORIGINS.get(said or "corner", Origin.CORNER)
        return cls(names, origin, YAxis.UP if up == "up" else YAxis.DOWN, bool(said or offset), bool(up))

    @property
    def assumptions(self) -> tuple[str, ...]:
        if self.stated:
            return ()
        return ("the principal point counts from the outer corner of the top-left pixel, y down",)

    def check(self, K: Intrinsics, native: Native, source: str) -> None:
        """Refuse what may have been meant otherwise, and would be wrong by much."""
        if self.origin is Origin.IMAGE_CENTRE and native.cy and not self.y_stated:
            raise ParseError(
                "the principal point is counted from the middle, and y up or down is two different cameras; add "
                "y_axis = up or y_axis = down, or give options={'y_axis': 'up'} (--set y_axis=up)",
                source=source,
                place="y_axis",
            )
        drift = max(abs(c / side - 0.5) for c, side in zip((K.cx, K.cy), K.image_size, strict=True))
        if not self.stated and drift > FARTHEST:
            raise ParseError(
                f"counted from the top-left corner, the principal point lies {drift:.0%} of a side off the "
                "middle; say what it is counted from with principal_point_origin = corner, pixel-centre or "
                "image-centre, or options={'origin': 'image-centre'} (--set origin=image-centre)",
                source=source,
                place="principal point",
            )


def _word(sheet: Sheet, name: str, option: str, context: ReadContext) -> str | None:
    """What the caller says, else the file's own word, one of the option's."""
    asked = context.option(option)
    found = sheet.values.get(name)
    if asked is not None or found is None:
        return asked
    word = "-".join(found.text.lower().replace("center", "centre").replace("_", " ").split())
    [known] = [item for item in OPTIONS if item.name == option]
    if word not in known.values:
        raise ParseError(
            f"{strict.shown(found.text)} is not known, wanted {' or '.join(known.values)}",
            source=context.name,
            place=found.key,
        )
    return word


def _refuse_unread_terms(sheet: Sheet, source: str) -> None:
    """An unknown key that is named as lens terms are, with a number that is not zero, would be lost."""
    for key, text in sheet.rest:
        if looks_like_a_lens_term(key.rpartition(".")[2]) and any(digit in text for digit in "123456789"):
            raise lens.unknown_term(key, source)


def _key(sheet: Sheet, K: Intrinsics) -> CameraKey:
    make, model, lens_name, sub_camera, firmware, mode = (
        sheet.values[name].text if name in sheet.values else None for name in NAMES
    )
    if "model" not in sheet.values and lens.model_named(model) is not None:
        model = None
    return CameraKey(
        make=make,
        model=model,
        sub_camera=sub_camera or sheet.section,
        lens=lens_name,
        firmware=firmware,
        capture_mode=mode,
        image_size=K.image_size,
    )


def _grade(sheet: Sheet, source: str) -> Grade | None:
    found = sheet.values.get("grade")
    if found is None:
        return None
    if found.text.lower() not in list(Grade):
        raise ParseError(
            f"{strict.shown(found.text)} is no grade, wanted one of {', '.join(Grade)}",
            source=source,
            place=found.key,
        )
    return Grade(found.text.lower())


def _quality(sheet: Sheet) -> Quality | None:
    """Of the sheet's own measures those that need no interpretation."""
    rms = sheet.values.get("rms")
    rms_px = rms.numbers[0] if rms is not None and rms.unit == "px" and rms.numbers[0] >= 0 else None
    counts = {
        name: int(sheet.values[name].numbers[0])
        for name in ("points", "views")
        if name in sheet.values and sheet.values[name].numbers[0] >= 0
    }
    if rms_px is None and not counts:
        return None
    return Quality(rms_px=rms_px, points=counts.get("points"), views=counts.get("views"))


def _rows(calibration: Calibration) -> Iterator[str]:
    camera, quality, K = calibration.camera, calibration.quality or Quality(), calibration.intrinsics
    native = CONVENTION.native(K)
    known: list[tuple[str, object]] = [
        ("make", camera.make),
        ("model", camera.model),
        ("sub_camera", camera.sub_camera),
        ("lens", camera.lens),
        ("firmware", camera.firmware),
        ("capture_mode", camera.capture_mode),
        ("grade", calibration.grade.value),
        ("rms_px", quality.rms_px),
        ("points", quality.points),
        ("views", quality.views),
    ]
    known += [(key.removeprefix(PREFIX), text) for key, text in calibration.extras if _is_ours(key)]
    known += lens.rows(calibration.distortion)
    known += [
        ("principal_point_origin", "corner"),
        ("y_axis", "down"),
        ("image_width_px", K.image_size[0]),
        ("image_height_px", K.image_size[1]),
        ("skew_px", native.skew or None),
        ("fx_px", native.fx),
        ("fy_px", native.fy),
        ("cx_px", native.cx),
        ("cy_px", native.cy),
    ]
    lines = (as_line(key, str(value)) for key, value in known if value is not None)
    yield from (line for line in lines if line is not None)


def _is_ours(key: str) -> bool:
    """Whether an extra came from a sheet and is still no known key."""
    return key.startswith(PREFIX) and term(key.removeprefix(PREFIX)) is None


def _section_names(calibrations: Sequence[Calibration]) -> Iterator[str]:
    taken: set[str] = set()
    for index, calibration in enumerate(calibrations, start=1):
        name = calibration.camera.sub_camera or f"camera {index}"
        name = (
            "".join(c if c.isprintable() and c not in "[]" else " " for c in name).strip()[:60]
            or f"camera {index}"
        )
        while name in taken:
            name = f"{name} {index}"
        taken.add(name)
        yield name


FORMAT = Format(
    name="keyed_text",
    title="Keyed calibration sheet",
    suffixes=(".cal", ".txt"),
    reference="https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(
        models=(NoDistortion, BrownConrady, Rational, ThinPrism, Tilted, KannalaBrandt, MetashapeFrame),
        skew=True,
        several_cameras=True,
    ),
    options=OPTIONS,
)
