"""The claims about the K of some images, weighed against one another once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, Intrinsics
from calibrary.evidence.identity import firmware
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.originality import ORIGINAL, Originality, Pixels, not_described
from calibrary.jobs.survey import words
from calibrary.jobs.survey.claims import CATALOGUE, Claim, Who
from calibrary.jobs.survey.limits import known_tolerance
from calibrary.jobs.survey.placing import Placed, Settled, place
from calibrary.jobs.survey.relating import (
    Relation,
    gap,
    is_independent,
    limit_between,
    relate,
    relate_as_read,
)
from calibrary.jobs.use import Allowed, allowed
from calibrary.policy import Policy
from calibrary.quality import Quality
from calibrary.records import replace
from calibrary.validation import EDITED, PLAUSIBLE, Finding, Report, Severity, Use, Verdict, validate


class Against(Struct, frozen=True, kw_only=True):
    """A claim that contradicts another.

    Attributes:
        one: it.
        K: the other.
        policy: by which the two are compared.
        limit: how far their focal lengths may be apart, as a fraction.
        shown_by: the names of the two claims that show it wrong; empty if it is believed.
    """

    one: Placed
    K: Placed
    policy: Policy
    limit: float
    shown_by: tuple[str, ...] = ()

    @property
    def message(self) -> str:
        """How the two differ, and of one that is not believed why."""
        said = words.said(self.K, self.one, self.limit, self.policy)
        return words.disbelieved(said, self.shown_by) if self.shown_by else said

    @property
    def is_far(self) -> bool:
        """Whether two measured K's differ by more than those of one camera that moved, or of two units of its model."""
        mine, other = self.one.claim, self.K.claim
        if not (mine.is_measured and other.is_measured):
            return True
        granted = (one for one in (mine.granted, other.granted) if one is not None)
        most = next(granted, known_tolerance(self.policy))
        return abs(gap(self.one, self.K)) > max(most, mine.rounding, other.rounding)

    @property
    def is_sure(self) -> bool:
        """Whether it contradicts K even though units of a model differ: both are of one unit, or far apart."""
        mine, other = (one.claim.calibration.camera.serial for one in (self.one, self.K))
        return self.is_far or (mine is not None and mine == other)

    def finding(self, severity: Severity, remedy: str | None) -> Finding:
        """That it contradicts K."""
        return Finding(
            rule=words.CONTRADICTED,
            severity=severity,
            measured=self.one.fx / self.K.fx - 1.0,
            limit=self.limit,
            message=self.message,
            remedy=remedy,
        )


