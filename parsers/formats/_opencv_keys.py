"""Meanings of the keys of an OpenCV file; programs use different spellings."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from functools import lru_cache

from calibrary.calibration import Grade, ImageSize, Quality
from calibrary.errors import UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.document import Node
from calibrary.parsers.formats import _file_storage as storage

# Keys are compared in lower case without "_", "-", "." and spaces.
MATRIX_KEYS = (
    "cameramatrix", "cameramat", "cameramtx", "cammatrix", "cammtx", "intrinsicmatrix", "intrinsics", "intrinsic",
    "kmatrix", "matrix", "mtx", "k", "m", "intrinsicsmatrix", "intrinsicmat", "intrinsicparameters",
    "calibrationmatrix", "kmat", "kmtx", "cameraintrinsicmatrix", "cameraintrinsics", "cameraintrinsic", "intrinsicmtx",
)  # fmt: skip
COEFFICIENT_KEYS = (
    "distortioncoefficients", "distortioncoeffs", "distortioncoeff", "distcoefficients", "distcoeffs", "distcoeff",
    "distcoef", "distcoefs", "distcoefficient", "distortions", "distortion", "dist", "d", "distortioncoefficient",
    "distortioncoefs", "distortioncoef", "distortionvector", "distortionparameters", "distortionparams", "distparams",
    "distvec", "distortionmatrix", "cameradistortion", "camdist", "kc",
)  # fmt: skip
OWN_KEYS = frozenset({("cameramatrix", "distortioncoefficients"), ("m", "d")})
"""Keys of OpenCV's calibration and stereo samples; their coefficients are Brown's unless stated otherwise."""
GRADE_KEY = "calibrary_grade"
"""Key added by calibrary, so that a derived K is not read back as a calibrated one."""
SIZE_KEYS = (
    ("imagewidth", "imageheight"), ("imgwidth", "imgheight"), ("width", "height"), ("w", "h"), ("cols", "rows"),
    ("imgw", "imgh"), ("imagew", "imageh"), ("framewidth", "frameheight"), ("camerawidth", "cameraheight"),
    ("resolutionx", "resolutiony"), ("resolutionwidth", "resolutionheight"), ("xresolution", "yresolution"),
)  # fmt: skip
SIZE_LISTS = (
    "imagesize",
    "imgsize",
    "resolution",
    "imageresolution",
    "framesize",
    "size",
    "dim",
    "imagedim",
    "camerasize",
)
SHAPES = ("imageshape", "imgshape", "shape", "frameshape")
"""Lists of rows, columns and perhaps channels, as numpy has them."""
FOREIGN_KEYS = frozenset(
    {"calib_time", "camera_model", "distortion_model", "model_type", "projection_matrix", "sensor_type"}
)
"""Keys of programs that use OpenCV's container or its keys with another meaning."""
MODEL_KEYS = (
    "distortionmodel",
    "distortiontype",
    "lensmodel",
    "lenstype",
    "model",
    "cameramodel",
    "type",
    "cameratype",
)
BROWN_WORDS = frozenset({
    "plumbbob", "radtan", "radialtangential", "brown", "brownconrady", "opencv", "pinhole", "perspective", "standard",
    "rational", "rationalpolynomial",
})  # fmt: skip
FISHEYE_WORDS = frozenset({
    "fisheye", "equidistant", "kannalabrandt", "opencvfisheye", "kb", "kb4", "pinholefisheye", "fisheyeopencv",
})  # fmt: skip
METASHAPE_SPELLING = frozenset({"Camera_Matrix", "image_Width"})

_LABELLED = r"(left|right|cam\d+|camera\d+)?({})(left|right|l|r|\d+)?"
MATRIX = re.compile(_LABELLED.format("|".join(MATRIX_KEYS)))
COEFFICIENTS = re.compile(_LABELLED.format("|".join(COEFFICIENT_KEYS)))
MIRROR = re.compile(_LABELLED.format("xi"))


_SEPARATORS = re.compile(r"[_\-. ]")


@lru_cache(maxsize=4096)
def simplified(key: str) -> str:
    """Normalise a key: "Camera_Matrix", "cameraMatrix" and "camera-matrix" become equal."""
    return _SEPARATORS.sub("", key).lower()


def is_fisheye(simple: Mapping[str, str], tree: Node) -> bool | None:
    """Whether a file names cv2.fisheye's model; None if it names neither that nor OpenCV's other one.

    Args:
        simple: its keys, by their simplified form.
        tree: the file.

    Raises:
        UnsupportedModelError: the distortion's model is another one.
    """
    for name in MODEL_KEYS:
        word = tree[simple[name]].value if name in simple else None
        if isinstance(word, str) and (found := simplified(word)) in BROWN_WORDS | FISHEYE_WORDS:
            return found in FISHEYE_WORDS
        if isinstance(word, str) and name in MODEL_KEYS[:2]:
            raise UnsupportedModelError(
                f"the distortion's model is {strict.shown(word)}, which is not known here; expected that of OpenCV "
                "(plumb_bob, radtan) or of cv2.fisheye (fisheye, equidistant)",
                source=tree.source,
                place=simple[name],
            )
    return None


