"""A camera calibration and its conventions.

The canonical form:

* Image coordinates in pixels, x to the right, y down. **The origin is the outer corner of the top-left pixel.** The
  centre of that pixel is (0.5, 0.5), and the image centre is exactly (W/2, H/2). COLMAP, Metashape, Pix4D/OPF and DJI
  use this origin; with it, resizing an image scales fx, fy, cx and cy exactly. OpenCV, ROS, Kalibr and mrcal use the
  centre of the top-left pixel; :func:`canonical_from_file` converts between the two (half a pixel).
* Camera frame: x right, y down, z forward, as in OpenCV and COLMAP.
* ``K`` does not contain distortion: :class:`Intrinsics` holds fx, fy, cx, cy and skew, and a separate
  :class:`~calibrary.distortion.Distortion` holds the coefficients. ``distort`` maps undistorted to distorted
  coordinates, as in OpenCV.
* ``distortion=None`` means *unknown*; :class:`~calibrary.distortion.NoDistortion` means *known to be none*.
"""

from __future__ import annotations

import math
from enum import StrEnum
from functools import lru_cache
from typing import Annotated, Any, ClassVar, TypeAlias

from calibrary import kernel
from calibrary.arrays import ArrayLike, FloatArray, np
from calibrary.distortion import AnyDistortion, NoDistortion
from calibrary.distortion.base import as_rows, blocks, perspective, unit_rays
from calibrary.errors import FrameError, InputError, UnsupportedModelError
from calibrary.image_size import ImageSize, same_aspect
from calibrary.interop import colmap, opencv
from calibrary.interop.notebook import html_table
from calibrary.known_camera import CameraKey
from calibrary.probability import two_digits
from calibrary.provenance import Grade, Provenance, SourceFile, facts
from calibrary.quality import Covariance, Quality
from calibrary.records import Json, Meta, Record, force_setattr, from_json, replace, to_json

__all__ = [
    "Box",
    "Calibration",
    "CameraKey",
    "Covariance",
    "Grade",
    "ImageSize",
    "Intrinsics",
    "Origin",
    "Provenance",
    "Quality",
    "SourceFile",
    "canonical_from_file",
    "file_from_canonical",
]


CHUNK_ROWS = 1 << 18
"""Number of points projected per block, which bounds the temporary memory."""

_PINHOLE = NoDistortion()


