"""Choice of the sharpest frames of a recording: one of each stretch of time."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary.calib.detectors.refinement import reduced
from calibrary.calib.frames import eight_bit

STRETCH_S: Final = 0.5
"""s; in less time the board hardly moves to another pose."""
MOST_KEPT: Final = 60
"""More frames of one recording say little more of a lens."""
LOOKED_AT: Final = 640
"""px of the copy in which sharpness is compared; noise is averaged out, the blur of motion is not."""


class Shot(Struct, frozen=True, kw_only=True, eq=False):
    """A frame of a recording.

    Attributes:
        seconds: time since the start of the recording.
        pixels: (H, W), 8 or 16 bits.
        file: the frame as the recording holds it, if it is a file of an image.
        suffix: of such a file; ".png" for one that has to be encoded.
    """

    seconds: float
    pixels: NDArray[Any]
    file: bytes | None = None
    suffix: str = ".png"

    def encoded(self) -> bytes:
        """Return the bytes of an image file."""
        import cv2

        if self.file is not None:
            return self.file
        return bytes(cv2.imencode(".png", self.pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1])

    @property
    def sharpness(self) -> float:
        """Mean square of the gradient, to compare frames of one scene."""
        import cv2

        small = cv2.GaussianBlur(
            reduced(eight_bit(self.pixels), LOOKED_AT)[0].astype(np.float32), (0, 0), 1.0
        )
        return float(np.mean(np.square(np.diff(small, axis=0))) + np.mean(np.square(np.diff(small, axis=1))))


class Unreadable(Struct, frozen=True, kw_only=True):
    """A frame of a recording that is empty or damaged.

    Attributes:
        why: what was found, after "has".
    """

    why: str


def sharpest(shots: Iterable[Shot | Unreadable]) -> tuple[list[Shot], int, list[Unreadable]]:
    """Return the sharpest frame of each stretch, how many frames could be read, and those that could not.

    Stretches are half a second long, and twice as long whenever there would be more than 60; so a recording of any
    length is read once and in little memory.
    """
    best: dict[int, tuple[float, Shot]] = {}
    unreadable: list[Unreadable] = []
    stretch, count = STRETCH_S, 0
    for shot in shots:
        if isinstance(shot, Unreadable):
            unreadable.append(shot)
            continue
        count += 1
        at, now = int(shot.seconds // stretch), shot.sharpness
        if at not in best or now > best[at][0]:
            best[at] = now, shot
        if len(best) > MOST_KEPT:
            stretch *= 2
            merged: dict[int, tuple[float, Shot]] = {}
            for place, one in best.items():
                if place // 2 not in merged or one[0] > merged[place // 2][0]:
                    merged[place // 2] = one
            best = merged
    return [shot for _, (_, shot) in sorted(best.items())], count, unreadable
