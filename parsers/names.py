"""Names that people and programs give to the numbers of a camera: one list, in whatever file they stand.

Keys are compared in lower case without ``_``, ``-``, ``.`` and spaces (:func:`simplified`).
"""

from __future__ import annotations

import re
from enum import Enum
from functools import lru_cache
from typing import Final

from calibrary.records import Json

MATRICES: Final = (
    "cameramatrix", "cameramat", "cameramtx", "cammatrix", "cammtx", "intrinsicmatrix", "intrinsics", "intrinsic",
    "kmatrix", "matrix", "mtx", "k", "m", "intrinsicsmatrix", "intrinsicmat", "intrinsicparameters",
    "calibrationmatrix", "kmat", "kmtx", "cameraintrinsicmatrix", "cameraintrinsics", "cameraintrinsic", "intrinsicmtx",
    "camk",
)  # fmt: skip
"""Of a camera matrix, the most telling first."""
FOCALS: Final = (
    ("fx", "fy"), ("focalx", "focaly"), ("focallengthx", "focallengthy"), ("flx", "fly"), ("fu", "fv"),
    ("alphax", "alphay"), ("camerafx", "camerafy"), ("camfx", "camfy"), ("xfocallength", "yfocallength"),
    ("xfocal", "yfocal"),
)  # fmt: skip
CENTRES: Final = (
    ("cx", "cy"), ("ppx", "ppy"), ("principalpointx", "principalpointy"), ("centerx", "centery"),
    ("centrex", "centrey"), ("u0", "v0"), ("cu", "cv"), ("px", "py"), ("cameracx", "cameracy"), ("camcx", "camcy"),
    ("opticalcenterx", "opticalcentery"), ("xcenter", "ycenter"), ("xprincipalpoint", "yprincipalpoint"), ("x0", "y0"),
    ("principalx", "principaly"),
)  # fmt: skip
ONE_FOCAL: Final = (
    "focallength", "f", "fc", "focal", "focallengthpx", "calibratedfocallength", "cameraconstant", "principaldistance",
    "focallengths",
)  # fmt: skip
"""Of one focal length, or of both in a list."""
ONE_CENTRE: Final = ("principalpoint", "c", "cc", "pp", "center", "centre", "opticalcenter", "imagecenter")
"""Of both numbers of a principal point."""
SKEWS: Final = ("skew", "s", "alphac", "cameraskew", "skewpx")
COEFFICIENTS: Final = (
    "distortioncoefficients", "distortioncoeffs", "distortioncoeff", "distcoefficients", "distcoeffs", "distcoeff",
    "distcoef", "distcoefs", "distcoefficient", "distortions", "distortion", "dist", "d", "distortioncoefficient",
    "distortioncoefs", "distortioncoef", "distortionvector", "distortionparameters", "distortionparams", "distparams",
    "distvec", "distortionmatrix", "cameradistortion", "camdist", "kc", "coeffs", "coefficients", "coefs",
)  # fmt: skip
"""Of a vector of coefficients."""
RADIAL: Final = (
    "radial",
    "radialdistortion",
    "radialcoefficients",
    "radialcoeffs",
    "radialdistortioncoefficients",
)
TANGENTIAL: Final = (
    "tangential", "tangentialdistortion", "tangentialcoefficients", "tangentialcoeffs",
    "tangentialdistortioncoefficients",
)  # fmt: skip
SIZE_PAIRS: Final = (
    ("imagewidth", "imageheight"), ("imgwidth", "imgheight"), ("width", "height"), ("w", "h"), ("cols", "rows"),
    ("imgw", "imgh"), ("imagew", "imageh"), ("framewidth", "frameheight"), ("camerawidth", "cameraheight"),
    ("resolutionx", "resolutiony"), ("resolutionwidth", "resolutionheight"), ("xresolution", "yresolution"),
    ("camwidth", "camheight"), ("columns", "rows"), ("sizex", "sizey"), ("imagecols", "imagerows"), ("nx", "ny"),
    ("ncols", "nrows"), ("resx", "resy"),
)  # fmt: skip
"""Of an image's width and its height in px."""
SIZE_LISTS: Final = (
    "imagesize", "imgsize", "resolution", "imageresolution", "framesize", "size", "dim", "imagedim", "camerasize",
    "dims", "imagedims", "dimensions", "imagedimensions", "widthheight", "wh", "sensorresolution", "videosize",
)  # fmt: skip
"""Of width and height in one value."""
SHAPES: Final = (
    "imageshape", "imgshape", "shape", "frameshape", "heightwidth", "hw", "rowscols", "imageheightwidth", "imagehw",
    "sizehw", "resolutionhw",
)  # fmt: skip
"""Of rows, columns and perhaps channels, as numpy has them."""
MODELS: Final = (
    "distortionmodel", "distortiontype", "lensmodel", "lenstype", "model", "cameramodel", "type", "cameratype",
    "projectionmodel", "cammodel", "calibrationmodel", "distortionname", "modeltype",
)  # fmt: skip
"""Of the word for a lens; the first two are of its distortion alone."""
OF_DISTORTION: Final = frozenset(MODELS[:2])


