"""NASA's Ames Stereo Pipeline, the pinhole cameras it keeps in ``.tsai`` files.

In the format's own words::

    VERSION_4
    PINHOLE
    fu = 28.4      fv = 28.4      cu = 17.9      cv = 11.9
    u_direction = 1 0 0           v_direction = 0 1 0           w_direction = 0 0 1
    C = 0 0 0                     R = 1 0 0 0 1 0 0 0 1
    pitch = 0.0064
    TSAI
    k1 = …  k2 = …  k3 = …  p1 = …  p2 = …

one ``name = value`` to a line. fu, fv, cu, cv are in the unit of ``pitch``, the size of a pixel; files older than
version 3 may have neither ``pitch`` nor the name of the lens model, and then mean pixels and TSAI. The file does not
contain the size of the image. It contains the pose, which calibrary does not read.

    NULL            no distortion
    TSAI            OpenCV's k1 k2 p1 p2 k3, the last one optional
    AdjustableTSAI  OpenCV's, with any number of radial terms, and a skew (Alpha, a share of fu)
    FISHEYE, FOV    OpenCV's fisheye; the field-of-view model
    Photometrix     distorted to undistorted, in the unit of pitch, about (cu + xp, cv + yp); b1 and b2 are not used
    BrownConrady    distorted to undistorted, in the unit of pitch, about (cu + xp, cv + yp), which the rays meet too;
                    decentring P1·r² + P2·r⁴ at the angle phi

Sources: Ames Stereo Pipeline, "Pinhole models"; Vision Workbench, ``Camera/PinholeModel.cc`` and
``LensDistortion.cc``, which decide where the two differ.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from msgspec import Struct, field

from calibrary.arrays import np
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    FieldOfView,
    InverseBrown,
    InversePolynomial,
    KannalaBrandt,
    NoDistortion,
    OffCentreBrown,
    exact,
    required,
)
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._metric_lens import normalised
from calibrary.parsers.formats._text_rows import rows_of

CONVENTION = Convention(
    origin=Origin.CORNER,
    coefficients=("k1", "k2", "k3", "p1", "p2"),
    remarks=(
        "lengths are in the unit of pitch, the size of a pixel",
        "Photometrix and BrownConrady map the distorted point to the undistorted one, in the unit of pitch",
    ),
)
AXES = ("u_direction", "v_direction", "w_direction")
BEFORE_THE_LENS = ("fu", "fv", "cu", "cv", *AXES, "C", "R")
PITCH = "asp_tsai/pitch"
ORIGIN_NOTE = (
    "cu and cv count from the upper-left corner of the image, as the Stereo Pipeline's manual says; no source "
    "states whether that is the corner of the first pixel or its centre"
)
FIRST_VERSION_WITH_PITCH = 3
FIRST_VERSION_WITH_TYPE = 4

_VERSION = re.compile(r"VERSION_(\d{1,3})")
_ROW = re.compile(r"([A-Za-z]\w{0,40})\s*=\s*(.*)")
_VECTOR = re.compile(r"(Radial|Tangen\w*)\s+Coeff\s*:\s*Vector\d*\s*\(([^()]*)\)", re.IGNORECASE)
_ALPHA = re.compile(r"Alpha\s*:\s*(\S+)", re.IGNORECASE)


class _Rows(Struct):
    """A file taken apart."""

    values: dict[str, tuple[float, ...]] = field(default_factory=dict)
    lens: str | None = None

    def number(self, name: str, default: float | None = None) -> float:
        """One number; the default where there is one and the row is absent."""
        if default is not None and name not in self.values:
            return default
        return self.numbers(name, 1)[0]

    def numbers(self, name: str, count: int | None = None) -> tuple[float, ...]:
        """A row's numbers."""
        if name not in self.values:
            raise ParseError(f"there is no {name}")
        values = self.values[name]
        strict.check_count(len(values), count, place=name)
        return values


