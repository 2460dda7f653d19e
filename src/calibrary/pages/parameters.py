"""K and distortion formatted for pages, with as many digits as their uncertainty justifies."""

from __future__ import annotations

import math
from collections.abc import Iterator

from calibrary.calibration import Calibration
from calibrary.pages.content import Block, Column, Table
from calibrary.pages.wording import minus

__all__ = ["distortion_blocks", "intrinsics_items", "rounded", "stds_of"]


def stds_of(calibration: Calibration) -> dict[str, float]:
    """The standard deviations that a calibration states, without the variance factor."""
    quality = calibration.quality
    if quality is None:
        return {}
    covariance = quality.covariance.std if quality.covariance is not None else {}
    return {**dict(quality.std), **covariance}


def rounded(value: float, std: float | None, unsure: str = ".6g") -> tuple[str, str]:
    """Format a value and its standard deviation to two significant digits of the latter.

    Args:
        value: of a parameter.
        std: its standard deviation, or None if unknown.
        unsure: format of the value if the standard deviation is unknown.
    """
    if std is None or not 0 < std < math.inf:
        return minus(format(value, unsure)), "–"
    decimals = min(12, max(0, 1 - math.floor(math.log10(std))))
    return minus(f"{value:.{decimals}f}"), f"{std:.{decimals}f}"


def intrinsics_items(calibration: Calibration) -> Iterator[tuple[str, str]]:
    """Yield fx, fy, cx, cy (px), a non-zero skew and the image size as (name, text)."""
    K, std = calibration.intrinsics, stds_of(calibration)
    for name in ("fx", "fy", "cx", "cy"):
        value, sigma = rounded(getattr(K, name), std.get(name), ".2f")
        yield name, f"{value} px" if sigma == "–" else f"{value} ± {sigma} px"
    if K.skew:
        yield "skew", minus(f"{K.skew:.4g} px")
    yield "image", "{} × {} px".format(*K.image_size)


def distortion_blocks(calibration: Calibration) -> Iterator[Block]:
    """Yield the distortion coefficients, or a sentence if there are none."""
    lens, std = calibration.distortion, stds_of(calibration)
    if lens is None:
        yield "The distortion is unknown (which is not the same as no distortion)."
    elif not lens.coefficients:
        yield "The image is free of distortion."
    else:
        columns = (Column("coefficient"), Column("value", numeric=True), Column("σ", numeric=True))
        known = any(name in std for name in lens.coefficients)
        rows = [(name, *rounded(value, std.get(name))) for name, value in lens.coefficients.items()]
        yield Table(
            caption=f"Distortion, {lens.model} model",
            columns=columns if known else columns[:2],
            rows=tuple(row if known else row[:2] for row in rows),
        )
