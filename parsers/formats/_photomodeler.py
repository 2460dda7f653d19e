"""PhotoModeler's camera model, shared by its report and its export.

Xp and Yp are in mm from the top-left corner of a sensor format of Fw × Fh mm, which covers the whole image.
With x and y measured from there in mm, *y up*, and r² = x² + y², the corrected point is::

    x + x·(K1·r² + K2·r⁴ + K3·r⁶) + P1·(r² + 2x²) + 2·P2·x·y
    y + y·(K1·r² + K2·r⁴ + K3·r⁶) + P2·(r² + 2y²) + 2·P1·x·y

so a barrel has K1 > 0.

Sources: PhotoModeler help, "Lens distortion formulation"; E. Welty's glimpse, ``convert/photomodeler.py``.
"""

from __future__ import annotations

from collections.abc import Mapping

from calibrary.calibration import ImageSize, Intrinsics
from calibrary.distortion import Distortion, InverseBrown, NoDistortion
from calibrary.errors import ParseError
from calibrary.parsers.convention import Convention, Direction, Native, Origin, Tangential, Unit
from calibrary.parsers.formats._metric_lens import normalised

LENS = ("K1", "K2", "K3", "P1", "P2")
PARAMETERS = ("F", "Xp", "Yp", "Fw", "Fh", *LENS)

CONVENTION = Convention(
    unit=Unit.MILLIMETRE,
    origin=Origin.CORNER,
    direction=Direction.DISTORTED_TO_UNDISTORTED,
    tangential=Tangential.SWAPPED,
    coefficients=LENS,
    remarks=("Xp and Yp count y down, the lens terms count it up",),
)


def optics(values: Mapping[str, float], size: ImageSize, *, source: str) -> tuple[Intrinsics, Distortion]:
    """K and distortion from the ten parameters.

    Raises:
        ParseError: the parameters are not a valid camera.
    """
    focal, width, height = values["F"], values["Fw"], values["Fh"]
    if not (width > 0 and height > 0):
        raise ParseError(f"the format is {width:g}×{height:g} mm, expected a positive one", source=source)
    native = Native(fx=focal, fy=focal, cx=values["Xp"], cy=values["Yp"])
    K = CONVENTION.intrinsics(native, size, sensor_mm=(width, height), source=source)
    if not any(values[key] for key in LENS):
        return K, NoDistortion()
    k1, k2, k3 = normalised([values[key] for key in ("K1", "K2", "K3")], focal)
    # y points up here, so P2, which corresponds to OpenCV's p1, changes its sign.
    return K, InverseBrown(k1=k1, k2=k2, k3=k3, p1=-values["P2"] * focal, p2=values["P1"] * focal)