def sniff(content: Content) -> Sniff | None:
    """The version and the type of camera, or, before there was a type, the rows that the file begins with."""
    first, second = (*content.lines[:2], "", "")[:2]
    if _VERSION.fullmatch(first) and second in {"PINHOLE", "OPTICAL_BAR"}:
        return Sniff(Sure.MAGIC, f"the first lines are {first} and {second}")
    begins_with_focal = re.match(r"fu\s*=", second if _VERSION.fullmatch(first) else first)
    if begins_with_focal and any(line.startswith("u_direction") for line in content.lines[:12]):
        return Sniff(Sure.MAGIC, "it begins with fu, and has a u_direction")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the file; its size comes from the caller."""
    rows = _taken_apart(data)
    _check_axes(rows)
    size = context.size(None)
    pitch = rows.number("pitch", 1.0)
    if not pitch > 0:
        raise ParseError(f"the pitch is {pitch:g}, expected the size of a pixel")
    fu, fv, cu, cv = (rows.number(name) for name in ("fu", "fv", "cu", "cv"))
    notes: tuple[str, ...] = (ORIGIN_NOTE,)
    lens = (rows.lens or "TSAI").upper()
    if lens == "BROWNCONRADY":
        cu, cv = cu + rows.number("xp"), cv + rows.number("yp")
    if lens == "PHOTOMETRIX" and (rows.number("b1", 0.0) or rows.number("b2", 0.0)):
        notes = (*notes, "b1 and b2 were left out, as the Stereo Pipeline does")
    skew = fu * rows.number("alpha", 0.0) if lens == "ADJUSTABLETSAI" else 0.0
    native = Native(fx=fu / pitch, fy=fv / pitch, cx=cu / pitch, cy=cv / pitch, skew=skew / pitch)
    return [
        context.calibration(
            CONVENTION.intrinsics(native, size),
            _distortion(lens, rows, fu, fv),
            grade=Grade.ADJUSTED,
            notes=notes,
            extras=((PITCH, repr(pitch)),) if "pitch" in rows.values else (),
        )
    ]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """Version 4, at the origin of the world and looking along z: the camera without a place."""
    [calibration] = calibrations
    pitch = next((strict.number(value) for key, value in calibration.extras if key == PITCH), 1.0)
    native = CONVENTION.native(calibration.intrinsics)
    lengths = {"fu": native.fx, "fv": native.fy, "cu": native.cx, "cv": native.cy}
    name, coefficients = _lens_rows(calibration.distortion or NoDistortion())
    rows = [
        "VERSION_4",
        "PINHOLE",
        *(f"{key} = {value * pitch!r}" for key, value in lengths.items()),
        "u_direction = 1 0 0",
        "v_direction = 0 1 0",
        "w_direction = 0 0 1",
        "C = 0 0 0",
        "R = 1 0 0 0 1 0 0 0 1",
        f"pitch = {pitch!r}",
        name,
        *(f"{key} = {value!r}" for key, value in coefficients.items()),
    ]
    return "".join(f"{row}\n" for row in rows).encode()


def _lens_rows(distortion: Distortion) -> tuple[str, dict[str, float]]:
    """The name of a lens model and its coefficients; the optional k3 is not the last, where a cut would hide it."""
    if isinstance(distortion, NoDistortion):
        return "NULL", {}
    if isinstance(distortion, KannalaBrandt):
        return "FISHEYE", distortion.coefficients
    if isinstance(distortion, FieldOfView):
        return "FOV", {"k1": distortion.omega}
    brown = required(distortion, BrownConrady)
    return "TSAI", {name: brown.coefficients[name] for name in ("k1", "k2", "k3", "p1", "p2")}


def _taken_apart(data: bytes) -> _Rows:
    """The rows by name, checked to be a pinhole camera's."""
    lines = rows_of(data)
    filled = [(index, line.strip()) for index, line in enumerate(lines, start=1) if line.strip()]
    rows = _Rows()
    version = 1
    if filled and (found := _VERSION.fullmatch(filled[0][1])):
        version = int(found.group(1))
        filled = filled[1:]
        if version >= FIRST_VERSION_WITH_TYPE:
            if not filled:
                raise ParseError("there is nothing after the version")
            if filled[0][1] != "PINHOLE":
                raise UnsupportedModelError(
                    f"the camera is {strict.shown(filled[0][1])}, expected PINHOLE",
                    place="line 2",
                )
            filled = filled[1:]
    for index, line in filled:
        _take(rows, line, place=f"line {index}")
    for name in BEFORE_THE_LENS:
        rows.numbers(name)
    if version >= FIRST_VERSION_WITH_PITCH and ("pitch" not in rows.values or rows.lens is None):
        missing = "pitch" if "pitch" not in rows.values else "name of a lens model"
        raise ParseError(f"there is no {missing}, which version {version} has")
    return rows


def _take(rows: _Rows, line: str, *, place: str) -> None:
    """One line into the rows."""
    vector, alpha = _VECTOR.fullmatch(line), _ALPHA.fullmatch(line)
    if found := _ROW.fullmatch(line):
        name, text = found.group(1), found.group(2)
    elif vector:
        name = "radial" if vector.group(1).upper() == "RADIAL" else "tangential"
        text = vector.group(2).replace(",", " ")
    elif alpha:
        name, text = "alpha", alpha.group(1)
    elif rows.lens is None and re.fullmatch(r"[A-Za-z]\w{0,40}", line):
        rows.lens = line
        return
    else:
        raise ParseError(f"{strict.shown(line)} is not 'name = value'", place=place)
    if name in rows.values:
        raise ParseError(f"{name} is a duplicate key", place=place)
    rows.values[name] = strict.numbers(text, place=place)


