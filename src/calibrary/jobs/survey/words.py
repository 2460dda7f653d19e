"""What a survey finds, in words: a row a rule. Nothing decides by reading them."""

from __future__ import annotations

from collections.abc import Sequence

from calibrary.jobs.survey.placing import Placed
from calibrary.validation import EDITED, Finding, Severity

REGISTER: str = "calibrate this image size, and register it"


def contradicted(K: Placed, one: Placed, limit: float) -> Finding:
    """A claim that is believed contradicts K."""
    apart = one.fx / K.fx - 1.0
    if one.claim.is_measured and K.claim.is_measured:
        known = "which is another K, as 'calibrary diff' judges"
    else:
        known = f"and the two may differ by {limit:.0%}"
    return Finding(
        rule="contradicted",
        severity=Severity.UNPROVEN,
        measured=apart,
        limit=limit,
        message=f"{one.claim.name} states fx = {one.fx:.1f} px, {apart:+.1%}, {known}",
        remedy="find out which of the two is right: 'calibrary check IMAGES FILE' tells of another K",
    )


def disbelieved(one: Placed, shown_by: Sequence[str]) -> str:
    """A claim that contradicts K is not believed."""
    by = " and ".join(shown_by)
    return f"{one.claim.name} states fx = {one.fx:.1f} px; it is not believed: {by} show it wrong"


def frame_unknown(K: Placed, fitting: Sequence[Placed]) -> Finding:
    """Two readings of K stand, or none does."""
    ways = " or ".join(f"fx = {one.fx:.1f} px ({'; '.join(one.reading.steps)})" for one in K.ways)
    told = "".join(
        f"; {one.claim.name} states {one.fx:.1f} px, which a program leaves as it was that resizes an image"
        for one in fitting
    )
    return Finding(
        rule="frame-unknown",
        severity=Severity.UNPROVEN,
        message=f"nothing shows how these images came from the frame of {K.claim.name}: {ways}{told}",
        remedy=REGISTER,
    )


def not_this_frame(name: str) -> Finding:
    """No part of the frame of K has the shape of the images."""
    return Finding(
        rule="frame-unknown",
        severity=Severity.UNPROVEN,
        message=f"no part of the frame of {name} has the shape of these images",
        remedy=REGISTER,
    )


def edited(done: str) -> Finding:
    """A program changed the images since the camera wrote them."""
    return Finding(
        rule=EDITED,
        severity=Severity.UNPROVEN,
        message=f"the image was {done}: nothing shows that this K describes it",
        remedy="provide the original files from the camera",
    )