class Keys:
    """The keys of a file with their meanings; each key is used only once."""

    def __init__(self, tree: Node) -> None:
        self.tree = tree
        self.matrices: dict[str, str] = {}
        self.coefficients: dict[str, str] = {}
        self.mirrors: dict[str, str] = {}
        self.simple: dict[str, str] = {}
        for key, node in tree.entries():
            self.simple.setdefault(simplified(key), key)
            for pattern, found in self._kinds(node):
                match = pattern.fullmatch(simplified(key))
                if match:
                    label = match[1] or match[3] or ""
                    if label in found:
                        node.fail(
                            f"it means the same as {strict.shown(found[label])}, which is stated as well"
                        )
                    found[label] = key
        self.used = {*self.matrices.values(), *self.coefficients.values(), *self.mirrors.values()}

    def _kinds(self, node: Node) -> Iterator[tuple[re.Pattern[str], dict[str, str]]]:
        """Possible meanings of an entry according to its value; omnidir's xi is a number, or a 1×1 matrix."""
        yield MIRROR, self.mirrors
        if isinstance(node.value, dict | list):
            yield MATRIX, self.matrices
            yield COEFFICIENTS, self.coefficients

    def take(self, simple: str) -> Node | None:
        """The value of a key that has a single meaning in the whole file."""
        key = self.simple.get(simple)
        if key is None:
            return None
        self.used.add(key)
        return self.tree[key]

    def size(self) -> ImageSize | None:
        """The image size of the file."""
        for width, height in SIZE_KEYS:
            if width in self.simple and height in self.simple:
                sides = [self.take(name) for name in (width, height)]
                w, h = (side.number() for side in sides if side is not None)
                return strict.image_size(w, h, source=self.tree.source)
        both = next((node for name in SIZE_LISTS if (node := self._pair(name)) is not None), None)
        if both is not None:
            return strict.image_size(*storage.numbers(both), source=both.source, place=both.place)
        shape = next((node for name in SHAPES if (node := self._pair(name, (2, 3))) is not None), None)
        return None if shape is None else self._of_shape(shape)

    def _pair(self, name: str, lengths: tuple[int, ...] = (2,)) -> Node | None:
        """The value of a key if it is a list of so many numbers; that of an image size must be two."""
        value = self.tree[self.simple[name]] if name in self.simple else None
        if value is None or not isinstance(value.value, dict | list):
            return None
        numbers = storage.numbers(value)
        if len(numbers) in lengths:
            return self.take(name)
        if name in SIZE_LISTS[:2]:
            value.fail(f"{len(numbers)} numbers, expected width and height")
        return None

    def _of_shape(self, node: Node) -> ImageSize:
        """Width and height out of numpy's rows and columns, or the other way round where K says so.

        Raises:
            ParseError: the principal point does not tell which is the width.
        """
        rows, columns = storage.numbers(node)[:2]
        centres = [storage.numbers(self.tree[key]) for key in self.matrices.values()]
        near = [
            sum(abs(K[2] - w / 2) + abs(K[5] - h / 2) for K in centres if len(K) == 9)
            for w, h in ((columns, rows), (rows, columns))
        ]
        if rows != columns and not near[0] * 2 < near[1]:
            if not near[1] * 2 < near[0]:
                node.fail(
                    "rows and columns, or width and height: K does not tell which; give --image-size WxH"
                )
            rows, columns = columns, rows
        return strict.image_size(columns, rows, source=node.source, place=node.place)

    def quality(self) -> Quality | None:
        """The RMS reprojection error and the number of views, as OpenCV's samples write them."""
        rms = self.take("avgreprojectionerror") or self._root_mean_square()
        views = self.take("nframes") or self.take("nrofframes")
        if rms is None and views is None:
            return None
        for node in (rms, views):
            if node is not None and node.number() < 0:
                node.fail(f"{node.number():g} is less than nothing, expected a number from 0")
        return Quality(
            rms_px=rms.number() if rms is not None else None,
            views=views.whole() if views is not None else None,
        )

    def _root_mean_square(self) -> Node | None:
        """The return value of cv2.calibrateCamera, under the names from OpenCV's Python tutorial."""
        for simple in ("rms", "ret"):
            value = self.tree[self.simple[simple]].value if simple in self.simple else None
            if isinstance(value, int | float) and not isinstance(value, bool):
                return self.take(simple)
        return None

    def date(self) -> str | None:
        """Date of the calibration, as written in the file."""
        node = self.take("calibrationtime")
        return None if node is None else str(node.value).strip()

    def grade(self) -> Grade:
        """The grade: calibrated, unless a file written by calibrary states another."""
        node = self.take(simplified(GRADE_KEY))
        if node is None:
            return Grade.CALIBRATED
        if node.text() not in list(Grade):
            node.fail(f"{strict.shown(node.text())} is not a grade, expected one of {', '.join(Grade)}")
        return Grade(node.text())

    def fisheye_mark(self) -> bool | None:
        """Whether the file states a fisheye; None if it states nothing."""
        node = self.take("fisheyemodel")
        if node is None:
            return is_fisheye(self.simple, self.tree)
        return bool(node.value if isinstance(node.value, bool) else node.whole())

    def are_own(self, label: str) -> bool:
        """Whether a matrix and its coefficients have the keys of OpenCV's own samples."""
        names = [
            match[2]
            for pattern, key in ((MATRIX, self.matrices[label]), (COEFFICIENTS, self.coefficients[label]))
            if (match := pattern.fullmatch(simplified(key)))
        ]
        return tuple(names) in OWN_KEYS

    def extras(self, prefix: str) -> tuple[tuple[str, str], ...]:
        """All other keys, as JSON."""
        self.fisheye_mark()
        return tuple(
            (prefix + key, json.dumps(node.value, ensure_ascii=False))
            for key, node in self.tree.entries()
            if key not in self.used
        )