def _check_axes(rows: _Rows) -> None:
    """The image's axes in the camera frame may be turned, which is no matter of K, but not mirrored."""
    axes = np.array([rows.numbers(name, 3) for name in AXES])
    with np.errstate(all="ignore"):
        is_rotation = np.allclose(axes @ axes.T, np.eye(3), atol=1e-6) and np.linalg.det(axes) > 0
    if not is_rotation:
        raise UnsupportedModelError(
            "u_direction, v_direction and w_direction are not a rotation, so the image is mirrored or sheared",
            place="u_direction",
        )


def _distortion(lens: str, rows: _Rows, fu: float, fv: float) -> Distortion:
    if lens == "NULL":
        return NoDistortion()
    if lens == "TSAI":
        c = {name: rows.number(name) for name in ("k1", "k2", "p1", "p2")} | {"k3": rows.number("k3", 0.0)}
        return BrownConrady(**c) if any(c.values()) else NoDistortion()
    if lens == "ADJUSTABLETSAI":
        return _adjustable(rows)
    if lens == "FISHEYE":
        return KannalaBrandt(**{name: rows.number(name) for name in ("k1", "k2", "k3", "k4")})
    if lens == "FOV":
        return FieldOfView(omega=rows.number("k1"))
    if lens not in {"PHOTOMETRIX", "BROWNCONRADY"}:
        raise UnsupportedModelError(
            f"the lens model {strict.shown(rows.lens or lens)} has no counterpart here; convert the camera with "
            "convert_pinhole_model --output-type TsaiLensDistortion",
        )
    if fu != fv:
        raise UnsupportedModelError(
            f"{lens} with fu = {fu:g} and fv = {fv:g} has no counterpart here: its circles are ellipses on the "
            "sensor; convert the camera with convert_pinhole_model --output-type TsaiLensDistortion",
        )
    return _photometrix(rows, fu) if lens == "PHOTOMETRIX" else _brown_conrady(rows, fu)


def _adjustable(rows: _Rows) -> Distortion:
    radial = rows.numbers("radial")
    p1, p2 = rows.numbers("tangential", 2)
    rows.number("alpha")
    while radial and not radial[-1]:
        radial = radial[:-1]
    if len(radial) > 5:
        raise UnsupportedModelError(f"{len(radial)} radial terms have no counterpart here, expected up to 5")
    k = dict(zip(("k1", "k2", "k3", "k4", "k5"), (*radial, 0.0, 0.0, 0.0, 0.0, 0.0), strict=False))
    wide = OffCentreBrown(**k, p1=p1, p2=p2)
    return next((same for kind in (NoDistortion, BrownConrady) if (same := exact(wide, kind))), wide)


def _photometrix(rows: _Rows, focal: float) -> Distortion:
    """The centre moves, the principal point of the rays does not: the program adds the correction to the point."""
    k1, k2, k3 = normalised([rows.number(name) for name in ("k1", "k2", "k3")], focal)
    return InverseBrown(
        k1=k1,
        k2=k2,
        k3=k3,
        p1=rows.number("p2") * focal,
        p2=rows.number("p1") * focal,
        x0=rows.number("xp") / focal,
        y0=rows.number("yp") / focal,
    )


def _brown_conrady(rows: _Rows, focal: float) -> Distortion:
    k1, k2, k3 = normalised([rows.number(name) for name in ("k1", "k2", "k3")], focal)
    phi = rows.number("phi")
    by_r2, by_r4 = normalised((rows.number("p1"), rows.number("p2")), focal, powers=(1, 3))
    wide = InversePolynomial(
        k1=k1, k2=k2, k3=k3, k4=0.0, p1=0.0, p2=0.0, p3=0.0, p4=0.0,
        s1=-by_r2 * math.sin(phi), s2=-by_r4 * math.sin(phi),
        s3=by_r2 * math.cos(phi), s4=by_r4 * math.cos(phi),
    )  # fmt: skip
    return exact(wide, InverseBrown) or wide


FORMAT = Format(
    name="asp_tsai",
    title="NASA Ames Stereo Pipeline pinhole camera (.tsai)",
    suffixes=(".tsai",),
    syntaxes=(Syntax.TEXT,),
    reference="https://stereopipeline.readthedocs.io/en/latest/pinholemodels.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(NoDistortion, BrownConrady, KannalaBrandt, FieldOfView)),
    needs_image_size=True,
)
