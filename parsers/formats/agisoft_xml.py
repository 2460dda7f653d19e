"""Agisoft Metashape (PhotoScan) camera calibration, the XML of *Tools ▸ Camera Calibration ▸ Save*.

In the format's own words::

    <calibration>
      <projection>frame</projection>
      <width>5472</width> <height>3648</height>
      <f>3650.1</f> <cx>-3.2</cx> <cy>8.1</cy> <b1>0.4</b1> <b2>-0.1</b2>
      <k1/> … <k4/> <p1/> … <p4/>
      <covariance> <params>f cx cy k1 …</params> <coeffs>…</coeffs> </covariance>
      <date>2024-05-17T10:00:00Z</date>
    </calibration>

    u = W/2 + cx + x'·f + x'·b1 + y'·b2        v = H/2 + cy + y'·f

so fx = f + b1, fy = f and skew = b2, exactly. cx and cy are offsets from the middle of the image, px; a coefficient
that is zero is left out. PhotoScan before 1.4 wrote ``<fx> <fy> <skew>`` instead, and under the same names cx and cy
counted from the image's corner. A file with ``<fx>`` is therefore an old one. p1 and p2 are OpenCV's p2 and p1.
``fisheye`` applies the same polynomial to the equidistant image: without p1, p2 it is Kannala and Brandt's, with them
COLMAP's thin-prism fisheye without prisms.

The older layout has another order of p1 and p2. The only formula that Agisoft published for fx, fy and skew has
OpenCV's order::

    x' = x(1 + K1·r² + K2·r⁴ + K3·r⁶) + P2(r² + 2x²) + 2·P1·x·y        u = cx + x'·fx + y'·skew

p3 and p4 came with the newer formula, so a file that has them follows that formula. Agisoft's staff explained such a
file in the same way (F = fy, B1 = fx − fy, B2 = skew). calibrary states which order it used, and ``tangential`` chooses
the order.

The covariance has the names of the parameters, and the matrix row by row, in px for f, cx, cy, b1 and b2. fx = f + b1,
so the variance of fx includes the covariance of the two. Parameters that are not named were fixed.

Sources: Agisoft Metashape User Manual, appendix C "Camera models"; Agisoft Lens User Manual 0.4.0, 2011, for the older
formula; Agisoft's forum, topic 6437, "Camera Projection Model with 8 distortion coefficients"; DBAT's ``loadpsz.m``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, Grade, ImageSize, Intrinsics
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    KannalaBrandt,
    NoDistortion,
    ThinPrismFisheye,
    required,
)
from calibrary.distortion.brown_polynomial import MetashapeFrame
from calibrary.distortion.equidistant import EquidistantDistortion, PlanarPolynomial
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential
from calibrary.parsers.format import (
    Capacity,
    Format,
    Option,
    ReadContext,
    Sniff,
    Sure,
    UnknownLens,
    WriteContext,
)
from calibrary.parsers.xml import parse_xml
from calibrary.quality import Covariance, Quality

if TYPE_CHECKING:
    from lxml.etree import _Element

COVARIANCE: Final = "covariance"
MOST: Final = 32
SLIGHTLY_NEGATIVE: Final = -1e-9
COEFFICIENTS = ("k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4")
CONVENTION = Convention(
    origin=Origin.IMAGE_CENTRE,
    tangential=Tangential.SWAPPED,
    coefficients=COEFFICIENTS,
    remarks=("fx = f + b1, fy = f, skew = b2", "a number that is zero is left out"),
)
OLD_CONVENTION = Convention(origin=Origin.CORNER, tangential=Tangential.SWAPPED, coefficients=COEFFICIENTS)
PRINCIPAL_POINT = Option(
    name="principal_point",
    values=("offset", "absolute"),
    meaning="whether cx and cy are offsets from the middle of the image or count from its top-left corner",
)
TANGENTIAL = Option(
    name="tangential",
    values=("opencv", "swapped"),
    meaning="whether p1 and p2 of PhotoScan's older layout are OpenCV's, or p2 and p1 as Metashape's",
)
FARTHEST = 0.25
"""A principal point farther off the middle than this share of a side speaks for the other way to count."""

OFFSET_STYLE = ("f", "b1", "b2")
ABSOLUTE_STYLE = ("fx", "fy", "skew")
KNOWN = frozenset(
    (
        "projection",
        "width",
        "height",
        "date",
        COVARIANCE,
        "cx",
        "cy",
        *OFFSET_STYLE,
        *ABSOLUTE_STYLE,
        *COEFFICIENTS,
    )
)
MAX_BYTES = 1024 * 1024
"""A thousand times what Metashape writes."""
PREFIX = "agisoft_xml/"


class MetashapeFisheye(EquidistantDistortion):
    """Metashape's polynomial over the angle, in its own order; what a file has a place for."""

    model: ClassVar[str] = "metashape-fisheye"

    k1: float
    k2: float
    k3: float
    k4: float
    p1: float
    p2: float

    def _stages(self) -> tuple[PlanarPolynomial, ...]:
        return self._thin_prism()._stages()

    def _thin_prism(self) -> ThinPrismFisheye:
        p1, p2 = CONVENTION.tangential_from_file(self.p1, self.p2)
        return ThinPrismFisheye(
            k1=self.k1, k2=self.k2, p1=p1, p2=p2, k3=self.k3, k4=self.k4, sx1=0.0, sy1=0.0
        )

    def equivalents(self) -> tuple[Distortion, ...]:
        """The thin-prism fisheye without prisms, and Kannala and Brandt's without p1 and p2."""
        lens = self._thin_prism()
        return (lens, *lens.equivalents())

    @classmethod
    def from_equivalent(cls, other: Distortion) -> MetashapeFisheye | None:
        """A thin-prism fisheye without prisms; None for every other model."""
        if not isinstance(other, ThinPrismFisheye) or other.sx1 or other.sy1:
            return None
        p1, p2 = CONVENTION.tangential_to_file(other.p1, other.p2)
        return cls(k1=other.k1, k2=other.k2, k3=other.k3, k4=other.k4, p1=p1, p2=p2)