class Family(Enum):
    """How coefficients are to be taken; in OpenCV's own family their number says which model they are of."""

    OPENCV = "OpenCV's models of a perspective lens"
    FISHEYE = "cv2.fisheye's model"
    OMNI = "cv2.omnidir's model"
    NONE = "no distortion"
    OTHER = "a model that has none of these coefficients"


LENSES: Final = {
    Family.OPENCV: (
        "plumbbob radtan radialtangential brown brownconrady opencv fullopencv pinhole perspective standard rational "
        "rationalpolynomial pinholeradtan radialtangential8 thinprism tilted radial generic perspectivebrown "
        "polynomial opencv5 opencv8 distortedpinhole rectilinear"
    ),
    Family.FISHEYE: (
        "fisheye equidistant kannalabrandt kannalabrandt4 opencvfisheye kb kb4 pinholefisheye fisheyeopencv equi "
        "pinholeequi pinholeequidistant cv2fisheye equidistantcamera"
    ),
    Family.OMNI: "omni omnidir mei omnidirectional cv2omnidir unified",
    Family.OTHER: (
        "ds doublesphere eucm ucm enhancedunified fov atan division scaramuzza ocam ocamcalib taylor splined cahvor "
        "inversebrownconrady ftheta extendedunified"
    ),
    Family.NONE: "none nodistortion undistorted rectified distortionnone",
}
"""Words for a lens: the same in every file."""
_FAMILIES = {word: family for family, words in LENSES.items() for word in words.split()}
OWN: Final = {
    "BrownConrady": frozenset({"brown", "brownconrady", "plumbbob", "radtan"}),
    "KannalaBrandt": frozenset(LENSES[Family.FISHEYE].split()),
}
"""Words that no other lens has, by its class: RealSense's inverse Brown-Conrady is another."""
LENS: Final = re.compile(
    r"(?i)fish.?eye|equidist|kannala|\bkb\d?\b|rad.?tan|plumb|brown|rational|thin.?prism|tilted|omni|\bmei\b|scaramuzza"
    r"|ocam|division|\bfov\b|double.?sphere|\beucm\b|full.?opencv|taylor"
)
"""What tells in any text that it names a lens."""

RADIAL_FIRST: Final = ("k1", "k2", "k3", "p1", "p2")
"""The order of MATLAB and of photogrammetry, for coefficients that OpenCV orders k1 k2 p1 p2 k3."""

_LABELLED = r"(left|right|proj|projector|cam\d+|camera\d+)?({})(left|right|l|r|\d+)?"
MATRIX: Final = re.compile(_LABELLED.format("|".join(MATRICES)))
"""A key of a camera matrix, with what tells it from those of other cameras."""
VECTOR: Final = re.compile(_LABELLED.format("|".join(COEFFICIENTS)))
MIRROR: Final = re.compile(_LABELLED.format("xi"))

_SEPARATORS = re.compile(r"[_\-. ]")
_NUMBER = r"(\d{1,7}(?:\.0*)?)"
_SIZE = re.compile(
    rf"[\[({{\s]*{_NUMBER}(?:\s*px)?\s*(?:[x×*,;/X]|\bby\b|\s)\s*{_NUMBER}(?:\s*[,;x×]\s*\d)?(?:\s*px)?[\])}}\s]*"
)


@lru_cache(maxsize=4096)
def simplified(key: str) -> str:
    """Normalise a key: "Camera_Matrix", "cameraMatrix" and "camera-matrix" become equal."""
    return _SEPARATORS.sub("", key).lower()


def family(word: str) -> Family | None:
    """The family of lenses that a word names; None for a word that is not known."""
    return _FAMILIES.get(simplified(word))


def sides(value: Json) -> tuple[float, float] | None:
    """The two numbers of an image size in one value: a list, or "1280x720", "[640 480]", "1280 × 720 px".

    Of three numbers the last is numpy's count of channels. None if it is no such value.
    """
    if isinstance(value, str):
        found = _SIZE.fullmatch(value)
        return None if found is None else (float(found[1]), float(found[2]))
    if not isinstance(value, list) or len(value) not in {2, 3}:
        return None
    numbers = [float(one) for one in value if isinstance(one, int | float) and not isinstance(one, bool)]
    return (numbers[0], numbers[1]) if len(numbers) == len(value) else None
