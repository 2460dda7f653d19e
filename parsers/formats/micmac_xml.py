"""MicMac (Apero, Tapas) internal camera calibration, ``AutoCal_Foc-….xml``.

In the format's own words::

    <ExportAPERO>
      <CalibrationInternConique>
        <KnownConv>eConvApero_DistM2C</KnownConv>      M2C, world to camera: undistorted → distorted
        <PP>2736.1 1824.7</PP> <F>3650.1</F> <SzIm>5472 3648</SzIm>
        <CalibDistortion>
          <ModPhgrStd>                                  or <ModRad>, which is its <RadialePart> alone
            <RadialePart>
              <CDist>2741.3 1815.9</CDist>
              <CoeffDist>-8.5e-09</CoeffDist> …         c1, c2, … of R², R⁴, …
            </RadialePart>
            <P1>…</P1> <P2>…</P2> <b1>…</b1> <b2>…</b2>

Everything is in pixels. With (u, v) = P − CDist and R² = u² + v² the point P goes to::

    P.x + u·(c1·R² + c2·R⁴ + …) + P1·(R² + 2u²) + 2·P2·u·v + b1·u + b2·v
    P.y + v·(c1·R² + c2·R⁴ + …) + P2·(R² + 2v²) + 2·P1·u·v

``eConvApero_DistM2C``, which Tapas uses, maps the undistorted point to the distorted one; ``eConvApero_DistC2M`` maps
the distorted one to the undistorted one. CDist, the centre of the distortion, is PP in a few models only. c3 is of the
order of 1e-25 and c5 of 1e-40, so calibrary scales the numbers in decimal and loses no digit of them.

MicMac counts its images from (0, 0), the first pixel. No source states whether that is its centre or its corner.

Sources: MicMac, ``ParamChantierPhotogram.xml`` (the schema); for the direction, its photogrammetric library.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Context, Decimal
from functools import lru_cache
from html import escape
from math import isfinite
from typing import TYPE_CHECKING

from calibrary.calibration import Calibration, Grade, ImageSize
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    InverseBrown,
    NoDistortion,
    OffCentreBrown,
    exact,
    required,
)
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, UnknownLens, WriteContext
from calibrary.parsers.xml import parse_xml

if TYPE_CHECKING:
    from lxml.etree import _Element

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    tangential=Tangential.SWAPPED,
    coefficients=("c1", "c2", "c3", "c4", "c5", "P1", "P2", "b1", "b2"),
    remarks=(
        "coefficients are in powers of pixels about CDist, which need not be the principal point",
        "with eConvApero_DistC2M the polynomial maps the distorted point to the undistorted one",
    ),
)
CAMERA = "CalibrationInternConique"
ROOTS = ("ExportAPERO", CAMERA)
M2C, C2M = "eConvApero_DistM2C", "eConvApero_DistC2M"
MODELS: dict[str, type[OffCentreBrown | InverseBrown]] = {M2C: OffCentreBrown, C2M: InverseBrown}
RADIAL_TERMS = 5
FRAME_CHANGES = ("ScannedAnalogik", "PixelSzIm", "Homographie")
"""They put another coordinate system between the image and the numbers."""
KNOWN = frozenset(("KnownConv", "PP", "F", "SzIm", "CalibDistortion", "OrIntGlob"))
PREFIX = "micmac_xml/"
MAX_BYTES = 1024 * 1024
ORIGIN_NOTE = "MicMac does not say where (0, 0) is; it was read as the centre of the top-left pixel"
_DECIMAL = Context(prec=400, traps=[])
"""Enough for the sum of a principal point and an offset as small as a double can be."""


def sniff(content: Content) -> Sniff | None:
    """The camera's element, with or without the export around it."""
    tags = content.xml_tags
    if tags and tags[0] in ROOTS and CAMERA in tags:
        return Sniff(Sure.MAGIC, f"the XML contains MicMac's <{CAMERA}>")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the file."""
    fields = _Fields(_camera(parse_xml(data, source=context.name, max_bytes=MAX_BYTES)))
    fields.refuse_other_frames()
    convention = fields.text("KnownConv") if "KnownConv" in fields else M2C
    if convention not in MODELS:
        raise UnsupportedModelError(f"KnownConv is {strict.shown(convention)}, expected {M2C} or {C2M}")
    focal, (x, y) = fields.numbers("F", 1)[0], fields.numbers("PP", 2)
    if focal == 0:
        raise ParseError("F is 0: this is a template, to be filled in by Tapas", place="F")
    size = context.size(fields.size())
    native = Native(fx=float(focal), fy=float(focal), cx=float(x), cy=float(y))
    return [
        context.calibration(
            CONVENTION.intrinsics(native, size),
            _distortion(fields, MODELS[convention], focal, (x, y)),
            assumptions=(ORIGIN_NOTE,),
            grade=Grade.ADJUSTED,
            notes=(ORIGIN_NOTE,),
            extras=fields.extras(),
        )
    ]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """What Tapas writes for a Fraser model, or a radial one where that is enough."""
    [calibration] = calibrations
    native = CONVENTION.native(calibration.intrinsics)
    lens = calibration.distortion or NoDistortion()
    convention = C2M if isinstance(lens, InverseBrown) else M2C
    full = required(lens, MODELS[convention])
    width, height = calibration.intrinsics.image_size
    rows = [
        ("KnownConv", convention),
        ("PP", f"{native.cx!r} {native.cy!r}"),
        ("F", repr(native.fx)),
        ("SzIm", f"{width} {height}"),
    ]
    rows += [(key.removeprefix(PREFIX), value) for key, value in calibration.extras if key.startswith(PREFIX)]
    body = "".join(f"    <{name}>{escape(value, quote=False)}</{name}>\n" for name, value in rows)
    body += f"    <CalibDistortion>\n{_model(full, native)}    </CalibDistortion>\n"
    return (
        f'<?xml version="1.0" ?>\n<ExportAPERO>\n  <{CAMERA}>\n{body}  </{CAMERA}>\n</ExportAPERO>\n'
    ).encode()


def _camera(root: _Element) -> _Element:
    """The element of the one camera."""
    found = [root] if root.tag == CAMERA else root.findall(CAMERA) if root.tag == ROOTS[0] else []
    if len(found) != 1:
        raise ParseError(
            f"the XML root is <{strict.shown(str(root.tag))}> with {len(found)} <{CAMERA}>, expected one"
        )
    return found[0]


def _distortion(
    fields: _Fields,
    kind: type[OffCentreBrown | InverseBrown],
    focal: Decimal,
    principal_point: tuple[Decimal, ...],
) -> Distortion:
    """The lens in x/z, y/z; OpenCV's own model where it is no more than that."""
    terms = fields.terms()
    if not terms.any() and terms.centre == principal_point:
        return NoDistortion()
    values = {f"k{i}": _scaled(c, focal, 2 * i) for i, c in enumerate(terms.radial, start=1)}
    values |= {"k1": values.get("k1", 0.0), "k2": values.get("k2", 0.0)}
    first, second = (_scaled(c, focal, 1) for c in (terms.p1, terms.p2))
    values["p1"], values["p2"] = CONVENTION.tangential_from_file(first, second)
    values |= {"b1": float(terms.b1), "b2": float(terms.b2)}
    for name, centre, point in zip(("x0", "y0"), terms.centre, principal_point, strict=True):
        values[name] = float(_DECIMAL.divide(_DECIMAL.subtract(centre, point), focal))
    lens = kind(**values)
    if isinstance(lens, OffCentreBrown) and terms.centre == principal_point:
        return exact(lens, BrownConrady) or lens
    return lens