def sniff(content: Content) -> Sniff | None:
    """Root and first child have names that no other program pairs."""
    if content.xml_tags[:1] == ("calibration",) and "projection" in content.xml_tags:
        return Sniff(Sure.MAGIC, "the XML root is <calibration> and contains <projection>")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the file."""
    root = parse_xml(data, source=context.name, max_bytes=MAX_BYTES)
    if root.tag != "calibration":
        raise ParseError(f"the XML root is <{strict.shown(str(root.tag))}>, expected <calibration>")
    return [read_elements(root, context)]


def read_elements(elements: Iterable[_Element], context: ReadContext) -> Calibration:
    """The camera of the children of a <calibration>."""
    fields = _Fields(elements)
    projection = fields.text("projection")
    if projection not in {"frame", "fisheye"}:
        raise UnsupportedModelError(
            f"the projection is {strict.shown(projection)}, which has no counterpart here; "
            "expected frame or fisheye"
        )
    size = context.size(fields.size())
    intrinsics, notes = _intrinsics(fields, size, context)
    assumptions = _order_tangential(fields, context)
    distortion = _fisheye(fields) if projection == "fisheye" else _frame(fields)
    return context.calibration(
        intrinsics,
        distortion,
        date=fields.text("date") if "date" in fields else None,
        assumptions=assumptions,
        grade=Grade.ADJUSTED,
        quality=read_covariance(fields.elements.get(COVARIANCE), distortion),
        notes=(*notes, *assumptions),
        extras=fields.extras(),
    )


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The layout Metashape writes now; zeros that other programs miss when absent are written out."""
    [calibration] = calibrations
    K, distortion = calibration.intrinsics, calibration.distortion
    native = CONVENTION.native(K)
    b1 = native.fx - native.fy
    numbers = {"f": native.fy, "cx": native.cx, "cy": native.cy}
    numbers |= {name: value for name, value in (("b1", b1), ("b2", native.skew)) if value}
    if isinstance(distortion, KannalaBrandt | MetashapeFisheye):
        projection, coefficients = "fisheye", distortion.coefficients
    else:
        frame = required(distortion, MetashapeFrame)
        projection, coefficients = "frame", frame.coefficients
        coefficients = {
            name: value for name, value in coefficients.items() if value or name not in {"k4", "p3", "p4"}
        }
    width, height = K.image_size
    rows = [("projection", projection), ("width", str(width)), ("height", str(height))]
    rows += [(name, repr(value)) for name, value in (numbers | coefficients).items()]
    rows += [(key.removeprefix(PREFIX), value) for key, value in calibration.extras if key.startswith(PREFIX)]
    if calibration.provenance.date:
        rows.append(("date", calibration.provenance.date))
    if calibration.quality is not None:
        rows += [(COVARIANCE, xml) for xml in [written_covariance(calibration.quality, distortion)] if xml]
    body = "".join(f"  {_element(name, value)}\n" for name, value in rows)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<calibration>\n{body}</calibration>\n'.encode()


