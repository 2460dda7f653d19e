"""Extras that hold beside one K only: a rectification, the region a calibration is good for.

Once K has been scaled or corrected they are wrong, so they carry a digest of what they belong to and go back
into a file beside that or not at all.
"""

from __future__ import annotations

import hashlib

from calibrary.calibration import Intrinsics
from calibrary.distortion import Distortion

__all__ = ["bound", "unbound"]


def bound(text: str, intrinsics: Intrinsics, distortion: Distortion | None) -> str:
    """The extra's value with the digest of what it belongs to before it."""
    return f"{_digest(intrinsics, distortion)}:{text}"


def unbound(value: str, intrinsics: Intrinsics, distortion: Distortion | None) -> str | None:
    """The text that :func:`bound` was given, None when it belongs to another K or lens."""
    digest, _, text = value.partition(":")
    return text if digest == _digest(intrinsics, distortion) else None


def _digest(K: Intrinsics, distortion: Distortion | None) -> str:
    lens = {} if distortion is None else {k: v for k, v in distortion.coefficients.items() if v}
    numbers = (K.fx, K.fy, K.cx, K.cy, K.skew, *K.image_size, *lens.values())
    text = " ".join([f"{number:.12g}" for number in numbers] + list(lens))
    return hashlib.sha256(text.encode()).hexdigest()[:16]
