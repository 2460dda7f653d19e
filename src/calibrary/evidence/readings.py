"""How a K that was stated at one image size can be of an image of another size: every way, each a hypothesis.

A size alone does not tell whether an image of 0.9 of the sides was resized or cropped. Nothing here decides: what else
is known of the image chooses among the readings, and a K with two that stand is none.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from typing import Final

from msgspec import Struct

from calibrary.calibration import ImageSize, Intrinsics
from calibrary.errors import FrameError
from calibrary.evidence.frame import CROP_SLACK_PX, files_frame, leads
from calibrary.evidence.metadata import ImageMetadata
from calibrary.image_size import same_aspect
from calibrary.records import replace

WHOLE: Final = 0.01
"""Largest difference of a factor from a whole number, if pixels were joined."""
MOST_JOINED: Final = 8

RESIZED: Final = "the image was resized, not cropped"
"""Assumption made when a size in EXIF, or a focal plane, belongs to the same image at another scale."""
TURNED: Final = "which way the image was turned is not stated: the principal point is taken in the middle"
CENTRED: Final = "the crop is centred"
NOTHING_CUT: Final = "nothing was cut off the frame"


class Prior(StrEnum):
    """How much a reading needs besides itself.

    Certain: nothing else is possible, or the image states it. Usual: what cameras and programs do; it stands unless
    something contradicts it. Possible: it stands only if something confirms it, or no other reading is left.
    """

    CERTAIN = "certain"
    USUAL = "usual"
    POSSIBLE = "possible"


class Reading(Struct, frozen=True, kw_only=True):
    """A K at the image's size, and what it takes for granted.

    Attributes:
        intrinsics: K at the image's size.
        steps: what was done to the frame of the claim, in words; empty if the two are of one size.
        factor: px of the claim's frame for a px of this one.
        prior: how much it needs besides itself.
        assumes: what it takes for granted, in words.
        is_scaled: whether it is the whole frame at another scale.
        is_cut: whether a part of the frame is left whose pixels are as they were.
        is_turned: whether the image is turned by 90°, so that a distortion that is not radial is not the image's.
    """

    intrinsics: Intrinsics
    steps: tuple[str, ...] = ()
    factor: float = 1.0
    prior: Prior = Prior.POSSIBLE
    assumes: tuple[str, ...] = ()
    is_scaled: bool = False
    is_cut: bool = False
    is_turned: bool = False

    @property
    def centre_is_assumed(self) -> bool:
        """Whether the principal point is where it would be if the crop were centred, or the image not turned."""
        return self.is_turned or CENTRED in self.assumes


def readings(K: Intrinsics, metadata: ImageMetadata) -> tuple[Reading, ...]:
    """Every reading of a K for an image, the most usual first.

    The same sizes give the same readings in the same order. There is none if no part of K's frame has this shape.
    """
    size = metadata.size
    if K.image_size == size:
        return (Reading(intrinsics=K, prior=Prior.CERTAIN),)
    if _is_upright(K.image_size) is _is_upright(size) or None in {
        _is_upright(K.image_size),
        _is_upright(size),
    }:
        found = [*_ways(K, size, metadata)]
    else:
        found = [_turned(one, size) for one in _ways(K, size[::-1], metadata)]
    order = [*Prior]
    return tuple(sorted(found, key=lambda one: order.index(one.prior)))


def usual(K: Intrinsics, metadata: ImageMetadata) -> Reading:
    """The reading of a tag's K for its image: scaled, or with one side cut, through the size that EXIF states.

    Digital zoom is applied if the camera enlarged the zoomed part back to the full image size.

    Raises:
        FrameError: no such reading brings one image size to the other.
    """
    size, exif_size = metadata.size, metadata.exif_size
    is_resized = exif_size is not None and exif_size != size and same_aspect(exif_size, size)
    read = _zoomed(K, metadata)
    if is_resized and metadata.whole_frame is not True:
        read = replace(read, assumes=(RESIZED, *read.assumes))
    found = _then(read, size)
    if found is None and exif_size is not None and exif_size != size and leads(exif_size, size):
        written = _then(read, exif_size)
        found = _then(written, size) if written is not None else None
    if found is None:
        raise FrameError(_which_part(K, metadata))
    return found


def _then(read: Reading, size: ImageSize) -> Reading | None:
    """A reading, and then what usually brings its size to another; None if nothing does."""
    K = read.intrinsics
    if K.image_size == size:
        return read
    for target in (size, size[::-1]):
        one = next(_ways(K, target, ImageMetadata(size=target)), None)
        if one is None or (one.prior is Prior.POSSIBLE and not one.is_scaled):
            continue
        one = replace(one, assumes=tuple(text for text in one.assumes if text != NOTHING_CUT))
        if target != size:
            is_centred = (K.cx, K.cy) == (K.image_size[0] / 2, K.image_size[1] / 2)
            turned = _turned(one, size)
            one = replace(turned, assumes=one.assumes) if is_centred else turned
        return replace(one, steps=(*read.steps, *one.steps), assumes=(*read.assumes, *one.assumes))
    return None


def _which_part(K: Intrinsics, metadata: ImageMetadata) -> str:
    """What a K would be by each part of its frame that the image may show, and how to say which it is."""
    ways = [one for one in readings(K, metadata) if one.factor >= 1.0]
    if not ways:
        return f"no part of {_x(K.image_size)} is {_x(metadata.size)}; register the camera at this size"
    largest = max(ways, key=lambda one: one.factor)
    told = " or ".join(
        f"fx = {one.intrinsics.fx:.1f} px if {', '.join(one.steps)}"
        for one in ways
        if one is largest or one.is_cut
    )
    sizes = f"which part of its {_x(K.image_size)} the image of {_x(metadata.size)} shows is not stated"
    return f"{sizes}: {told}; register the camera at this size, or give the right K (--fallback-k)"


def _is_upright(size: ImageSize) -> bool | None:
    return None if size[0] == size[1] else size[1] > size[0]


def _ways(K: Intrinsics, size: ImageSize, metadata: ImageMetadata) -> Iterator[Reading]:
    (W, H), (w, h) = K.image_size, size
    if K.image_size == size:
        yield Reading(intrinsics=K, prior=Prior.CERTAIN)
        return
    is_whole = same_aspect((W, H), (w, h))
    has_side = abs(W - w) <= CROP_SLACK_PX or abs(H - h) <= CROP_SLACK_PX
    if is_whole:
        yield _scaled(K, size, metadata)
    yield from _cut(K, size, size, Prior.POSSIBLE if is_whole or not has_side else Prior.USUAL)
    if not is_whole and not has_side:
        # The whole width, or the whole height, is left.
        for along in ((W, round(W * h / w)), (round(H * w / h), H)):
            yield from _cut(K, along, size, Prior.POSSIBLE)
    for n in range(2, MOST_JOINED + 1):
        # A crop whose pixels were joined n by n; of the whole frame that is a scale.
        if abs(W / (w * n) - 1.0) > WHOLE or abs(H / (h * n) - 1.0) > WHOLE:
            yield from _cut(K, (w * n, h * n), size, Prior.POSSIBLE)


def _scaled(K: Intrinsics, size: ImageSize, metadata: ImageMetadata) -> Reading:
    factor = K.image_size[0] / size[0]
    apart = max(factor, 1.0 / factor)
    is_joined = 2 <= round(apart) <= MOST_JOINED and abs(apart / round(apart) - 1.0) <= WHOLE
    # A thumbnail that shows the same as the image tells that nothing was cut off since the camera wrote it.
    told = metadata.whole_frame is True and metadata.exif_size in {K.image_size, K.image_size[::-1]}
    return Reading(
        intrinsics=K.scaled(size),
        steps=(f"scaled {_x(K.image_size)} → {_x(size)}",),
        factor=factor,
        prior=Prior.CERTAIN if told else Prior.USUAL if is_joined else Prior.POSSIBLE,
        assumes=() if told else (NOTHING_CUT,),
        is_scaled=True,
    )


def _cut(K: Intrinsics, part: ImageSize, size: ImageSize, prior: Prior) -> Iterator[Reading]:
    """The middle of K's frame, as large as ``part``, at an image size of the same shape."""
    (W, H), (w, h) = K.image_size, part
    if w > W or h > H or K.image_size == part or not same_aspect(part, size):
        return
    cut = K.cropped(((W - w) / 2, (H - h) / 2, w, h))
    steps = [f"cropped {_x((W, H))} → {_x(part)}"]
    if part != size:
        steps.append(f"scaled {_x(part)} → {_x(size)}")
        cut = cut.scaled(size)
    yield Reading(
        intrinsics=cut,
        steps=tuple(steps),
        factor=part[0] / size[0],
        prior=prior,
        assumes=(CENTRED,),
        is_cut=part == size,
    )


