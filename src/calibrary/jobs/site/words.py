"""What several pages of a site say in the same way."""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.pages import Tone
from calibrary.registry.entry import Status

__all__ = ["STATUSES", "signed", "stds_of"]

STATUSES = {
    Status.APPROVED: Tone.GOOD,
    Status.HELD: Tone.GOOD,
    Status.DRAFT: Tone.CAUTION,
    Status.RETIRED: Tone.NEUTRAL,
}


def stds_of(calibration: Calibration) -> dict[str, float]:
    """The standard deviations that a calibration states itself; κ² is not in them."""
    quality = calibration.quality
    if quality is None:
        return {}
    covariance = quality.covariance.std if quality.covariance is not None else {}
    return {**dict(quality.std), **covariance}


def signed(text: str) -> str:
    """A number with the sign that typesetters use."""
    return text.replace("-", "−")