class Weighed:
    """A claim among the others of its survey: what they say of it, and what follows."""

    def __init__(self, survey: Survey, claim: Claim) -> None:
        self.survey, self.claim = survey, claim
        self._K = next((one for one in survey.placed if one.claim is claim), None)

    @property
    def ways(self) -> tuple[Placed, ...]:
        """Its K at the size of the images, by each reading that may stand; empty if no reading brings it there."""
        return self._K.ways if self._K is not None else ()

    @property
    def settled(self) -> Settled:
        """How the first of them came to stand."""
        return self._K.settled if self._K is not None else Settled.AMBIGUOUS

    @cached_property
    def _said(self) -> tuple[tuple[Placed, Relation], ...]:
        K, survey = self._K, self.survey
        if K is None:
            return ()
        return tuple((one, survey.relation(one, K)) for one in survey.placed if one is not K)

    def _that(self, *relations: Relation) -> tuple[Placed, ...]:
        return tuple(one for one, found in self._said if found in relations)

    @property
    def confirmed_by(self) -> tuple[Placed, ...]:
        """The independent claims that confirm it."""
        return self._that(Relation.CONFIRMS)

    @property
    def copies(self) -> tuple[Placed, ...]:
        """The claims that have its numbers."""
        return self._that(Relation.COPY)

    @property
    def near(self) -> tuple[Placed, ...]:
        """The claims that neither confirm nor contradict it."""
        return self._that(Relation.COMPATIBLE, Relation.DEPENDENT)

    @cached_property
    def against(self) -> tuple[Against, ...]:
        """The claims that contradict it, those that are shown wrong among them."""
        K, policy = self._K, self.survey.policy
        if K is None:
            return ()
        return tuple(
            Against(
                one=one,
                K=K,
                policy=policy,
                limit=limit_between(one.claim, K.claim),
                shown_by=self.survey.shown_wrong(one, K, self.confirmed_by),
            )
            for one in self._that(Relation.CONTRADICTS)
        )

    @property
    def believed(self) -> tuple[Against, ...]:
        """The claims that contradict it and are believed."""
        return tuple(one for one in self.against if not one.shown_by)

    @property
    def disbelieved(self) -> tuple[Against, ...]:
        """The claims that contradict it and are shown wrong."""
        return tuple(one for one in self.against if one.shown_by)

    @property
    def computed(self) -> str | None:
        """The name of the tag whose numbers a K has that is called measured and that nothing confirms; None if none."""
        if not self.claim.is_measured or self.confirmed_by:
            return None
        return next((one.claim.name for one in self.copies if not one.claim.is_measured), None)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader of the answer should know besides: who is disbelieved by whom, and what was not judged."""
        is_judged = any(one.claim.is_measured for one, found in self._said if found is not Relation.UNDECIDED)
        said = (one.message for one in self.disbelieved)
        return (*said, *(() if is_judged else (words.UNJUDGED_CENTRE,)))

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What speaks against it, the gravest first."""
        if self._K is None:
            return (words.not_this_frame(self.claim.name),)
        return tuple(sorted(self._findings(self._K), key=lambda one: -[*Severity].index(one.severity)))

    def _findings(self, K: Placed) -> Iterator[Finding]:
        policy, survey = self.survey.policy, self.survey
        settles = policy.independent_sources_settle
        for one in validate(K.calibration, policy).findings:
            if one.rule != PLAUSIBLE or not (settles and self.confirmed_by):
                yield one
        if settles:
            yield from (other.finding(Severity.UNPROVEN, words.FIND_OUT) for other in self.believed)
            if K.settled is Settled.AMBIGUOUS:
                yield words.frame_unknown(K, [one for one in survey.placed if one.claim.is_kept])
            if self.computed is not None:
                yield words.computed(self.computed)
        for changed in not_described(K.claim.calibration, survey.metadata.size, [survey.original]):
            for done in changed.done:
                yield words.edited(f"the image was {done}: nothing shows that this K describes it", policy)

    @property
    def verdict(self) -> Verdict:
        """Whether it may be used."""
        return Report(policy=self.survey.policy.name, findings=self.findings).verdict

    @cached_property
    def use(self) -> Allowed:
        """What σ allows, and at most a start where the frame or its middle is taken for granted."""
        K, survey = self._K, self.survey
        grave = [one for one in self.findings if one.severity in {Severity.ERROR, Severity.UNPROVEN}]
        is_saved = survey.original.pixels is not Pixels.ALTERED and all(one.rule == EDITED for one in grave)
        if K is None or (grave and not is_saved):
            return Allowed(use=Use.NONE, why=grave[0].message)
        found = _allowed(K, survey.policy, resaved=bool(grave))
        if found.use is not Use.FIXED:
            return found
        made, now = K.claim.calibration.provenance.firmware, firmware(survey.metadata)
        is_framed = K.settled is Settled.CONFIRMED or any(one.claim.is_framed for one in self.confirmed_by)
        why = None
        if K.settled is Settled.USUAL or K.reading.centre_is_assumed:
            why = f"assumed: {', '.join(K.reading.assumes)}"
        elif made is not None and now is not None and made != now and not is_framed:
            why = f"it was measured with firmware {made}, and {now} may use another part of the sensor"
        return found if why is None else replace(found, use=Use.START, why=why)

    @property
    def calibration(self) -> Calibration | None:
        """K at the size of the images; None if nothing may be done with it."""
        return self.ways[0].calibration if self.ways and self.use.use is not Use.NONE else None


