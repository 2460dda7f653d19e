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
from calibrary.validation import EDITED, PLAUSIBLE, Finding, Severity, Use, Verdict, validate


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


class Heard(Struct, frozen=True, kw_only=True):
    """What the other claims say of one.

    Attributes:
        claim: which.
        confirmed_by: the independent claims that confirm it.
        against: the claims that contradict it, those that are shown wrong among them.
        copies: the claims that have its numbers.
        near: the claims that neither confirm nor contradict it.
    """

    claim: Claim
    confirmed_by: tuple[Placed, ...] = ()
    against: tuple[Against, ...] = ()
    copies: tuple[Placed, ...] = ()
    near: tuple[Placed, ...] = ()


class Weighed(Heard, frozen=True, kw_only=True):
    """A claim among the others, and what follows of it.

    Attributes:
        ways: its K at the size of the images, by each reading that may stand; empty if no reading brings it there.
        settled: how the first of them came to stand.
        verdict: whether it may be used.
        use: what a solver may do with it, and why.
        findings: what speaks against it, the gravest first.
    """

    ways: tuple[Placed, ...]
    settled: Settled = Settled.AMBIGUOUS
    verdict: Verdict
    use: Allowed
    findings: tuple[Finding, ...] = ()

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
        return _computed(self.claim, self.confirmed_by, self.copies)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader of the answer should know besides: who is disbelieved by whom, and what was not judged."""
        others = (*self.copies, *self.confirmed_by, *self.near, *(one.one for one in self.against))
        is_judged = any(one.claim.is_measured for one in others)
        said = (one.message for one in self.disbelieved)
        return (*said, *(() if is_judged else (words.UNJUDGED_CENTRE,)))

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
        K, heard = self._at(claim), self.heard(claim)
        if K is None:
            found = words.not_this_frame(claim.name)
            use = Allowed(use=Use.NONE, why=found.message)
            return Weighed(claim=claim, ways=(), verdict=Verdict.UNPROVEN, use=use, findings=(found,))
        findings = sorted(self._findings(K, heard), key=lambda one: -[*Severity].index(one.severity))
        return Weighed(
            claim=claim,
            ways=K.ways,
            settled=K.settled,
            verdict=_verdict(findings),
            use=self._use(K, findings, heard.confirmed_by),
            findings=tuple(findings),
            confirmed_by=heard.confirmed_by,
            against=heard.against,
            copies=heard.copies,
            near=heard.near,
        )

    def heard(self, claim: Claim) -> Heard:
        """What the others say of a claim of this survey, for who needs neither its findings nor its use."""
        K = self._at(claim)
        if K is None:
            return Heard(claim=claim)
        said = [(one, self._relation(one, K)) for one in self.placed if one is not K]
        confirming = tuple(one for one, found in said if found is Relation.CONFIRMS)
        return Heard(
            claim=claim,
            confirmed_by=confirming,
            against=tuple(
                self._against(one, K, confirming) for one, found in said if found is Relation.CONTRADICTS
            ),
            copies=tuple(one for one, found in said if found is Relation.COPY),
            near=tuple(one for one, found in said if found in {Relation.COMPATIBLE, Relation.DEPENDENT}),
        )

    def _at(self, claim: Claim) -> Placed | None:
        """A claim at the size of the images; None if no reading brings it there."""
        return next((one for one in self.placed if one.claim is claim), None)

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

    def _relation(self, one: Placed, K: Placed) -> Relation:
        at = (min(id(one), id(K)), max(id(one), id(K)))
        if at not in self._relations:
            self._relations[at] = relate(one, K, self.policy)
        return self._relations[at]

    def _against(self, one: Placed, K: Placed, confirming: Sequence[Placed]) -> Against:
        shown_by, limit = self._shown_wrong(one, K, confirming), limit_between(one.claim, K.claim)
        return Against(one=one, K=K, policy=self.policy, limit=limit, shown_by=shown_by)

    def _shown_wrong(self, one: Placed, K: Placed, confirming: Sequence[Placed]) -> tuple[str, ...]:
        """The two that show a contradiction wrong, K and what confirms it; none if it is believed.

        What is measured is shown wrong by two voices; and where two speak against a third, what repeats that third is
        no support of it.
        """
        if not is_independent(one, K):
            return ()
        against = [
            other
            for other in confirming
            if is_independent(other, one) and self._relation(one, other) is Relation.CONTRADICTS
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
            if other is not one and not repeats and self._relation(other, one) is Relation.CONFIRMS:
                return ()
        return K.claim.name, against[0].claim.name

    def _findings(self, K: Placed, heard: Heard) -> Iterator[Finding]:
        settles = self.policy.independent_sources_settle
        for one in validate(K.calibration, self.policy).findings:
            if one.rule != PLAUSIBLE or not (settles and heard.confirmed_by):
                yield one
        if settles:
            yield from self._others(K, heard)
        for changed in not_described(K.claim.calibration, self.metadata.size, [self.original]):
            for done in changed.done:
                yield words.edited(
                    f"the image was {done}: nothing shows that this K describes it", self.policy
                )

    def _others(self, K: Placed, heard: Heard) -> Iterator[Finding]:
        """What the other claims say against it."""
        for other in heard.against:
            if not other.shown_by:
                yield other.finding(Severity.UNPROVEN, words.FIND_OUT)
        if K.settled is Settled.AMBIGUOUS:
            yield words.frame_unknown(K, [one for one in self.placed if one.claim.is_kept])
        computed = _computed(heard.claim, heard.confirmed_by, heard.copies)
        if computed is not None:
            yield words.computed(computed)

    def _use(self, K: Placed, findings: Sequence[Finding], confirming: Sequence[Placed]) -> Allowed:
        """What σ allows, and at most a start where the frame or its middle is taken for granted."""
        grave = [one for one in findings if one.severity in {Severity.ERROR, Severity.UNPROVEN}]
        is_saved = self.original.pixels is not Pixels.ALTERED and all(one.rule == EDITED for one in grave)
        if grave and not is_saved:
            return Allowed(use=Use.NONE, why=grave[0].message)
        found = _allowed(K, self.policy, resaved=bool(grave))
        if found.use is not Use.FIXED:
            return found
        made, now = K.claim.calibration.provenance.firmware, firmware(self.metadata)
        is_framed = K.settled is Settled.CONFIRMED or any(one.claim.is_framed for one in confirming)
        why = None
        if K.settled is Settled.USUAL or K.reading.centre_is_assumed:
            why = f"assumed: {', '.join(K.reading.assumes)}"
        elif made is not None and now is not None and made != now and not is_framed:
            why = f"it was measured with firmware {made}, and {now} may use another part of the sensor"
        return found if why is None else replace(found, use=Use.START, why=why)


def _computed(claim: Claim, confirming: Sequence[Placed], copies: Sequence[Placed]) -> str | None:
    """The name of the tag whose numbers a K has that is called measured; None if it is, or something confirms it."""
    if not claim.is_measured or confirming:
        return None
    return next((one.claim.name for one in copies if not one.claim.is_measured), None)


def _verdict(findings: Sequence[Finding]) -> Verdict:
    levels = {one.severity for one in findings}
    if Severity.ERROR in levels:
        return Verdict.REJECTED
    return Verdict.UNPROVEN if Severity.UNPROVEN in levels else Verdict.VALID


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