class Calibration(Record):
    """The calibration of one camera: K, the distortion, and their origin.

    Attributes:
        camera: the camera, as far as the source states it.
        intrinsics: K.
        distortion: None when unknown.
        grade: origin of the intrinsics.
        quality: residuals and uncertainty, as far as the source states them.
        provenance: the source of the calibration.
        notes: remarks for the user.
        extras: further statements of the source file, by ``format/key``. Only the writer of that format uses them.

    >>> camera = calibrary.read("survey/DJI_0001.JPG")
    >>> camera.grade.value, camera.intrinsics.fx, camera.distortion.model
    ('calibrated', 3659.5, 'brown')
    """

    camera: CameraKey
    intrinsics: Intrinsics
    distortion: AnyDistortion | None = None
    grade: Grade
    quality: Quality | None = None
    provenance: Provenance
    notes: tuple[str, ...] = ()
    extras: tuple[tuple[str, str], ...] = ()

    SHORT: ClassVar[str] = "not good enough to be kept fixed"
    """What a note says behind the verdict of a calibration that is a start at most."""
    SHORT_BEFORE: ClassVar[str] = "not good enough to be approved"
    """The same in calibrations from when a start could not be approved."""

    @property
    def shortfall(self) -> str | None:
        """Verdict on a calibration that is a start at most, as its notes state it; None for any other."""
        said = (note.partition(": ") for note in self.notes)
        return next((verdict for verdict, _, text in said if text in {self.SHORT, self.SHORT_BEFORE}), None)

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        """Add K as a matrix, and write extras as a map."""
        document["extras"] = dict(self.extras)
        return _behind("intrinsics", {"K": self.intrinsics.rows}, document)

    @classmethod
    def _unwire(cls, document: dict[str, Json]) -> dict[str, Json]:
        """Remove K after checking that it is the matrix of the intrinsics."""
        if isinstance(extras := document.get("extras"), dict):
            document["extras"] = [[name, text] for name, text in extras.items()]
        stated, K = document.pop("K", None), document.get("intrinsics")
        if stated is not None and isinstance(K, dict):
            fx, skew, cx, fy, cy = (K.get(name, 0.0) for name in ("fx", "skew", "cx", "fy", "cy"))
            if stated != [[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]:
                raise InputError("K is not the matrix of the intrinsics", place="K")
        return document

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], _defs: dict[str, Any]) -> dict[str, Any]:
        members = schema["properties"]
        members["extras"] = {
            "type": "object",
            "additionalProperties": {"type": "string"},
            "description": members["extras"]["description"],
        }
        row = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
        matrix = {"type": "array", "items": row, "minItems": 3, "maxItems": 3}
        matrix["description"] = "the matrix of the intrinsics, in the same pixel origin"
        if "intrinsics" in schema["required"] and "distortion" in schema["required"]:
            schema["required"] = [*schema["required"], "K"]
        return schema | {"properties": _behind("intrinsics", {"K": matrix}, members)}

    @property
    def K(self) -> FloatArray:  # noqa: N802  the name of the matrix everywhere
        """The intrinsic matrix, (3, 3), in px from the outer corner of the top-left pixel, as in calibrary's own files.

        For ``cv2``, which counts from that pixel's centre, take the K of :meth:`to_opencv`.
        """
        return self.intrinsics.matrix

    @property
    def dist(self) -> FloatArray | None:
        """The distortion coefficients in OpenCV's order, as :meth:`to_opencv` returns them; None when unknown.

        Raises:
            UnsupportedModelError: OpenCV has no exactly equivalent model.
        """
        return opencv.coefficients_of(self.distortion) if self.distortion is not None else None

    def __repr__(self) -> str:
        K, lens = (
            self.intrinsics,
            self.distortion.model if self.distortion is not None else "unknown distortion",
        )
        numbers = " ".join(f"{name} {getattr(K, name):.2f}" for name in ("fx", "fy", "cx", "cy"))
        return f"<Calibration of {self.camera}: {numbers} px, {lens}, {self.grade.value}>"

    def to_dict(self) -> dict[str, Json]:
        """Return the calibration as plain data for JSON (schemas/calibration-1.schema.json)."""
        return to_json(self)

    @classmethod
    def from_dict(cls, document: object) -> Calibration:
        """Read a calibration that :meth:`to_dict` wrote.

        Raises:
            ParseError: the document is not valid; the message states the place.
        """
        return from_json(cls, document)

    def project(self, points: ArrayLike) -> FloatArray:
        """Project points from the camera frame into the image.

        Args:
            points: (N, 3), any unit; only the direction matters.

        Returns:
            (N, 2) px. NaN where the camera cannot see the point: behind a perspective camera, or beyond the radius up
            to which the distortion is monotonic. A calibration with unknown distortion projects as a pinhole.
        """
        rays = as_rows(points, 3)
        plan = plan_of(self.intrinsics, self.distortion) if kernel.compiled else None
        if plan is None:
            return self._projected(rays)
        px, left = kernel.project(plan, rays)
        if left:
            at = np.flatnonzero(np.isnan(px[:, 0]))
            px[at] = self._projected(rays[at])
        return px

    def _projected(self, rays: FloatArray) -> FloatArray:
        """:meth:`project` by the model's own formulas."""
        to_distorted = perspective if self.distortion is None else self.distortion.distort_rays
        K = self.intrinsics
        if len(rays) == 1:
            seen = (self.distortion or _PINHOLE).distort_ray(*rays[0].tolist())
            if seen is not None:
                x, y = seen
                return np.array([[K.fx * x + (K.skew * y + K.cx), K.fy * y + K.cy]])
        px = np.empty((len(rays), 2))
        for rows in blocks(len(rays), CHUNK_ROWS):
            x, y = to_distorted(rays[rows]).T
            # A very large finite coefficient (1e306) can overflow here; the pixel is then not finite, without a
            # warning.
            with np.errstate(over="ignore", invalid="ignore"):
                np.add(K.fx * x, K.skew * y + K.cx if K.skew else K.cx, out=px[rows, 0])
                np.add(K.fy * y, K.cy, out=px[rows, 1])
        return px

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Return the viewing directions of pixels.

        Args:
            pixels: (N, 2) px.

        Returns:
            (N, 3) unit vectors in the camera frame; NaN where no direction projects to that pixel.
        """
        px = as_rows(pixels, 2)
        plan = plan_of(self.intrinsics, self.distortion) if kernel.compiled else None
        if plan is None:
            return self._unprojected(px)
        rays, left = kernel.unproject(plan, px)
        if left:
            at = np.flatnonzero(np.isnan(rays[:, 0]))
            rays[at] = self._unprojected(px[at])
        return rays

    def _unprojected(self, px: FloatArray) -> FloatArray:
        """:meth:`unproject` by the model's own formulas."""
        K = self.intrinsics
        if len(px) == 1:
            [(x, y)] = px.tolist()
            y = (y - K.cy) / K.fy
            ray = (self.distortion or _PINHOLE).undistort_to_ray((x - K.cx - K.skew * y) / K.fx, y)
            if ray is not None:
                return np.array([ray])
        cast = unit_rays if self.distortion is None else self.distortion.undistort_to_rays
        rays = np.empty((len(px), 3))
        for rows in blocks(len(px), CHUNK_ROWS):
            xy = px[rows].copy()
            x, y = xy.T
            with np.errstate(over="ignore", invalid="ignore"):
                y -= K.cy
                y /= K.fy
                x -= K.cx
                if K.skew:
                    x -= K.skew * y
                x /= K.fx
            rays[rows] = cast(xy)
        return rays

    def scaled(self, size: ImageSize) -> Calibration:
        """Return the calibration for the image resized to ``size``, with all values in px scaled."""
        (w0, h0), intrinsics = self.intrinsics.image_size, self.intrinsics.scaled(size)
        w1, h1 = intrinsics.image_size
        return replace(
            self,
            intrinsics=intrinsics,
            camera=replace(self.camera, image_size=intrinsics.image_size),
            quality=self.quality.scaled(w1 / w0, h1 / h0) if self.quality is not None else None,
        )

    def cropped(self, box: Box) -> Calibration:
        """Return the calibration for a crop of the image; see :meth:`Intrinsics.cropped`."""
        cut = self.intrinsics.cropped(box)
        return replace(
            self,
            intrinsics=cut,
            camera=replace(self.camera, image_size=cut.image_size),
            # Where it is proven was measured about the middle of the whole image.
            quality=replace(self.quality, proven=None) if self.quality is not None else None,
        )

    def to_opencv(self) -> tuple[FloatArray, FloatArray | None]:
        """Return K and the distortion coefficients as ``cv2`` takes them.

        Returns:
            K, (3, 3), with the principal point relative to the centre of the top-left pixel; and the coefficients in
            OpenCV's order: five or more for a perspective lens, (4,) for ``cv2.fisheye``, None when the distortion is
            unknown.

        Raises:
            UnsupportedModelError: OpenCV has no exactly equivalent model, or K has skew, which OpenCV ignores.

        >>> camera = Calibration.from_opencv([[3650, 0, 2735.5], [0, 3650, 1823.5], [0, 0, 1]], image_size=(5472, 3648))
        >>> K, dist = camera.to_opencv()
        >>> float(K[0, 2]), camera.intrinsics.cx
        (2735.5, 2736.0)
        """
        K = self.intrinsics
        if K.skew:
            raise UnsupportedModelError(
                f"OpenCV's functions ignore skew, this K has {K.skew:g} px; use camera.project and camera.unproject"
            )
        matrix = K.matrix
        matrix[:2, 2] = file_from_canonical((K.cx, K.cy), Origin.PIXEL_CENTRE, K.image_size)
        return matrix, self.dist

    @classmethod
    def from_opencv(
        cls,
        K: ArrayLike,
        dist: ArrayLike | None = None,
        *,
        image_size: ImageSize,
        fisheye: bool = False,
        make: str | None = None,
        model: str | None = None,
        rms_px: float | None = None,
        grade: Grade = Grade.CALIBRATED,
    ) -> Calibration:
        """Make a calibration from the result of ``cv2.calibrateCamera`` or ``cv2.fisheye.calibrate``.

        Args:
            K: (3, 3), principal point relative to the centre of the top-left pixel.
            dist: 0, 4, 5, 8, 12 or 14 coefficients in OpenCV's order, 4 for a fisheye; None when unknown.
            image_size: (width, height) px.
            fisheye: whether the coefficients are those of ``cv2.fisheye``.
            make: camera make, as EXIF writes it.
            model: camera model, as EXIF writes it.
            rms_px: reprojection error (RMS) in px that OpenCV returned.
            grade: origin of the intrinsics.

        Raises:
            InputError: K is not an intrinsic matrix, or OpenCV has no model with this number of coefficients.

        >>> K = [[3650, 0, 2735.5], [0, 3650, 1823.5], [0, 0, 1]]
        >>> camera = Calibration.from_opencv(K, [-0.01, 0.02, 0, 0, 0], image_size=(5472, 3648), model="FC6310R")
        >>> camera.distortion.model
        'brown'
        """
        native = Intrinsics.from_matrix(K, image_size)
        cx, cy = canonical_from_file((native.cx, native.cy), Origin.PIXEL_CENTRE, native.image_size)
        return cls(
            camera=CameraKey(make=make, model=model, image_size=native.image_size),
            intrinsics=replace(native, cx=cx, cy=cy),
            distortion=opencv.lens_from(dist, fisheye=fisheye) if dist is not None else None,
            grade=grade,
            quality=Quality(rms_px=rms_px) if rms_px is not None else None,
            provenance=Provenance(kind="opencv"),
        )

    def to_colmap(self, model: str | None = None) -> colmap.ColmapCamera:
        """Return the camera in COLMAP's form.

        An unknown distortion becomes OPENCV with coefficients of zero, which bundle adjustment can find, and never
        PINHOLE, which has none; unless ``model`` says so.

        Args:
            model: preferred COLMAP model, used if it represents the calibration exactly; otherwise the simplest that
                does.

        Raises:
            UnsupportedModelError: COLMAP has no exactly equivalent model, or K has skew.

        >>> K = [[3650, 0, 2735.5], [0, 3650, 1823.5], [0, 0, 1]]
        >>> Calibration.from_opencv(K, [], image_size=(5472, 3648)).to_colmap()
        ColmapCamera(model='PINHOLE', width=5472, height=3648, params=(3650.0, 3650.0, 2736.0, 1824.0))
        >>> Calibration.from_opencv(K, image_size=(5472, 3648)).to_colmap().model
        'OPENCV'

        ``pycolmap.Camera(**camera.to_colmap()._asdict())`` is the same camera in COLMAP's own library.
        """
        K = self.intrinsics
        if K.skew:
            raise UnsupportedModelError(f"COLMAP's models have no skew, this K has {K.skew:g} px")
        lens = self.distortion
        if lens is None:
            lens, model = colmap.UNKNOWN_LENS, model or "OPENCV"
        held, coefficients = colmap.model_for(lens, one_focal=K.fx == K.fy, preferred=model)
        focals = (K.fx, K.fy)[: held.focals]
        return colmap.ColmapCamera(held.name, *K.image_size, (*focals, K.cx, K.cy, *coefficients))

    def _repr_html_(self) -> str:
        """Return the calibration as HTML, for notebooks."""
        K, quality = self.intrinsics, self.quality or Quality()
        rows = [(name, getattr(K, name), ".3f") for name in ("fx", "fy", "cx", "cy")]
        rows += [("skew", K.skew, ".3f")] if K.skew else []
        lens = self.distortion.shown if self.distortion is not None else {}
        rows += [(name, value, ".6g") for name, value in lens.items()]
        sigma = math.sqrt(quality.inflation)
        spread = {name: f" ± {two_digits(value * sigma)}" for name, value in quality.std.items()}
        return html_table(
            str(self.camera),
            [
                ("image", "{} × {} px".format(*K.image_size)),
                ("distortion", self.distortion.model if self.distortion is not None else "unknown"),
                *((name, f"{value:{form}}{spread.get(name, '')}") for name, value, form in rows),
                ("grade", self.grade.value),
                ("rms", f"{quality.rms_px:.3g} px" if quality.rms_px is not None else ""),
                *facts(self.provenance),
            ],
        )


