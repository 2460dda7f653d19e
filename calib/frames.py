"""Reading of calibration images as stored, and checks that they are of one camera at one focus setting.

EXIF Orientation is ignored: it only concerns display, while K refers to the rows and columns of the sensor. Applying
it would change K when the camera is rolled between two images.
"""

from __future__ import annotations

import hashlib
import mmap
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary.calib.image_head import ImageHead, check_complete, read_head
from calibrary.calibration import CameraKey, ImageSize
from calibrary.errors import InputError, ParseError
from calibrary.records import replace

Gray: TypeAlias = NDArray[np.uint8]
Samples: TypeAlias = NDArray[Any]
"""(H, W), 8 or 16 bits."""

LARGEST_FILE = 1 << 31
"""Bytes; an uncompressed 16-bit colour image of the largest sensors is slightly smaller."""

NAMES_SHOWN = 3
MOSAIC_CONTRAST = 0.05
"""Smallest level difference of a mosaic's colours, as a share of the mean, that distinguishes it from a gray image."""


class Frame(Struct, frozen=True, kw_only=True, eq=False):
    """One image, prepared for detection.

    Attributes:
        name: file name, without the folder.
        sha256: SHA-256 of the file.
        gray: (H, W), as stored, 8 bit; deeper images are stretched to this range.
    """

    name: str
    sha256: str
    gray: Gray

    @property
    def size(self) -> ImageSize:
        """(width, height) px."""
        return self.gray.shape[1], self.gray.shape[0]


class Setting(Struct, frozen=True, kw_only=True):
    """Properties that must be equal for all images of a calibration.

    Attributes:
        camera: camera, as the images state it.
        image_size: (width, height) px, as stored.
        focus: focus setting of the lens, in words; None if the images do not state it.
    """

    camera: CameraKey
    image_size: ImageSize
    focus: str | None = None


def read_frame(path: Path) -> Frame:
    """Read and decode one image.

    Raises:
        InputError: the file cannot be read, is truncated, or contains no camera image; see
            :func:`calibrary.calib.image_head.read_head`.
    """
    content = _content(path)
    with _named_after(path):
        head = read_head(content)
        check_complete(content, head)
        gray = _decoded(content, head)
    return Frame(name=path.name, sha256=hashlib.sha256(content).hexdigest(), gray=gray)


def frame_size(path: Path) -> ImageSize:
    """Return (width, height) px as stored, from the header of the file alone.

    Raises:
        InputError: as for :func:`read_frame`, as far as the header shows it.
    """
    try:
        with (
            path.open("rb") as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content,
            _named_after(path),
        ):
            return read_head(content).size
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
    # An empty file, or one on a file system without memory mapping.
    whole = _content(path)
    with _named_after(path):
        return read_head(whole).size


@contextmanager
def _named_after(path: Path) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        raise type(error)(error.message, source=path.name, place=error.place) from None


def _content(path: Path) -> bytes:
    try:
        if not path.is_file():
            problem = "is a folder" if path.is_dir() else "does not exist, or is not a regular file"
            raise InputError(f"{problem}; give the frames as files", source=path.name)
        if (size := path.stat().st_size) > LARGEST_FILE:
            raise InputError(f"a file of {size} bytes; expected at most {LARGEST_FILE}", source=path.name)
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", source=path.name) from None


def _decoded(content: bytes, head: ImageHead) -> Gray:
    import cv2

    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except (cv2.error, MemoryError):
        pixels = None
    width, height = head.size
    if pixels is None or pixels.shape[:2] != (height, width):
        raise ParseError(
            f"the {head.kind.upper()} of {width}×{height} px cannot be decoded; copy it from the camera again, "
            "or save it as PNG"
        )
    if pixels.dtype not in (np.uint8, np.uint16):
        raise ParseError(f"pixels of {pixels.dtype}; expected 8 or 16 bits")
    samples: Samples = pixels
    if head.kind != "jpeg" and head.channels == 1 and _is_mosaic(samples):
        raise ParseError(
            "a gray image that is a raw colour mosaic (Bayer): its even and odd pixels differ in level; "
            "develop it to gray or RGB first"
        )
    return eight_bit(samples)


def eight_bit(pixels: Samples) -> Gray:
    """Return pixels in 8 bits; the used range of 16 is stretched, since such files often contain 10, 12 or 14."""
    if pixels.dtype == np.uint8:
        return pixels.astype(np.uint8, copy=False)
    darkest, lightest = np.percentile(pixels[::4, ::4], (0.05, 99.95))
    span = max(float(lightest - darkest), 1.0)
    levels = (pixels.astype(np.float32) - np.float32(darkest)) * np.float32(255 / span)
    eight: Gray = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    return eight


