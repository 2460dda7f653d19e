"""Claims at the size of the images: which reading of each stands.

Claims stated at one size share one reading, because the frames have one history; what is stated of this very image
chooses it. A reading stands if it is certain; if it is the usual one and nothing contradicts it; or if it is confirmed
and every other is contradicted. Else the claim is ambiguous here, and no K.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from enum import IntEnum

from msgspec import Struct

from calibrary.calibration import Calibration, ImageSize
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.readings import Prior, Reading, readings
from calibrary.jobs.survey.claims import Claim, Who
from calibrary.records import replace


class Settled(IntEnum):
    """How a reading came to stand, the best first."""

    CERTAIN = 0
    CONFIRMED = 1
    USUAL = 2
    AMBIGUOUS = 3


class Placed(Struct, frozen=True, kw_only=True):
    """A claim at the size of the images.

    Attributes:
        claim: as stated.
        calibration: at the size of the images, by the reading.
        reading: the one that is taken.
        settled: why it stands.
        rivals: the other readings that nothing contradicts.
    """

    claim: Claim
    calibration: Calibration
    reading: Reading
    settled: Settled = Settled.CERTAIN
    rivals: tuple[Reading, ...] = ()

    @property
    def fx(self) -> float:
        """Focal length in px."""
        return self.calibration.intrinsics.fx

    @property
    def ways(self) -> tuple[Placed, ...]:
        """By each reading that it may have."""
        return (self, *(placed(self.claim, one) for one in self.rivals))


Says = Callable[[Placed, Placed], bool | None]
"""Whether a claim confirms another, True, or contradicts it, False; None if neither."""


def placed(claim: Claim, reading: Reading) -> Placed:
    """A claim by one of its readings; σ in px follows its factor."""
    stated, K = claim.calibration, reading.intrinsics
    if not reading.steps:
        return Placed(claim=claim, calibration=stated, reading=reading)
    quality, made = stated.quality, stated.provenance
    if quality is not None:
        quality = replace(quality.scaled(1 / reading.factor, 1 / reading.factor))
        # Where it is proven was measured about the middle of the whole image.
        quality = quality if reading.is_scaled else replace(quality, proven=None)
    calibration = replace(
        stated,
        intrinsics=K,
        camera=replace(stated.camera, image_size=K.image_size),
        quality=None if reading.is_turned else quality,
        provenance=replace(
            made,
            reference_size=stated.intrinsics.image_size,
            adaptation="; ".join(text for text in (made.adaptation, *reading.steps) if text),
            assumptions=(*made.assumptions, *reading.assumes),
        ),
    )
    return Placed(claim=claim, calibration=calibration, reading=reading)


def place(claims: Sequence[Claim], metadata: ImageMetadata, says: Says) -> tuple[Placed, ...]:
    """Every claim at the size of the images; those that no reading brings there are left out.

    Args:
        claims: all that there are.
        metadata: of the images.
        says: how one claim stands to another.
    """
    sizes: dict[ImageSize, list[Claim]] = {}
    for one in claims:
        sizes.setdefault(one.calibration.intrinsics.image_size, []).append(one)
    here = sizes.pop(metadata.size, [])
    found = [placed(one, readings(one.calibration.intrinsics, metadata)[0]) for one in here]
    # A file is no statement of these images: it must not choose the frame of what is then to confirm it.
    anchors = [one for one in found if not one.claim.is_whole and one.claim.who is not Who.FILE]
    for group in sizes.values():
        found += _together(group, metadata, anchors, says)
    return tuple(found)


def _together(
    group: Sequence[Claim], metadata: ImageMetadata, anchors: Sequence[Placed], says: Says
) -> Iterator[Placed]:
    """The claims of one size by the one reading that they share."""
    ways = [readings(one.calibration.intrinsics, metadata) for one in group]
    if not ways[0]:
        return
    best = min(range(len(group)), key=lambda n: (not group[n].is_measured, group[n].tolerance))
    voices = [_voice(placed(group[best], way), ways[best], anchors, says) for way in ways[best]]
    at, settled = _choose([way.prior for way in ways[best]], voices)
    alive = [n for n, voice in enumerate(voices) if voice is not False] or range(len(voices))
    for claim, own in zip(group, ways, strict=True):
        rivals = tuple(own[n] for n in alive if n != at)
        yield replace(placed(claim, own[at]), settled=settled, rivals=rivals)


def _voice(one: Placed, ways: Sequence[Reading], anchors: Sequence[Placed], says: Says) -> bool | None:
    """Whether what is stated of this very image contradicts a reading, False, or only confirms it, True."""
    said = {says(anchor, one) for anchor in anchors if not _may_be_stale(anchor, one.claim, ways, says)}
    return False if False in said else True if True in said else None


def _may_be_stale(anchor: Placed, claim: Claim, ways: Sequence[Reading], says: Says) -> bool:
    """Whether a tag states what a program leaves that resizes an image, so that it tells no crop from a resize."""
    is_resized = any(way.is_scaled for way in ways)
    cut = next((way for way in ways if way.is_cut), None)
    return (
        anchor.claim.is_kept
        and is_resized
        and cut is not None
        and says(anchor, placed(claim, cut)) is not False
    )


def _choose(priors: Sequence[Prior], voices: Sequence[bool | None]) -> tuple[int, Settled]:
    if Prior.CERTAIN in priors:
        return priors.index(Prior.CERTAIN), Settled.CERTAIN
    alive = [n for n, voice in enumerate(voices) if voice is not False]
    usual = [n for n in alive if priors[n] is Prior.USUAL]
    confirmed = [n for n in alive if voices[n]]
    if len(alive) == 1 and confirmed:
        return alive[0], Settled.CONFIRMED
    if len(usual) == 1 and (not confirmed or usual == confirmed):
        return usual[0], Settled.USUAL
    if len(priors) == 1 and alive:
        return 0, Settled.USUAL
    return (usual or confirmed or alive or [0])[0], Settled.AMBIGUOUS