@lru_cache(maxsize=256)
def plan_of(K: Intrinsics, lens: AnyDistortion | None) -> FloatArray | None:
    """Return a camera for the compiled code; None if its lens is not one of the maps there."""
    form = (lens or _PINHOLE).form()
    return kernel.planned(form, (K.fx, K.fy, K.cx, K.cy, K.skew)) if form is not None else None


def _behind(name: str, more: dict[str, Any], members: dict[str, Any]) -> dict[str, Any]:
    """Return ``members`` with ``more`` inserted after the member ``name``."""
    found: dict[str, Any] = {}
    for key, value in members.items():
        found[key] = value
        if key == name:
            found |= more
    return found


Box: TypeAlias = tuple[float, float, int, int]
"""(left, top, width, height) px, in the image to be cropped."""


class Intrinsics(Record, tag_field="pixel_origin", tag="corner"):
    """The parameters of K and the image size they refer to.

    Attributes:
        fx, fy: focal lengths in px, positive.
        cx, cy: principal point in px from the outer corner of the top-left pixel.
        skew: K[0, 1] in px; zero for every digital camera except scanners.
        image_size: (width, height) px.

    Raises:
        InputError: a parameter is not finite, or a focal length or a side of the image is not positive.

    >>> K = calibrary.Intrinsics(fx=3659.5, fy=3655.0, cx=2731.75, cy=1846.5, image_size=(5472, 3648))
    >>> K.scaled((2736, 1824)).fx
    1829.75
    """

    fx: Annotated[float, Meta(gt=0)]
    fy: Annotated[float, Meta(gt=0)]
    cx: float
    cy: float
    skew: float = 0.0
    image_size: ImageSize

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "cx", "cy", "skew"):
            given = getattr(self, name)
            if type(given) is not float:
                force_setattr(self, name, given := float(given))
            if not math.isfinite(given):
                raise InputError(f"{name} is {given}, expected a finite number of pixels")
        if self.fx <= 0 or self.fy <= 0:
            raise InputError(f"focal lengths are {self.fx:g} and {self.fy:g} px, expected positive ones")
        force_setattr(self, "image_size", _whole(self.image_size))

    @property
    def matrix(self) -> FloatArray:
        """K, (3, 3) float64, in the canonical pixel origin."""
        return np.array(self.rows)

    @property
    def rows(self) -> list[list[float]]:
        """K as three rows of numbers."""
        return [[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]]

    @classmethod
    def from_matrix(cls, matrix: ArrayLike, image_size: ImageSize) -> Intrinsics:
        """Make the intrinsics from a K in the canonical pixel origin.

        Args:
            matrix: (3, 3), upper triangular; it is divided by its element K[2, 2].
            image_size: (width, height) px of the image that K refers to.

        Raises:
            InputError: K has the wrong shape, is not finite, or is not an intrinsic matrix.
        """
        K = np.asarray(matrix, dtype=np.float64)
        if K.shape != (3, 3):
            raise InputError(f"K has shape {K.shape}, expected (3, 3)")
        if not np.isfinite(K).all():
            raise InputError("K contains NaN or infinity, expected nine finite numbers")
        if K[2, 2] == 0 or K[1, 0] != 0 or K[2, 0] != 0 or K[2, 1] != 0:
            raise InputError(f"K is not upper triangular with K[2, 2] ≠ 0: {K.tolist()}")
        K = K / K[2, 2]
        return cls(fx=K[0, 0], fy=K[1, 1], cx=K[0, 2], cy=K[1, 2], skew=K[0, 1], image_size=image_size)

    def scaled(self, size: ImageSize) -> Intrinsics:
        """Return the intrinsics for the image resized to ``size``.

        Raises:
            FrameError: the aspect ratios differ by more than 1 %, so ``size`` is a crop, not a resize.
            InputError: ``size`` is not two positive integers.
        """
        size = _whole(size)
        (w0, h0), (w1, h1) = self.image_size, size
        if not same_aspect(self.image_size, size):
            raise FrameError(
                f"a {w0}×{h0} frame cannot be scaled to {w1}×{h1}: their aspect ratios differ by over 1 %; "
                "crop it first"
            )
        sx, sy = w1 / w0, h1 / h0
        return Intrinsics(
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=self.cx * sx,
            cy=self.cy * sy,
            skew=self.skew * sx,
            image_size=size,
        )

    def cropped(self, box: Box) -> Intrinsics:
        """Return the intrinsics for the crop ``box`` = (left, top, width, height) of the image.

        Raises:
            FrameError: the box is empty or extends beyond the image.
        """
        left, top, width, height = box
        w0, h0 = self.image_size
        if width <= 0 or height <= 0 or left < 0 or top < 0 or left + width > w0 or top + height > h0:
            raise FrameError(
                f"a {w0}×{h0} frame has no part {width}×{height} at ({left:g}, {top:g}); "
                "expected a box inside the frame"
            )
        return replace(self, cx=self.cx - left, cy=self.cy - top, image_size=(width, height))


