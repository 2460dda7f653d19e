"""mrcal's camera model, ``.cameramodel``: a Python dictionary as text.

In the format's own words::

    # generated on 2020-08-30 22:55:50 with   mrcal-calibrate-cameras --focal 3650 …
    {
        'lensmodel':  'LENSMODEL_OPENCV5',

        # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....
        'intrinsics': [ 3650.1, 3649.8, 2736.2, 1824.7, -0.0125, 0.0231, -0.0004, 0.0008, -0.0172 ],

        # extrinsics are rt_fromref
        'extrinsics': [ 0, 0, 0, 0, 0, 0 ],

        'imagersize': [ 5472, 3648 ],
    }

A solved model also carries ``valid_intrinsics_region``, a polygon in the image, and ``optimization_inputs``, all the
data it was solved from; both are valid for these intrinsics only. The OPENCV models have OpenCV's coefficients in
OpenCV's order. The splined stereographic model has its grid in its name,
``LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=20_fov_x_deg=170``, and after fx, fy, cx, cy the two numbers of each
knot, row by row. The CAHVOR, stereographic and panoramic models have no counterpart here.

Source: mrcal, "Camera model representation in memory and on disk" and "Lens models", https://mrcal.secretsauce.net.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import NoReturn, TypeAlias

from calibrary.calibration import Calibration
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    NoDistortion,
    Rational,
    SplinedStereographic,
    ThinPrism,
)
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._bound_extras import bound, unbound
from calibrary.parsers.formats._lenses import lens
from calibrary.parsers.formats._text_rows import text_of
from calibrary.records import Json

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
)
MODELS = {
    "LENSMODEL_PINHOLE": 0,
    "LENSMODEL_OPENCV4": 4,
    "LENSMODEL_OPENCV5": 5,
    "LENSMODEL_OPENCV8": 8,
    "LENSMODEL_OPENCV12": 12,
}
"""With how many coefficients follow fx, fy, cx, cy."""
SPLINED = "LENSMODEL_SPLINED_STEREOGRAPHIC"
_SPLINED = re.compile(rf"{SPLINED}_order=(\d{{1,5}})_Nx=(\d{{1,5}})_Ny=(\d{{1,5}})_fov_x_deg=(\d{{1,5}})")
EXTRINSICS = ("rt_cam_ref", "extrinsics")
"""From mrcal 2.5 on, and before."""
BOUND = ("valid_intrinsics_region", "optimization_inputs", "icam_intrinsics")
PREFIX = "mrcal/"
DEEPEST = 8
MAX_BYTES = 32 * 1024 * 1024
"""A model carries the data it was solved from: some megabytes for a thousand images."""
MOST_VALUES = 100_000

_SPACE = r"(?:[\s]++|#[^\n]*+)*+"
_TOKEN = re.compile(
    _SPACE + r"(?:(?P<mark>[][(){}:,])"
    r"|(?P<text>b?'(?:[^'\\\n]|\\.)*+'|b?\"(?:[^\"\\\n]|\\.)*+\")"
    r"|(?P<word>[^][(){}:,'\"\s#]++)"
    r"|(?P<end>\Z))"
)
# The first line of what mrcal's tools write.
_GENERATED = re.compile(
    r"\s*+#[ \t]*generated on (\d{4}-\d\d-\d\d(?:[ T][\d:.]{1,20})?(?:Z|[+-]\d\d:?\d\d)?)"
    r"(?: with[ \t]+([^\n]{0,1000}))?"
)
_CLOSING = {"[": "]", "(": ")"}

Span: TypeAlias = tuple[Json, str]
"""A value, and the characters that stand for it in the file."""


def sniff(content: Content) -> Sniff | None:
    """The key 'lensmodel' with one of mrcal's names; PhotonVision's JSON has it beside other keys."""
    text = content.text or ""
    if "LENSMODEL_" not in text or "cameraIntrinsics" in text:
        return None
    if re.search(r"""['"]lensmodel['"]\s*:\s*['"]LENSMODEL_""", text):
        return Sniff(Sure.MAGIC, "the key 'lensmodel' with a LENSMODEL_")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the file."""
    text = text_of(data, most=MAX_BYTES)
    spans = _Dictionary(text, context.name).read()
    tree = Node({key: value for key, (value, _) in spans.items()}, source=context.name)
    (fx, fy, cx, cy), distortion = _lens(tree["lensmodel"].text(), tree["intrinsics"])
    width, height = tree["imagersize"].numbers(2)
    size = context.size(strict.image_size(width, height, place="imagersize"))
    intrinsics = CONVENTION.intrinsics(Native(fx=fx, fy=fy, cx=cx, cy=cy), size)
    made = _GENERATED.match(text)
    extras = [
        (PREFIX + key, bound(text, intrinsics, distortion) if key in BOUND else text)
        for key, (_, text) in spans.items()
        if key not in {"lensmodel", "intrinsics", "imagersize"}
    ]
    return [
        context.calibration(
            intrinsics,
            distortion,
            date=made and made[1],
            tool=made and _program(made[2]),
            extras=tuple(extras),
        )
    ]


