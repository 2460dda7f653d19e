"""``Calib_Results.m`` of Bouguet's Camera Calibration Toolbox for MATLAB.

In the format's own words::

    %-- Focal length:
    fc = [ 3650.1 ; 3648.7 ];
    %-- Principal point:
    cc = [ 2740.8 ; 1815.4 ];
    %-- Skew coefficient:
    alpha_c = 0.0;
    %-- Distortion coefficients:
    kc = [ -0.11 ; 0.02 ; -0.0004 ; 0.0008 ; -0.006 ];      % k1 k2 p1 p2 k3
    fc_error = [ 1.8 ; 1.8 ];                               % three standard deviations
    nx = 5472;
    ny = 3648;

with u = fc1·(x' + alpha_c·y') + cc1, so that K's skew is fc1·alpha_c; pixels count from 0 at the centre of the first
one. It is a script, but calibrary reads only its assignments of numbers and runs nothing. The toolbox's fisheye
calibration fills the same file with four coefficients of another model, as its oldest versions did with k1 k2 p1 p2:
nothing distinguishes them, so calibrary asks about four that are not zero.

Source: J.-Y. Bouguet, "Camera Calibration Toolbox for Matlab", Description of the calibration parameters.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from calibrary.calibration import Calibration, ImageSize, Origin, Quality
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt, NoDistortion
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native
from calibrary.parsers.format import Format, Option, ReadContext, Sniff, Sure
from calibrary.parsers.formats._text_rows import text_of

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3"),
    remarks=("the skew is alpha_c·fx", "uncertainties are three standard deviations"),
)
DISTORTION = Option(
    name="distortion",
    values=("brown", "fisheye"),
    meaning="whether four coefficients are Brown's k1 k2 p1 p2 or the fisheye calibration's k1 k2 k3 k4",
)
MAX_BYTES = 2 * 1024 * 1024
"""The poses of a thousand photographs stand in the file as well."""
SIGMAS = 3.0
WANTED = frozenset(("fc", "cc", "alpha_c", "kc", "fc_error", "cc_error", "kc_error", "nx", "ny", "n_ima"))

_ASSIGNMENT = re.compile(
    r"(?<!\w)([A-Za-z]\w{0,60})[ \t]{0,8}=[ \t]{0,8}(\[[^\[\]=]{0,2000}\]|[^\s;=\[\]]{1,100})[ \t]{0,8};"
)
_BETWEEN = re.compile(r"[\s;,]+")
_FC = re.compile(r"^[ \t]{0,8}fc\s{0,8}=\s{0,8}\[", re.MULTILINE)
_KC = re.compile(r"^[ \t]{0,8}kc\s{0,8}=\s{0,8}\[", re.MULTILINE)


def sniff(content: Content) -> Sniff | None:
    """The toolbox's own names, assigned as vectors."""
    text = content.text or ""
    if _FC.search(text) and (
        "Calib_Results" in text or "Extrinsic Camera Parameters" in text or _KC.search(text)
    ):
        return Sniff(Sure.MAGIC, "it assigns fc = [ … ], as Bouguet's toolbox does")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the script."""
    return [camera_of(_values(data), context)]


def camera_of(values: Mapping[str, str], context: ReadContext) -> Calibration:
    """The camera of the toolbox's variables, each as its numbers in MATLAB's own writing."""
    fx, fy = _vector(values, "fc", 2)
    cx, cy = _vector(values, "cc", 2)
    [alpha] = _vector(values, "alpha_c", 1) if "alpha_c" in values else (0.0,)
    distortion = _lens(_vector(values, "kc", (4, 5, 6)), context)
    size = context.size(_size(values))
    native = Native(fx=fx, fy=fy, cx=cx, cy=cy, skew=fx * alpha)
    return context.calibration(
        CONVENTION.intrinsics(native, size), distortion, quality=_quality(values, distortion)
    )


def _values(data: bytes) -> dict[str, str]:
    """What the script assigns to the names that matter; a closing semicolon proves each complete."""
    script = text_of(data, most=MAX_BYTES)
    text = "\n".join(row.partition("%")[0] for row in script.splitlines())
    values: dict[str, str] = {}
    for found in _ASSIGNMENT.finditer(text):
        name = found[1]
        if name not in WANTED:
            continue
        if name in values:
            raise ParseError("it is assigned twice", place=name)
        values[name] = _BETWEEN.sub(" ", found[2].strip("[]")).strip()
    return values


def _vector(values: Mapping[str, str], name: str, count: int | tuple[int, ...]) -> tuple[float, ...]:
    if name not in values:
        raise ParseError(f"it does not assign {name}, or the file is cut short there")
    return strict.numbers(values[name], count=count, place=name)


def _lens(kc: tuple[float, ...], context: ReadContext) -> Distortion:
    if len(kc) == 6:
        if kc[5]:
            raise ParseError(f"a sixth coefficient, {kc[5]:g}, is not one of the toolbox's", place="kc")
        kc = kc[:5]
    asked = context.option(DISTORTION.name)
    if asked == "fisheye":
        if len(kc) != 4:
            raise ParseError(f"{len(kc)} coefficients of a fisheye, expected 4", place="kc")
        return KannalaBrandt(k1=kc[0], k2=kc[1], k3=kc[2], k4=kc[3])
    if len(kc) == 4 and asked is None:
        raise ParseError(
            "four coefficients are k1 k2 p1 p2 of an old version or k1 k2 k3 k4 of a fisheye calibration; say which "
            "with --set distortion=brown or distortion=fisheye",
            place="kc",
        )
    if not any(kc):
        return NoDistortion()
    return BrownConrady(**dict(zip(("k1", "k2", "p1", "p2", "k3"), kc, strict=False)))


def _size(values: Mapping[str, str]) -> ImageSize | None:
    if "nx" not in values and "ny" not in values:
        return None
    [width], [height] = (_vector(values, name, 1) for name in ("nx", "ny"))
    return strict.image_size(width, height, place="nx, ny")


def _quality(values: Mapping[str, str], distortion: Distortion) -> Quality | None:
    """One standard deviation of each; where something was held fixed, MATLAB writes NaN or nothing."""
    std: dict[str, float] = {}
    for key, names in (
        ("fc_error", ("fx", "fy")),
        ("cc_error", ("cx", "cy")),
        ("kc_error", distortion.names()),
    ):
        for name, text in zip(names, values.get(key, "").split(), strict=False):
            try:
                [error] = strict.numbers(text, count=1)
            except ParseError:
                continue
            std |= {name: error / SIGMAS} if error > 0 else {}
    try:
        views = strict.whole(values.get("n_ima", ""))
    except ParseError:
        views = None
    return Quality(std=std, views=views) if std or views else None


FORMAT = Format(
    name="bouguet_m",
    title="Calib_Results.m of Bouguet's toolbox",
    suffixes=(".m",),
    syntaxes=(Syntax.TEXT,),
    reference="https://data.caltech.edu/records/jx9cx-fdh55",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    options=(DISTORTION,),
)