def _intrinsics(fields: _Fields, size: ImageSize, context: ReadContext) -> tuple[Intrinsics, tuple[str, ...]]:
    """K, and what a person should know about how it was read."""
    offset_style, absolute_style = (
        [name for name in style if name in fields] for style in (OFFSET_STYLE, ABSOLUTE_STYLE)
    )
    if offset_style and absolute_style:
        raise ParseError(
            f"it contains <{offset_style[0]}> and <{absolute_style[0]}>, which belong to two layouts; "
            "expected f, b1, b2 or fx, fy, skew"
        )
    if absolute_style:
        fx, fy, skew = fields.number("fx"), fields.number("fy"), fields.number("skew", 0.0)
    else:
        fy = fields.number("f")
        fx, skew = fy + fields.number("b1", 0.0), fields.number("b2", 0.0)
    asked = context.option(PRINCIPAL_POINT.name)
    absolute = asked == "absolute" if asked else bool(absolute_style)
    if absolute:
        centre = (fields.number("cx"), fields.number("cy"))
    else:
        centre = (fields.number("cx", 0.0), fields.number("cy", 0.0))
    native = Native(fx=fx, fy=fy, cx=centre[0], cy=centre[1], skew=skew)
    convention = OLD_CONVENTION if absolute else CONVENTION
    K = convention.intrinsics(native, size)
    if asked is None:
        _refuse_the_other_count(K, absolute_style=bool(absolute_style))
    notes = ("PhotoScan's older layout: cx and cy were read as counted from the image's corner",)
    return K, notes if absolute else ()


def _refuse_the_other_count(K: Intrinsics, *, absolute_style: bool) -> None:
    """Files put together by hand mix the two layouts up, and the K they give is wrong by half an image."""
    width, height = K.image_size
    drift = max(abs(K.cx - width / 2) / width, abs(K.cy - height / 2) / height)
    if drift > FARTHEST:
        expected = "the image's corner" if absolute_style else "its middle"
        raise ParseError(
            f"cx and cy, counted from {expected} as this layout does, put the principal point {drift:.0%} of "
            "a side off the middle; say which count is meant with --set principal_point=offset or "
            "principal_point=absolute",
            place="cx, cy",
        )


