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
from calibrary.evidence.frame import CROP_SLACK_PX, TURNED
from calibrary.evidence.metadata import ImageMetadata
from calibrary.image_size import same_aspect
from calibrary.records import replace

WHOLE: Final = 0.01
"""Largest difference of a factor from a whole number, if pixels were joined."""
MOST_JOINED: Final = 8

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
    """

    intrinsics: Intrinsics
    steps: tuple[str, ...] = ()
    factor: float = 1.0
    prior: Prior = Prior.POSSIBLE
    assumes: tuple[str, ...] = ()
    is_scaled: bool = False
    is_cut: bool = False

    @property
    def centre_is_assumed(self) -> bool:
        """Whether the principal point is where it would be if the crop were centred, or the image not turned."""
        return bool({CENTRED, TURNED} & {*self.assumes})


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
    )


def _x(size: ImageSize) -> str:
    return f"{size[0]}×{size[1]}"