def _lens(model: str, values: Node) -> tuple[Sequence[float], Distortion]:
    """fx, fy, cx, cy in the file's pixels, and the distortion."""
    if model in MODELS:
        numbers = values.numbers(4 + MODELS[model])
        return numbers[:4], lens(numbers[4:])
    grid = _SPLINED.fullmatch(model)
    if grid is None:
        raise UnsupportedModelError(
            f"the lens model is {strict.shown(model, 60)}, which has no counterpart here; make it one of "
            f"{', '.join(MODELS)} or {SPLINED}_order=…_Nx=…_Ny=…_fov_x_deg=… with mrcal-convert-lensmodel, which "
            "says by how much the two differ",
            place="lensmodel",
        )
    order, nx, ny, fov_x_deg = map(int, grid.groups())
    numbers = values.numbers()
    knots = tuple(numbers[4:])
    try:
        return numbers[:4], SplinedStereographic(order=order, nx=nx, ny=ny, fov_x_deg=fov_x_deg, knots=knots)
    except InputError as error:
        raise ParseError(
            error.message, place="intrinsics" if error.place == "knots" else "lensmodel"
        ) from None


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The layout mrcal writes; what was solved goes back beside the intrinsics it was solved with, or not at all."""
    [calibration] = calibrations
    K, distortion = calibration.intrinsics, calibration.distortion
    if isinstance(distortion, SplinedStereographic):
        values, grid = list(distortion.knots), distortion
        model = f"{SPLINED}_order={grid.order}_Nx={grid.nx}_Ny={grid.ny}_fov_x_deg={grid.fov_x_deg}"
    else:
        values = list(distortion.coefficients.values()) if distortion is not None else []
        if isinstance(distortion, BrownConrady) and not distortion.k3:
            values.pop()
        model = next(name for name, count in MODELS.items() if count == len(values))
    native = CONVENTION.native(K)
    numbers = ", ".join(repr(value) for value in (native.fx, native.fy, native.cx, native.cy, *values))
    lines = [
        f"    'lensmodel':  '{model}',",
        "",
        "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....",
        f"    'intrinsics': [ {numbers} ],",
        "",
    ]
    lines += _extras(calibration)
    lines.append(f"    'imagersize': [ {K.image_size[0]}, {K.image_size[1]} ],")
    return ("".join(_heading(calibration)) + "{\n" + "\n".join(lines) + "\n}\n").encode()


def _heading(calibration: Calibration) -> Iterator[str]:
    """The comment that mrcal's tools begin with, about the calibration and not about this file."""
    date, tool = calibration.provenance.date, calibration.provenance.tool
    if date is not None:
        yield f"# generated on {date.replace('T', ' ')}{f' with   {tool}' if tool else ''}\n"