def _turned(one: Reading, size: ImageSize) -> Reading:
    """Of an image that was turned by 90°: which way is not known, so the principal point is taken in the middle."""
    upright = one.intrinsics
    K = Intrinsics(fx=upright.fy, fy=upright.fx, cx=size[0] / 2, cy=size[1] / 2, image_size=size)
    return replace(
        one,
        intrinsics=K,
        steps=(*one.steps, f"turned {_x(size[::-1])} → {_x(size)}"),
        prior=Prior.USUAL if one.prior is Prior.CERTAIN else one.prior,
        assumes=(*(text for text in one.assumes if text != CENTRED), TURNED),
        is_turned=True,
    )


def _zoomed(K: Intrinsics, metadata: ImageMetadata) -> Reading:
    """K with the digital zoom of the image.

    If the camera enlarges the zoomed part back to the full image size, the focal length in px is multiplied by the
    zoom; if it writes the part as it is, that is a 1:1 crop.
    """
    zoom = metadata.zoom
    if zoom <= 1.0:
        return Reading(intrinsics=K)
    width, height = K.image_size
    written = files_frame(metadata)
    if abs(written[0] * zoom / width - 1.0) <= 0.02 and abs(written[1] * zoom / height - 1.0) <= 0.02:
        box = ((width - written[0]) / 2, (height - written[1]) / 2, *written)
        step = f"cropped {_x(K.image_size)} → {_x(written)} by {zoom:g}× digital zoom"
        return Reading(intrinsics=K.cropped(box), steps=(step,), assumes=(CENTRED,))
    enlarged = replace(
        K,
        fx=K.fx * zoom,
        fy=K.fy * zoom,
        cx=width / 2 + (K.cx - width / 2) * zoom,
        cy=height / 2 + (K.cy - height / 2) * zoom,
        skew=K.skew * zoom,
    )
    return Reading(
        intrinsics=enlarged,
        steps=(f"enlarged {zoom:g}× by digital zoom",),
        assumes=("digital zoom was enlarged back to the full image size, about its centre",),
    )


def _x(size: ImageSize) -> str:
    return f"{size[0]}×{size[1]}"