def _whole(size: ImageSize) -> ImageSize:
    """Return ``size`` as two ints; raise InputError if it is not an image size."""
    width, height = size
    if not (math.isfinite(width) and math.isfinite(height)) or width % 1 or height % 1 or min(size) <= 0:
        raise InputError(f"image size is {width}×{height}, expected whole positive numbers of pixels")
    return int(width), int(height)


class Origin(StrEnum):
    """Pixel origin of a principal point; the value is the phrase used in messages and reports."""

    CORNER = "the outer corner of the top-left pixel"
    PIXEL_CENTRE = "the centre of the top-left pixel"
    IMAGE_CENTRE = "the middle of the image"
    FIRST_IS_ONE = "the centre of the top-left pixel, which is (1, 1)"


def canonical_from_file(
    point: tuple[float, float], origin: Origin, image_size: tuple[int, int]
) -> tuple[float, float]:
    """Convert a principal point, (x, y) px with y down, from a file's origin to the canonical one."""
    dx, dy = _offset(origin, image_size)
    return point[0] + dx, point[1] + dy


def file_from_canonical(
    point: tuple[float, float], origin: Origin, image_size: tuple[int, int]
) -> tuple[float, float]:
    """Convert a principal point, (x, y) px, from the canonical origin to a file's origin."""
    dx, dy = _offset(origin, image_size)
    return point[0] - dx, point[1] - dy


def _offset(origin: Origin, image_size: tuple[int, int]) -> tuple[float, float]:
    """Return the file's origin in canonical coordinates, (x, y) px."""
    if origin is Origin.CORNER:
        return 0.0, 0.0
    if origin is Origin.PIXEL_CENTRE:
        return 0.5, 0.5
    if origin is Origin.FIRST_IS_ONE:
        return -0.5, -0.5
    return image_size[0] / 2, image_size[1] / 2