def _order_tangential(fields: _Fields, context: ReadContext) -> tuple[str, ...]:
    """Put p1 and p2 of the older layout into Metashape's order; what was taken for granted, in words."""
    asked = context.option(TANGENTIAL.name)
    older = any(name in fields for name in ABSOLUTE_STYLE)
    if not (fields.number("p1", 0.0) or fields.number("p2", 0.0)) or not (older or asked):
        return ()
    newer_formula = bool(fields.number("p3", 0.0) or fields.number("p4", 0.0))
    opencv = asked == "opencv" if asked else not newer_formula
    if opencv:
        fields.exchange("p1", "p2")
    if asked:
        return (f"the order of p1 and p2 is {'OpenCV' if opencv else 'Metashape'}'s, as the caller says",)
    taken = (
        "OpenCV's was taken, as in the manual of Agisoft Lens 0.4"
        if opencv
        else "Metashape's was taken, because p3 and p4 belong to its formula"
    )
    return (f"PhotoScan's older layout does not state the order of p1 and p2; {taken}",)


def _frame(fields: _Fields) -> Distortion:
    c = {name: fields.number(name, 0.0) for name in COEFFICIENTS}
    if not any(c.values()):
        return NoDistortion()
    if c["k4"] or c["p3"] or c["p4"]:
        return MetashapeFrame(**c)
    p1, p2 = CONVENTION.tangential_from_file(c["p1"], c["p2"])
    return BrownConrady(k1=c["k1"], k2=c["k2"], p1=p1, p2=p2, k3=c["k3"])


def _fisheye(fields: _Fields) -> Distortion:
    for name in ("p3", "p4"):
        if fields.number(name, 0.0):
            raise UnsupportedModelError(
                f"a fisheye with {name} ≠ 0 has no counterpart here; adjust the camera in Metashape with p3 "
                "and p4 fixed at zero and save it again",
                place=name,
            )
    lens = MetashapeFisheye(**{name: fields.number(name, 0.0) for name in MetashapeFisheye.names()})
    return lens.equivalents()[-1]


class _Fields:
    """The children of <calibration> by name."""

    def __init__(self, elements: Iterable[_Element]) -> None:
        self.elements: dict[str, _Element] = {}
        for element in elements:
            name = str(element.tag)
            if name in self.elements:
                raise ParseError("it is a duplicate key", place=name)
            self.elements[name] = element

    def __contains__(self, name: str) -> bool:
        return name in self.elements

    def text(self, name: str) -> str:
        if name not in self.elements:
            raise ParseError(f"there is no <{name}>")
        return (self.elements[name].text or "").strip()

    def exchange(self, first: str, second: str) -> None:
        """Let each stand under the other's name."""
        pair = {first: self.elements.get(second), second: self.elements.get(first)}
        kept = {name: element for name, element in self.elements.items() if name not in pair}
        self.elements = kept | {name: element for name, element in pair.items() if element is not None}

    def number(self, name: str, default: float | None = None) -> float:
        """A number; the default where there is one and the element is absent."""
        if default is not None and name not in self.elements:
            return default
        return strict.number(self.text(name), place=name)

    def size(self) -> ImageSize | None:
        if "width" not in self.elements and "height" not in self.elements:
            return None
        return strict.image_size(self.number("width"), self.number("height"))

    def extras(self) -> tuple[tuple[str, str], ...]:
        """What is not part of the camera: text, or XML where it is more than text."""
        return tuple(
            (PREFIX + name, _content(element)) for name, element in self.elements.items() if name not in KNOWN
        )


def _content(element: _Element) -> str:
    from lxml import etree

    text = (element.text or "").strip()
    if len(element) or element.attrib or element.nsmap or text.startswith("<"):
        return etree.tostring(element, encoding="unicode", with_tail=False)
    return text


def _element(name: str, value: str) -> str:
    """One line of the file; an extra that was XML goes back as it came."""
    return value if value.startswith("<") else f"<{name}>{escape(value, quote=False)}</{name}>"