class Survey:
    """All claims about the images of one camera that are equal in everything that can affect K."""

    def __init__(
        self,
        metadata: ImageMetadata,
        claims: Sequence[Claim],
        policy: Policy,
        *,
        original: Originality = ORIGINAL,
    ) -> None:
        self.metadata, self.claims, self.policy, self.original = metadata, tuple(claims), policy, original
        self._relations: dict[tuple[int, int], Relation] = {}

    def weigh(self, claim: Claim) -> Weighed:
        """One claim of this survey among the others."""
        return Weighed(self, claim)

    @cached_property
    def placed(self) -> tuple[Placed, ...]:
        """Every claim at the size of the images; those that no reading brings there are left out."""
        return place(self.claims, self.metadata, self._says)

    @cached_property
    def known(self) -> Placed | None:
        """What is known of the camera besides its tags: the registry's entry, else the catalogue; None if nothing is.

        Of one whose catalogue states its pixels alone, that is EXIF's focal length over them.
        """
        found = [one for one in self.placed if one.settled is not Settled.AMBIGUOUS]
        for who in (Who.ENTRY, Who.CATALOGUE, Who.TAG):
            for one in found:
                if one.claim.who is who and (who is not Who.TAG or CATALOGUE in one.claim.rests_on):
                    return one
        return None

    def _says(self, one: Placed, K: Placed) -> bool | None:
        found = relate_as_read(one, K, self.policy)
        return {Relation.CONFIRMS: True, Relation.CONTRADICTS: False}.get(found)

    def relation(self, one: Placed, K: Placed) -> Relation:
        """How one claim of this survey stands to another."""
        at = (min(id(one), id(K)), max(id(one), id(K)))
        if at not in self._relations:
            self._relations[at] = relate(one, K, self.policy)
        return self._relations[at]

    def shown_wrong(self, one: Placed, K: Placed, confirming: Sequence[Placed]) -> tuple[str, ...]:
        """The two that show a contradiction wrong, K and what confirms it; none if it is believed.

        What is measured is shown wrong by two voices; and where two speak against a third, what repeats that third is
        no support of it.
        """
        if not is_independent(one, K):
            return ()
        against = [
            other
            for other in confirming
            if is_independent(other, one) and self.relation(one, other) is Relation.CONTRADICTS
        ]
        voices = [other for other in against if other.claim.voice != K.claim.voice]
        if one.claim.is_measured:
            against = voices
        # What is stated of the whole frame shows nothing of an image that may be a part of it, however many state it.
        if not against or (one.claim.is_framed and not any(other.claim.is_framed for other in (K, *against))):
            return ()
        outside = one.claim.voice != K.claim.voice and any(v.claim.voice != one.claim.voice for v in voices)
        for other in self.placed:
            repeats = outside and other.claim.voice == one.claim.voice
            if other is not one and not repeats and self.relation(other, one) is Relation.CONFIRMS:
                return ()
        return K.claim.name, against[0].claim.name


MOST_ALLOWED: Final = 256
_known: dict[tuple[int, Intrinsics], tuple[Quality, Policy, Allowed]] = {}


def _allowed(K: Placed, policy: Policy, *, resaved: bool) -> Allowed:
    """What σ allows.

    The entries of a registry stay in memory, and a program resolves image after image: σ over the frame takes a hundred
    times as long as all else, and is asked for once.
    """
    quality = K.claim.calibration.quality
    if quality is None or resaved:
        return allowed(K.calibration, policy, is_valid=not resaved, resaved=resaved)
    at = id(quality), K.calibration.intrinsics
    known = _known.get(at)
    if known is not None and known[0] is quality and known[1] is policy:
        return known[2]
    found = allowed(K.calibration, policy)
    if len(_known) >= MOST_ALLOWED:
        _known.clear()
    _known[at] = (quality, policy, found)
    return found