def _is_mosaic(pixels: Samples) -> bool:
    """Return whether the four positions of a 2 × 2 tile have the levels of a Bayer pattern, with green on one diagonal.

    In a gray image all four see the same scene and agree to far better than one percent.
    """
    height, width = (side - side % 2 for side in pixels.shape)
    a, b, c, d = (
        float(np.mean(pixels[y:height:2, x:width:2], dtype=np.float64)) for y, x in np.ndindex(2, 2)
    )
    mean = (a + b + c + d) / 4
    for green, others in (((a, d), (b, c)), ((b, c), (a, d))):
        level = sum(green) / 2
        if abs(green[0] - green[1]) < 0.4 * MOSAIC_CONTRAST * mean and any(
            abs(other - level) > MOSAIC_CONTRAST * mean for other in others
        ):
            return True
    return False


def of_most_common_size(
    frames: Iterable[Path],
) -> tuple[ImageSize | None, tuple[Path, ...], dict[Path, ImageSize]]:
    """Separate images of the most common size from the others.

    Returns:
        The most common (width, height) px, None if no image can be read; the images of that size and those that cannot
        be read; the other images with their size.

    Raises:
        InputError: two sizes are equally common.
    """
    sizes: dict[Path, ImageSize] = {}
    every = tuple(frames)
    for path in every:
        with suppress(InputError):
            sizes[path] = frame_size(path)
    first, second = (*Counter(sizes.values()).most_common(2), (None, 0), (None, 0))[:2]
    if first[1] == second[1] and first[0] is not None and second[0] is not None:
        two = " and of ".join("{}×{} px".format(*size) for size in (first[0], second[0]))
        raise InputError(
            f"{first[1]} frames each are of {two}, so neither is the size of most; calibrate one size at a time"
        )
    others = {path: size for path, size in sizes.items() if size != first[0]}
    return first[0], tuple(path for path in every if path not in others), others


def group_frames(
    frames: Iterable[Path], setting: Callable[[Path], Setting] | Mapping[Path, Setting]
) -> dict[Setting, tuple[Path, ...]]:
    """Group the images by setting, in order of first appearance.

    Args:
        frames: image files.
        setting: setting of each image, as a function or a mapping.
    """
    look_up = setting.__getitem__ if isinstance(setting, Mapping) else setting
    groups: dict[Setting, tuple[Path, ...]] = {}
    for path in frames:
        key = look_up(path)
        groups[key] = (*groups.get(key, ()), path)
    return groups


def the_one_setting(groups: Mapping[Setting, Sequence[Path]]) -> Setting:
    """Return the setting that all images share; what some of them do not state may be what the others state.

    Raises:
        InputError: the images state two sizes, cameras or focuses; the message names the images of each.
    """
    if not groups:
        raise InputError("no frames; give the images of the board")
    shared: dict[str, object] = {}
    for name in (one for one in CameraKey.__struct_fields__ if one != "image_size"):
        stated = _stated(groups, partial(_field, name))
        if len(stated) > 1:
            remedy = "calibrate one camera at a time, or, if they are of one, say so with --" + name.replace(
                "_", "-"
            )
            labels = {f"{name.replace('_', '-')} {value}": paths for value, paths in stated.items()}
            raise InputError(_differing("cameras", labels, remedy))
        if name != "capture_mode":
            shared[name] = next(iter(stated), None)
    sizes = _stated(groups, lambda setting: "{}×{} px".format(*setting.image_size))
    if len(sizes) > 1:
        remedy = "calibrate one size at a time, or leave out those of another size than most with --skip-other-sizes"
        raise InputError(_differing("sizes", sizes, remedy))
    focuses = _stated(groups, lambda setting: setting.focus)
    if len(focuses) > 1:
        remedy = (
            "each focus has a focal length of its own: lock it, and calibrate one at a time, or, if it was locked, say "
            "so with --focus"
        )
        raise InputError(_differing("focus settings", focuses, remedy))
    first = next(iter(groups))
    return replace(first, camera=replace(first.camera, **shared), focus=next(iter(focuses), None))


def _field(name: str, setting: Setting) -> object:
    value = getattr(setting.camera, name)
    # A camera that corrects its lens says so; one that does not says nothing.
    return value if name != "capture_mode" else value or "none"


def _stated(groups: Mapping[Setting, Sequence[Path]], of: Callable[[Setting], Any]) -> dict[Any, list[Path]]:
    """Return the images by what they state."""
    stated: dict[Any, list[Path]] = {}
    for setting, paths in groups.items():
        if (value := of(setting)) is not None:
            stated.setdefault(value, []).extend(paths)
    return stated


def _differing(what: str, groups: Mapping[str, Sequence[Path]], remedy: str) -> str:
    parts = []
    for label, paths in sorted(groups.items(), key=lambda item: -len(item[1])):
        names = ", ".join(path.name for path in paths[:NAMES_SHOWN])
        more = ", …" if len(paths) > NAMES_SHOWN else ""
        parts.append(f"{len(paths)} of {label} ({names}{more})")
    return f"the frames are of {len(groups)} {what}: {'; '.join(parts)}; {remedy}"