FORMAT = Format(
    name="agisoft_xml",
    title="Agisoft Metashape camera calibration",
    suffixes=(".xml",),
    syntaxes=(Syntax.XML,),
    reference="https://www.agisoft.com/pdf/metashape-pro_2_2_en.pdf",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(
        models=(NoDistortion, BrownConrady, MetashapeFrame, KannalaBrandt, MetashapeFisheye),
        skew=True,
        unknown_lens=UnknownLens.FREE,
    ),
    states=("date",),
    options=(PRINCIPAL_POINT, TANGENTIAL),
)


def read_covariance(element: _Element | None, distortion: Distortion | None) -> Quality | None:
    """Read the standard deviations and, if the matrix is valid, the covariance, by parameter name of K and the model.

    Negative variances (from a nearly singular adjustment) are omitted, and then no correlations are read.

    Raises:
        ParseError: it is not a square matrix of distinct parameters.
    """
    if element is None:
        return None
    names = tuple((element.findtext("params") or "").split())
    size = len(names)
    if len(set(names)) != size or size > MOST:
        raise ParseError(f"its covariance is of {size} parameters, expected each once", place=COVARIANCE)
    coefficients = strict.numbers(element.findtext("coeffs") or "", count=size**2, place=COVARIANCE)
    native = np.array(coefficients).reshape(size, size)
    sums = {name: parts for name, parts in _sums(distortion).items() if parts[0] in names}
    if not sums:
        return None
    to_ours = np.array([[float(name in parts) for name in names] for parts in sums.values()])
    matrix = to_ours @ native @ to_ours.T
    variances = dict(zip(sums, np.diag(matrix).tolist(), strict=True))
    std = {name: value**0.5 for name, value in variances.items() if value >= 0}
    if not std:
        return None
    return Quality(std=std, covariance=_covariance(tuple(sums), matrix))


def written_covariance(quality: Quality, distortion: Distortion | None) -> str:
    """The element for a calibration's covariance; empty if Metashape's parameters cannot represent it.

    It includes the variance factor, which the format cannot state separately.
    """
    ours = quality.covariance
    if ours is None or not {"fx", "fy"} <= set(ours.names):
        return ""
    # b1 = fx − fy; the other parameters correspond one to one.
    rows: dict[str, Mapping[str, float]] = {"f": {"fy": 1.0}, "b1": {"fx": 1.0, "fy": -1.0}}
    for name, (native, *more) in _sums(distortion).items():
        if name in ours.names and name != "fy" and not more:
            rows[native] = {name: 1.0}
    left_over = set(ours.names) - {name for row in rows.values() for name in row}
    if left_over:
        return ""
    to_native = np.array([[row.get(name, 0.0) for name in ours.names] for row in rows.values()])
    matrix = to_native @ (ours.matrix * quality.inflation) @ to_native.T
    coefficients = " ".join(map(repr, matrix.ravel().tolist()))
    return f"<covariance><params>{' '.join(rows)}</params><coeffs>{coefficients}</coeffs></covariance>"


def _sums(distortion: Distortion | None) -> dict[str, tuple[str, ...]]:
    """Metashape's parameters that add up to each parameter of calibrary."""
    swapped = {"p1": "p2", "p2": "p1"} if isinstance(distortion, BrownConrady) else {}
    lens = {name: (swapped.get(name, name),) for name in (distortion.names() if distortion else ())}
    return {"fx": ("f", "b1"), "fy": ("f",), "cx": ("cx",), "cy": ("cy",), "skew": ("b2",), **lens}


def _covariance(names: tuple[str, ...], matrix: FloatArray) -> Covariance | None:
    spread = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    if (np.diag(matrix) < 0).any() or not np.allclose(matrix, matrix.T, atol=0.0, rtol=1e-6):
        return None
    unit = matrix / np.outer(*(np.where(spread > 0, spread, 1.0),) * 2)
    if np.linalg.eigvalsh((unit + unit.T) / 2)[0] < SLIGHTLY_NEGATIVE:
        return None
    return Covariance.from_matrix(names, (matrix + matrix.T) / 2)
