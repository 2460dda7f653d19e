"""Conversion of a calibration to the XMP tags that cameras use.

``Camera:`` is Pix4D's description (https://support.pix4d.com/hc/en-us/articles/360016450032): ModelType,
PrincipalPoint "cx,cy" in mm from the upper left, PerspectiveFocalLength in mm, PerspectiveDistortion
"R1,R2,R3,T1,T2", which are Brown's k1, k2, k3, p1, p2; PerspectiveFocalLengthUnits is MicaSense's. It has one focal
length for both axes. ``drone-dji:DewarpData`` is "date;fx,fy,cx,cy,k1,k2,p1,p2,k3" in px, the principal point
relative to the image centre; ``DewarpDataK6`` appends k4, k5, k6.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, Rational
from calibrary.errors import UnsupportedModelError
from calibrary.jobs.stamp.packet import Properties
from calibrary.parsers.fit import accepted_with, adapt, compare
from calibrary.parsers.format import Capacity, Fit, UnknownLens
from calibrary.parsers.imagery.xmp import NAMESPACES
from calibrary.records import replace

__all__ = ["REMOVED", "WORDS", "Tags", "camera_tags", "dji_tags"]

PIX4D: Final = "http://pix4d.com/camera/1.0"
DJI: Final = "http://www.dji.com/drone-dji/1.0/"

_DEWARP: Final = ("DewarpData", "DewarpDataK6")
_CAMERA: Final = (
    "ModelType",
    "PrincipalPoint",
    "PerspectiveFocalLength",
    "PerspectiveFocalLengthUnits",
    "PerspectiveDistortion",
    "FisheyePolynomial",
    "FisheyeAffineMatrix",
    "FisheyeAffineSymmetric",
)
REMOVED: Final = frozenset(
    f"{{{uri}}}{name}"
    for schema, names in (("drone-dji", _DEWARP), ("Camera", _CAMERA), ("sensefly", _CAMERA))
    for uri in NAMESPACES[schema]
    for name in names
)
"""Tags of an existing calibration, which are removed: two calibrations in one image would contradict each other."""
WORDS: Final = frozenset({b":DewarpData", b":PerspectiveFocalLength", b":FisheyeAffineMatrix"})

_DJI_HOLDS: Final = Capacity(models=(BrownConrady, Rational), unknown_lens=UnknownLens.NEVER)
_CAMERA_HOLDS: Final = Capacity(models=(BrownConrady,), unknown_lens=UnknownLens.STATED)


class Tags(Struct, frozen=True, kw_only=True):
    """Tags to be written into an image.

    Attributes:
        properties: by prefix, namespace and name.
        fit: how exactly they represent the calibration.
    """

    properties: Properties
    fit: Fit


def dji_tags(calibration: Calibration, *, max_error_px: float) -> Tags:
    """Make ``drone-dji:DewarpData`` or ``DewarpDataK6``.

    Raises:
        UnsupportedModelError: the tags do not represent the calibration to ``max_error_px``.
    """
    held = adapt(calibration, _DJI_HOLDS, max_error_px=max_error_px)
    K, lens = held.intrinsics, held.distortion
    width, height = K.image_size
    is_rational = isinstance(lens, Rational)
    order = ("k1", "k2", "p1", "p2", "k3", *(("k4", "k5", "k6") if is_rational else ()))
    terms = lens.coefficients if lens is not None else {}
    values = (K.fx, K.fy, K.cx - width / 2, K.cy - height / 2, *(terms[name] for name in order))
    day = calibration.provenance.date or ""
    name = _DEWARP[is_rational]
    return Tags(
        properties={("drone-dji", DJI, name): f"{day};{_number_list(*values)}"},
        fit=compare(calibration, held),
    )


def camera_tags(
    calibration: Calibration, px_per_mm: tuple[float, float] | None, *, max_error_px: float
) -> Tags:
    """Make the tags of Pix4D's perspective camera.

    Args:
        calibration: at the image size that the tags refer to.
        px_per_mm: at that image size, as readers use it to convert mm to px; None if unknown.
        max_error_px: largest allowed error anywhere in the image.

    Raises:
        UnsupportedModelError: the tags do not represent the calibration to ``max_error_px``.
    """
    if px_per_mm is None:
        raise UnsupportedModelError(
            "they count in mm, and neither the image (EXIF FocalPlaneXResolution) nor the catalogue states its pixel "
            "pitch"
        )
    held = adapt(calibration, _CAMERA_HOLDS, max_error_px=max_error_px)
    x, y = px_per_mm
    focal_mm = (held.intrinsics.fx / x + held.intrinsics.fy / y) / 2
    K = replace(held.intrinsics, fx=focal_mm * x, fy=focal_mm * y)
    fit = compare(calibration, replace(held, intrinsics=K))
    if fit.max_px > max_error_px:
        raise UnsupportedModelError(
            f"they have one focal length in mm, and fx / fy is not that of square pixels: projections are off by up "
            f"to {fit.max_px:.3g} px{accepted_with(fit.max_px)}"
        )
    texts: dict[str, str] = {
        "ModelType": "perspective",
        "PerspectiveFocalLength": _number_list(focal_mm),
        "PerspectiveFocalLengthUnits": "mm",
        "PrincipalPoint": _number_list(K.cx / x, K.cy / y),
    }
    if held.distortion is not None:
        terms = held.distortion.coefficients
        texts["PerspectiveDistortion"] = _number_list(
            *(terms[name] for name in ("k1", "k2", "k3", "p1", "p2"))
        )
    return Tags(properties={("Camera", PIX4D, name): text for name, text in texts.items()}, fit=fit)


def _number_list(*values: float) -> str:
    """Numbers with all digits and without an exponent, which not all readers of these tags accept."""
    return ",".join(np.format_float_positional(value + 0.0, trim="0") for value in values)
