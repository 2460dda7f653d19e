"""What a survey finds, in words: a row a rule. Nothing decides by reading them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from calibrary.errors import CalibraryError
from calibrary.jobs.survey.placing import Placed
from calibrary.policy import Policy
from calibrary.validation import EDITED, GIVE_FILES, Finding, Severity

UNJUDGED_CENTRE: Final = "the principal point was not judged"
CONTRADICTED: Final = "contradicted"
FIND_OUT: Final = "find out which of the two is right; 'calibrary check' tells whether a K is of images"
REGISTER: Final = "calibrate this image size, and register it"


def said(K: Placed, one: Placed, limit: float, policy: Policy) -> str:
    """How a claim differs from K."""
    apart = f"{one.claim.name} states fx = {one.fx:.1f} px, {one.fx / K.fx - 1.0:+.1%}"
    if not (one.claim.is_measured and K.claim.is_measured):
        return f"{apart}, and the two may differ by {limit:.0%}"
    from calibrary.jobs.diff.comparison import compare  # noqa: PLC0415  loads linear algebra, for the few that need it
    from calibrary.jobs.diff.wording import pixels  # noqa: PLC0415  as above

    try:
        found = compare(K.calibration, one.calibration, policy)
    except CalibraryError as error:
        return f"{apart}, and cannot be compared: {error.why}"
    # Where the kind of change is the first reason, the pixels are told besides.
    seen = found.numbers.projection if found.structural and found.numbers is not None else None
    far = (
        f"{pixels(seen.rms_px)} rms and {pixels(seen.max_px)} at most over the frame: "
        if seen is not None
        else ""
    )
    return f"{apart}, another K: {far}{found.reasons[0]}"


def disbelieved(message: str, shown_by: Sequence[str]) -> str:
    """A claim that contradicts K is not believed."""
    return f"{message}; it is not believed: {' and '.join(shown_by)} show it wrong"


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


def computed(tag: str) -> Finding:
    """A K that is called measured has the numbers of a tag, and nothing confirms it."""
    return Finding(
        rule="computed",
        severity=Severity.UNPROVEN,
        message=f"its numbers are those of {tag}, so it was computed, and not measured",
        remedy="provide a measured calibration",
    )


def edited(message: str, policy: Policy) -> Finding:
    """A program changed the images since the camera wrote them."""
    return Finding(
        rule=EDITED,
        severity=Severity.UNPROVEN if policy.assumed_sensor_is_unproven else Severity.WARNING,
        message=message,
        remedy=GIVE_FILES,
    )