def _extras(calibration: Calibration) -> Iterator[str]:
    extras = {key.removeprefix(PREFIX): text for key, text in calibration.extras if key.startswith(PREFIX)}
    if not any(key in extras for key in EXTRINSICS):
        extras["extrinsics"] = "[ 0, 0, 0, 0, 0, 0 ]"
    for key, value in extras.items():
        text = unbound(value, calibration.intrinsics, calibration.distortion) if key in BOUND else value
        if text is not None:
            yield f"    {key!r}: {text},"
            yield ""


def _program(command: str | None) -> str | None:
    """The program of a command line; arguments of mrcal's own tools, such as paths, are left out."""
    words = (command or "").split()
    if not words:
        return None
    name = words[0].rpartition("/")[2]
    return name if name.startswith("mrcal") else " ".join([name, *words[1:]])


class _Dictionary:
    """A reader of the small part of Python's syntax that mrcal writes: texts, numbers and lists of them."""

    def __init__(self, text: str, source: str) -> None:
        self.text = text
        self.source = source
        self.position = 0
        self.values = 0

    def read(self) -> dict[str, Span]:
        """The whole file's dictionary."""
        table: dict[str, Span] = {}
        self.expect("{")
        while not self.accept("}"):
            key, _ = self.value(0)
            if not isinstance(key, str) or key in table:
                self.fail(f"{strict.shown(str(key))} is not a key, or a duplicate")
            self.expect(":")
            table[key] = self.value(0)
            if not self.accept(","):
                self.expect("}")
                break
        if self.token()["end"] is None:
            self.fail("text after the end of the dictionary")
        return table

    def value(self, depth: int) -> Span:
        """One value, and how it was written."""
        token = self.token()
        self.values += 1
        if self.values > MOST_VALUES:
            self.fail(f"more than {MOST_VALUES} values")
        if token["text"] is not None:
            written = token["text"]
            return written.removeprefix("b")[1:-1], written
        if token["word"] is not None:
            word = token["word"]
            try:
                return strict.number(word), word
            except ParseError as error:
                raise ParseError(error.message, source=self.source, place=self.place()) from None
        if token["mark"] not in _CLOSING:
            self.fail(
                "expected a text, a number or a list" if token["end"] is None else "the file ends too early"
            )
        if depth == DEEPEST:
            self.fail(f"lists nested more than {DEEPEST} deep")
        start = token.start("mark")
        items: list[Json] = []
        while not self.accept(_CLOSING[token["mark"]]):
            items.append(self.value(depth + 1)[0])
            if not self.accept(","):
                self.expect(_CLOSING[token["mark"]])
                break
        return items, self.text[start : self.position]

    def token(self) -> re.Match[str]:
        """The next one, taken."""
        match = _TOKEN.match(self.text, self.position)
        if match is None:
            self.fail("this is not Python text")
        self.position = match.end()
        return match

    def accept(self, mark: str) -> bool:
        """Whether the next token is that mark; it is taken if so."""
        match = _TOKEN.match(self.text, self.position)
        if match is None or match["mark"] != mark:
            return False
        self.position = match.end()
        return True

    def expect(self, mark: str) -> None:
        """Take that mark."""
        if not self.accept(mark):
            ended = not self.text[self.position :].strip()
            self.fail("the file ends too early" if ended else f"expected {mark!r}")

    def place(self) -> str:
        return f"line {self.text.count(chr(10), 0, self.position) + 1}"

    def fail(self, message: str) -> NoReturn:
        raise ParseError(
            f"this is not an mrcal dictionary: {message}", source=self.source, place=self.place()
        )


FORMAT = Format(
    name="mrcal",
    title="mrcal camera model",
    suffixes=(".cameramodel",),
    syntaxes=(Syntax.TEXT, Syntax.JSON),
    reference="https://mrcal.secretsauce.net/cameramodels.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(NoDistortion, BrownConrady, Rational, ThinPrism, SplinedStereographic)),
    states=("date", "tool"),
)