def _model(lens: Distortion, native: Native) -> str:
    """The lens in pixels, as the element of its model."""
    c = {name: Decimal(repr(value)) for name, value in lens.coefficients.items()}
    focal = Decimal(repr(native.fx))
    radial = [_written(c[f"k{i}"], focal, -2 * i) for i in range(1, RADIAL_TERMS + 1)]
    while radial and Decimal(radial[-1]) == 0:
        radial.pop()
    centre = (
        _DECIMAL.add(Decimal(repr(point)), Decimal(_written(c[name], focal, 1)))
        for name, point in (("x0", native.cx), ("y0", native.cy))
    )
    rows = [("CDist", " ".join(map(str, centre))), *(("CoeffDist", value) for value in radial)]
    part = "".join(f"<{name}>{value}</{name}>" for name, value in rows)
    if not any(c[name] for name in ("p1", "p2", "b1", "b2")):
        return f"      <ModRad>{part}</ModRad>\n"
    # P1 is the one on R² + 2u², which is OpenCV's p2.
    p1, p2 = (_written(c[name], focal, -1) for name in ("p2", "p1"))
    tail = [("P1", p1), ("P2", p2), ("b1", str(c["b1"])), ("b2", str(c["b2"]))]
    ending = "".join(f"<{name}>{value}</{name}>" for name, value in tail)
    return f"      <ModPhgrStd><RadialePart>{part}</RadialePart>{ending}</ModPhgrStd>\n"


@lru_cache(maxsize=256)  # as for _decimals
def _scaled(coefficient: Decimal, focal: Decimal, power: int) -> float:
    """A coefficient of pixels to the power −``power`` as one of x/z, y/z."""
    value = float(_DECIMAL.multiply(coefficient, _DECIMAL.power(focal, power)))
    return value if isfinite(value) else strict.number(repr(value), place="CalibDistortion")


def _written(coefficient: Decimal, focal: Decimal, power: int) -> str:
    """A coefficient of x/z, y/z times the focal length to ``power``, to 20 digits."""
    value = _DECIMAL.multiply(coefficient, _DECIMAL.power(focal, power))
    return str(Context(prec=20, traps=[]).plus(value))


class _Terms:
    """The terms of one distortion, in pixels, all zero until one is found."""

    def __init__(self, centre: tuple[Decimal, ...]) -> None:
        self.centre = centre
        self.radial: tuple[Decimal, ...] = ()
        self.p1 = self.p2 = self.b1 = self.b2 = Decimal(0)

    def any(self) -> bool:
        return any((*self.radial, self.p1, self.p2, self.b1, self.b2))


