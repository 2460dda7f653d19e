"""The camera elements shared by the formats of Bentley's ContextCapture and iTwin Capture."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec import Struct

from calibrary.calibration import ImageSize, Intrinsics
from calibrary.distortion import BrownConrady, Distortion, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.convention import Convention, Native, Origin, Tangential
from calibrary.parsers.format import ReadContext

if TYPE_CHECKING:
    from lxml.etree import _Element

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    tangential=Tangential.SWAPPED,
    coefficients=("K1", "K2", "K3", "P1", "P2"),
    remarks=(
        "a focal length in mm is divided by SensorSize, the longer side's, over the longer side in pixels",
        "a principal point in mm counts from the sensor's middle",
    ),
)
AGREEMENT = 1e-4
"""Relative tolerance between two values of one focal length, for rounding."""
GROUPS = frozenset(("ImageDimensions", "PrincipalPoint", "Distortion"))
SQUARE_PIXELS = "AspectRatio was read as fy / fx, which Bentley does not say"


class PerspectiveCamera(Struct, frozen=True, kw_only=True):
    """The camera in the elements: K, the lens (None if not stated), and the assumptions made."""

    intrinsics: Intrinsics
    distortion: Distortion | None
    assumptions: tuple[str, ...]


def perspective_camera(element: _Element, context: ReadContext) -> PerspectiveCamera:
    """Read the camera of a <Photogroup> or an <OpticalProperties>.

    Raises:
        ParseError: an element is missing, duplicate or not a number.
        UnsupportedModelError: it is not a perspective camera, or it is rotated relative to its image.
    """
    fields = _Fields(element)
    fields.refuse_other_cameras()
    size = context.size(fields.size())
    pitch = fields.pitch_mm(size)
    focal = fields.focal_px(pitch)
    aspect = fields.number("AspectRatio", 1.0)
    x, y = fields.principal_point(size, pitch)
    native = Native(fx=focal, fy=focal * aspect, cx=x, cy=y)
    return PerspectiveCamera(
        intrinsics=CONVENTION.intrinsics(native, size),
        distortion=fields.distortion(),
        assumptions=(SQUARE_PIXELS,) if aspect != 1 else (),
    )


class _Fields:
    """Access to the texts of an element's children, and of theirs in the groups of numbers, by path."""

    def __init__(self, element: _Element) -> None:
        self.texts: dict[str, list[str]] = {}
        for child in element:
            tag = str(child.tag)
            self.texts.setdefault(tag, []).append(child.text or "")
            for inner in child if tag in GROUPS else ():
                self.texts.setdefault(f"{tag}/{inner.tag}", []).append(inner.text or "")

    def __contains__(self, path: str) -> bool:
        return path in self.texts

    def text(self, path: str) -> str:
        found = self.texts.get(path, ())
        if len(found) != 1:
            raise ParseError(f"<{path}> occurs {len(found)} times, expected once", place=path)
        return found[0].strip()

    def number(self, path: str, default: float | None = None) -> float:
        if default is not None and path not in self:
            return default
        return strict.number(self.text(path), place=path)

    def refuse_other_cameras(self) -> None:
        for path, wanted in (("CameraModelType", "Perspective"), ("CameraOrientation", "XRightYDown")):
            found = self.text(path) if path in self else wanted
            if found != wanted:
                raise UnsupportedModelError(
                    f"{path} is {strict.shown(found)}, which has no counterpart here; expected {wanted}",
                    place=path,
                )
        if self.number("Skew", 0.0):
            raise UnsupportedModelError("Skew is not 0, and Bentley does not say in which unit", place="Skew")

    def size(self) -> ImageSize | None:
        if "ImageDimensions" not in self:
            return None
        sides = (self.number(f"ImageDimensions/{side}") for side in ("Width", "Height"))
        return strict.image_size(*sides, place="ImageDimensions")

    def pitch_mm(self, size: ImageSize) -> float | None:
        """Pixel pitch in mm; None if the camera needs none."""
        if "PixelSize" in self:
            pitch = self.number("PixelSize")
        elif "SensorSize" in self:
            pitch = self.number("SensorSize") / max(size)
        else:
            return None
        if not pitch > 0:
            raise ParseError(
                f"the size of a pixel is {pitch:g} mm, expected a positive one", place="SensorSize"
            )
        return pitch

    def focal_px(self, pitch: float | None) -> float:
        """Focal length in px: FocalLengthPixels, else FocalLength ÷ pitch."""
        stated = [self.number("FocalLengthPixels")] if "FocalLengthPixels" in self else []
        if "FocalLength" in self and pitch is not None:
            stated.append(self.number("FocalLength") / pitch)
        if not stated:
            raise ParseError(
                "there is no <FocalLengthPixels>, and no <FocalLength> with a <SensorSize> or <PixelSize>",
                place="FocalLength",
            )
        if abs(stated[0] - stated[-1]) > AGREEMENT * abs(stated[0]):
            raise ParseError(
                f"FocalLengthPixels says {stated[0]:.6g} px, FocalLength over the pixel {stated[-1]:.6g} px; "
                "take the wrong one out",
                place="FocalLength",
            )
        return stated[0]

    def principal_point(self, size: ImageSize, pitch: float | None) -> tuple[float, float]:
        """Principal point in px from the centre of the top-left pixel; the image centre if not stated."""
        middle = ((size[0] - 1) / 2, (size[1] - 1) / 2)
        point = [path for path in ("x", "y", "X", "Y") if f"PrincipalPoint/{path}" in self]
        if point:
            names = ("X", "Y") if point[0].isupper() else ("x", "y")
            return self.number(f"PrincipalPoint/{names[0]}"), self.number(f"PrincipalPoint/{names[1]}")
        if "PrincipalPoint/xmm" not in self and "PrincipalPoint/ymm" not in self:
            return middle
        if pitch is None:
            raise ParseError(
                "it is in mm; expected <SensorSize> or <PixelSize> beside it", place="PrincipalPoint"
            )
        offsets = (self.number("PrincipalPoint/xmm") / pitch, self.number("PrincipalPoint/ymm") / pitch)
        return middle[0] + offsets[0], middle[1] + offsets[1]

    def distortion(self) -> Distortion | None:
        """The lens; None if the file does not state it, because its photos may be undistorted copies."""
        if "Distortion" not in self:
            return None
        k1, k2, k3, first, second = (
            self.number(f"Distortion/{name}", 0.0) for name in CONVENTION.coefficients
        )
        if not any((k1, k2, k3, first, second)):
            return NoDistortion()
        p1, p2 = CONVENTION.tangential_from_file(first, second)
        return BrownConrady(k1=k1, k2=k2, p1=p1, p2=p2, k3=k3)
