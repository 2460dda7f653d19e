"""Extras that are valid only with one K: a rectification, the valid region of a calibration.

They become wrong if K is scaled or corrected, so they contain a digest of K and the lens, and are written only
together with the same K and lens.
"""

from __future__ import annotations

import hashlib

from calibrary.calibration import Intrinsics
from calibrary.distortion import Distortion


def bound(text: str, intrinsics: Intrinsics, distortion: Distortion | None) -> str:
    """The extra's value, prefixed with the digest of K and the lens."""
    return f"{_digest(intrinsics, distortion)}:{text}"


def unbound(value: str, intrinsics: Intrinsics, distortion: Distortion | None) -> str | None:
    """The original text of :func:`bound`; None if it belongs to another K or lens."""
    digest, _, text = value.partition(":")
    return text if digest == _digest(intrinsics, distortion) else None


def _digest(K: Intrinsics, distortion: Distortion | None) -> str:
    lens = {} if distortion is None else {k: v for k, v in distortion.coefficients.items() if v}
    numbers = (K.fx, K.fy, K.cx, K.cy, K.skew, *K.image_size, *lens.values())
    text = " ".join([f"{number:.12g}" for number in numbers] + list(lens))
    return hashlib.sha256(text.encode()).hexdigest()[:16]