class _Fields:
    """The children of a camera, or of a part of one, by name."""

    def __init__(self, element: _Element) -> None:
        self.element = element
        self.names = [child.tag for child in element]

    def __contains__(self, name: str) -> bool:
        return name in self.names

    def one(self, name: str) -> _Element:
        found = self.element.findall(name)
        if len(found) != 1:
            raise ParseError(f"<{name}> occurs {len(found)} times, expected once", place=name)
        return found[0]

    def text(self, name: str) -> str:
        return (self.one(name).text or "").strip()

    def numbers(self, name: str, count: int) -> tuple[Decimal, ...]:
        """Numbers with all their digits."""
        return _decimals(self.text(name), count, name)

    def optional(self, name: str) -> Decimal:
        return self.numbers(name, 1)[0] if name in self else Decimal(0)

    def size(self) -> ImageSize | None:
        if "SzIm" not in self:
            return None
        width, height = self.numbers("SzIm", 2)
        return strict.image_size(float(width), float(height), place="SzIm")

    def refuse_other_frames(self) -> None:
        """A scanned film counts in its fiducial marks; a rotated or cropped image in those of its original."""
        for name in FRAME_CHANGES:
            if next(self.element.iter(name), None) is not None:
                raise UnsupportedModelError(
                    f"it counts in another frame than the image's, by <{name}>; resample the images and "
                    "calibrate those",
                )
        if "OrIntGlob" not in self:
            return
        affinity = [_Fields(item) for item in self.one("OrIntGlob").findall("Affinite")]
        identity = {"I00": "0 0", "V10": "1 0", "V01": "0 1"}
        if len(affinity) != 1 or any(
            affinity[0].numbers(name, 2) != tuple(map(Decimal, wanted.split()))
            for name, wanted in identity.items()
        ):
            raise UnsupportedModelError(
                "<OrIntGlob> is not the identity: the numbers belong to a turned or cropped image; calibrate the "
                "images as they are",
                place="OrIntGlob",
            )

    def terms(self) -> _Terms:
        """The one distortion of the camera; several in a row have no counterpart here."""
        models = [
            model
            for part in self.element.iterchildren("CalibDistortion")
            for model in part.iterchildren()
            if model.tag != "ModNoDist"
        ]
        nothing = _Terms(self.numbers("PP", 2))
        if "CalibDistortion" not in self:
            raise ParseError("there is no <CalibDistortion>")
        if not models:
            return nothing
        if len(models) > 1:
            names = ", ".join(strict.shown(str(model.tag)) for model in models)
            raise UnsupportedModelError(f"it applies several distortions in a row, {names}")
        [model] = models
        part = _Fields(model)
        if model.tag == "ModRad":
            return part.radial()
        if model.tag == "ModPhgrStd":
            terms = _Fields(part.one("RadialePart")).radial()
            terms.p1, terms.p2 = part.optional("P1"), part.optional("P2")
            terms.b1, terms.b2 = part.optional("b1"), part.optional("b2")
            return terms
        kind = part.text("TypeModele") if "TypeModele" in part else model.tag
        raise UnsupportedModelError(
            f"the distortion {strict.shown(str(kind))} has no counterpart here; run Tapas with Fraser or "
            "RadialExtended",
            place="CalibDistortion",
        )

    def radial(self) -> _Terms:
        """The centre and the radial terms."""
        terms = _Terms(self.numbers("CDist", 2))
        radial = [_decimals(item.text or "", 1, "CoeffDist")[0] for item in self.element.findall("CoeffDist")]
        while radial and radial[-1] == 0:
            radial.pop()
        if len(radial) > RADIAL_TERMS:
            raise UnsupportedModelError(
                f"it has {len(radial)} radial terms, and only {RADIAL_TERMS} have a counterpart here",
                place="CoeffDist",
            )
        terms.radial = tuple(radial)
        return terms

    def extras(self) -> tuple[tuple[str, str], ...]:
        """Numbers and words beside the camera, such as RayonUtile, that go back as they came."""
        return tuple(
            (PREFIX + str(item.tag), text)
            for item in self.element
            if item.tag not in KNOWN and not len(item) and (text := (item.text or "").strip())
        )


@lru_cache(maxsize=256)  # the account reads a file once for each number that no camera has as it stands
def _decimals(text: str, count: int, place: str) -> tuple[Decimal, ...]:
    """Numbers that are plain and finite as doubles, with all their digits."""
    strict.numbers(text, count=count, place=place)
    return tuple(_DECIMAL.create_decimal(part) for part in text.split())


FORMAT = Format(
    name="micmac_xml",
    title="MicMac camera calibration",
    suffixes=(".xml",),
    syntaxes=(Syntax.XML,),
    roots=ROOTS,
    reference="https://github.com/micmacIGN/micmac",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(
        models=(NoDistortion, OffCentreBrown, BrownConrady, InverseBrown),
        two_focals=False,
        unknown_lens=UnknownLens.FREE,
    ),
)
