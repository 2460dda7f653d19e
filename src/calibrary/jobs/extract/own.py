"""The rules on a K that images state themselves: what their other claims say of it, and what its tag leaves open.

Every rule is asked, even if another fails. Of a camera that is known, what is known of it decides; of another one,
whether its claims confirm or contradict each other; a policy that does not weigh claims has the literal limits of the
source document instead. A new rule is a function here and its place in :data:`RULES`; add what it finds to
``docs/reference/rules.md``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final, TypeAlias

from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.evidence.context import Source, SourceEstimate
from calibrary.evidence.frame import RESIZED
from calibrary.evidence.optics import THERMAL
from calibrary.evidence.originality import Originality
from calibrary.evidence.weighing import Cause, Evidence
from calibrary.jobs.extract.knowledge import Known
from calibrary.jobs.survey import CATALOGUE, Heard, Placed, Survey, Who, limit_between, of_entry
from calibrary.jobs.survey.claims import Claim, is_statement, of_catalogue, of_tag
from calibrary.jobs.survey.limits import known_tolerance
from calibrary.jobs.survey.placing import Settled
from calibrary.jobs.survey.words import edited
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.validation import (
    GIVE_FILES,
    PLAUSIBLE,
    REGISTER,
    SENSOR_STATED,
    Finding,
    Report,
    Severity,
    name_sensor,
)
from calibrary.validation import RULES as OF_K

NOT_STATED: Final = "its sensor size is not stated"
EXPLAINED: Final = frozenset({Cause.DIGITAL_ZOOM, Cause.CROP})
"""Causes of a disagreement that change the image in a way that K takes into account."""


class Own(Struct, frozen=True, kw_only=True):
    """A K of the tags of images.

    Attributes:
        calibration: it.
        chosen: the tag.
        stated: what the images with that tag state.
        evidence: what the images state that are judged; some may lack the tag, and take K over.
        weighed: K among all claims on these images.
        known: what is known of this camera, not its tags alone; None if it is unknown.
        others: what the other tags state.
        edits: what was done to the images, each a sentence.
    """

    calibration: Calibration
    chosen: SourceEstimate
    stated: Evidence
    evidence: Evidence
    weighed: Heard
    known: Placed | None
    others: tuple[SourceEstimate, ...]
    edits: tuple[str, ...]

    @property
    def is_assumed(self) -> bool:
        """Whether it rests on an assumed sensor size."""
        return self.chosen.source is Source.ASSUMED_SENSOR

    @property
    def over_width(self) -> float:
        """Focal length ÷ image width."""
        return self.calibration.intrinsics.fx / self.calibration.intrinsics.image_size[0]

    @property
    def confirmed_by(self) -> str | None:
        """The name of another tag that confirms it; None if none does."""
        return next((one.claim.name for one in self.weighed.confirmed_by if one.claim.who is Who.TAG), None)

    def apart(self, fx: float) -> float:
        """Relative difference of a focal length from its."""
        return abs(fx / self.calibration.intrinsics.fx - 1.0)


def judged(
    calibration: Calibration,
    stated: Evidence,
    evidence: Evidence,
    known: Known,
    edits: Sequence[str],
    policy: Policy,
) -> Report:
    """Judge the K of images by all that is known of them.

    Args:
        calibration: the K.
        stated: of the images that state it.
        evidence: of the images that are judged.
        known: the registry's entry for them.
        edits: what was done to them, each a sentence.
        policy: the limits.
    """
    chosen = stated.chosen
    assert chosen is not None  # noqa: S101  it gives the K
    claim = replace(of_tag(chosen, stated, calibration.camera, policy), calibration=calibration)
    both = dict.fromkeys((*evidence.estimates, *stated.estimates))
    others = tuple(one for one in both if one != chosen)
    tags = (_here(one, evidence, calibration, policy) for one in others if is_statement(one))
    entry = (of_entry(known.resolution, policy),) if known.resolution is not None else ()
    claims = (claim, *tags, *of_catalogue(evidence, calibration.camera, policy), *entry)
    survey = Survey(evidence.scene.metadata, claims, policy)
    own = Own(
        calibration=calibration,
        chosen=chosen,
        stated=stated,
        evidence=evidence,
        weighed=survey.heard(claim),
        known=known_of(survey),
        others=others,
        edits=tuple(edits),
    )
    return Report(policy=policy.name, findings=tuple(one for rule in RULES for one in rule(own, policy)))


def _here(one: SourceEstimate, evidence: Evidence, own: Calibration, policy: Policy) -> Claim:
    """What a tag states, as its reader brought it to the size of the images."""
    claim = of_tag(one, evidence, own.camera, policy)
    return replace(claim, calibration=replace(claim.calibration, intrinsics=one.intrinsics))


def known_of(survey: Survey) -> Placed | None:
    """What is known of a camera besides its tags: the registry's entry, else the catalogue; None if nothing is.

    Of one whose catalogue states its pixels alone, that is EXIF's focal length over them.
    """
    found = [one for one in survey.placed if one.settled is not Settled.AMBIGUOUS]
    for who in (Who.ENTRY, Who.CATALOGUE, Who.TAG):
        for one in found:
            if one.claim.who is who and (who is not Who.TAG or CATALOGUE in one.claim.rests_on):
                return one
    return None


def edits_of(evidence: Evidence, original: Originality) -> Iterator[str]:
    """What was done to images since the camera wrote them, and what their K assumes of it, each a sentence.

    A sensor width and a 35 mm equivalent both refer to the full frame, so they agree for a centred crop as well.
    """
    yield from (f"the image was {done}" for done in original.done)
    chosen = evidence.chosen
    is_told = original.done or evidence.scene.metadata.whole_frame is True
    if evidence.scene.weighs and chosen is not None and RESIZED in chosen.assumptions and not is_told:
        yield "the image was resized, or cropped to the same proportions: its focal plane tags are of another size"


def _leak_35mm(own: Own, policy: Policy) -> Iterator[Finding]:
    """EXIF FocalLength equals the 35 mm equivalent, but the pixel pitch is not that of a 36 × 24 mm sensor."""
    metadata = own.evidence.scene.metadata
    focal_mm, focal_35mm = metadata.focal_mm, metadata.focal_35mm
    if focal_mm is None or focal_35mm is None:
        return
    prior = next((one for one in own.others if one.source is Source.FOCAL_35MM), None)
    # On a sensor of 36 × 24 mm both numbers are rightly equal, so K must also be far from what the equivalent gives.
    apart = own.apart(prior.intrinsics.fx) if prior is not None else 0.0
    limit = max(policy.source_agreement, prior.tolerance if prior is not None else 0.0)
    leaked = abs(focal_mm / focal_35mm - 1.0) <= 0.01 and apart > limit
    message = f"FocalLength {focal_mm:g} mm beside a 35 mm equivalent of {focal_35mm:g} mm"
    if leaked:
        message += f": the equivalent was written as the focal length, and fx is {apart:+.0%} from it"
    yield Finding(
        rule="no-35mm-leak",
        severity=Severity.ERROR if leaked else Severity.PASS,
        message=message,
        remedy=GIVE_FILES if leaked else None,
    )


def _alone(rule: str) -> Rule:
    """A rule that asks of nothing but K."""

    def found(own: Own, policy: Policy) -> Iterator[Finding]:
        yield from OF_K[rule](own.calibration, policy)

    return found


def _focal_symmetry(own: Own, policy: Policy) -> Iterator[Finding]:
    for found in OF_K["focal-symmetry"](own.calibration, policy):
        # Pixels are square, so a sensor with an aspect ratio other than the image's is not this camera's.
        yield _of_assumed(own, found, policy, "its sides are not those of the one assumed")


def _of_assumed(own: Own, found: Finding, policy: Policy, why: str) -> Finding:
    """A finding of K that rests on an assumed sensor: that another was assumed, and nothing of the focal length."""
    if found.severity is Severity.PASS or not (own.is_assumed and policy.assumed_sensor_is_unproven):
        return found
    message, remedy = f"{NOT_STATED}, and {why}", _sensor_or_register(own)
    return replace(found, severity=Severity.ERROR, message=message, remedy=remedy)


def _focal_plausibility(own: Own, policy: Policy) -> Iterator[Finding]:
    """What is known of this very camera decides, then what its images confirm, only then what lenses in general have.

    Of 58 UAV cameras with a published focal length 40 are outside 0.8 … 1.5 W (tests/registry/test_catalogue.py).
    """
    if policy.known_camera_tolerance is not None and own.known is not None:
        yield _against_known(own, own.known, policy)
        return
    weighs, settles = own.stated.scene.weighs, policy.independent_sources_settle
    widest = (policy.measured_over_width or policy.focal_over_width)[0]
    # Two tags of a sensor size use the same FocalLength, so they agree even if it is wrong.
    if settles and own.confirmed_by is not None and not (weighs and own.over_width < widest):
        message = f"fx = {own.over_width:.3f} W, confirmed independently by {own.confirmed_by}"
        yield Finding(rule=PLAUSIBLE, severity=Severity.PASS, measured=own.over_width, message=message)
    elif settles and weighs and not own.is_assumed:
        # An assumed sensor is no claim, so a K that rests on it can only be held to the band.
        yield _unconfirmed(own, policy)
    else:
        for found in OF_K[PLAUSIBLE](own.calibration, policy):
            yield _of_assumed(own, found, policy, "is not the one assumed")


def _unconfirmed(own: Own, policy: Policy) -> Finding:
    """The single claim of an unknown camera: rejected if no lens has this fx, otherwise unproven."""
    fx_over_w, is_given = own.over_width, own.chosen.source in {Source.GIVEN_SENSOR, Source.STATED}
    low, high = policy.measured_over_width or policy.focal_over_width
    usual = policy.focal_over_width
    severity, limit = Severity.UNPROVEN, None
    if not low <= fx_over_w <= high:
        severity, limit = Severity.ERROR, low if fx_over_w < low else high
        message = f"fx = {fx_over_w:.3f} W, expected {low:g} … {high:g} W of any lens"
    elif is_given and usual[0] <= fx_over_w <= usual[1]:
        severity, message = Severity.PASS, f"fx = {fx_over_w:.3f} W by the sensor that was given"
    else:
        message = f"fx = {fx_over_w:.3f} W by {own.chosen.tag} alone: nothing confirms it"
    # A sensor that was given is not asked for again.
    other = "ask the pixels (--verify)" if is_given else name_sensor(own.calibration.camera)
    return Finding(
        rule=PLAUSIBLE,
        severity=severity,
        measured=fx_over_w,
        limit=limit,
        message=message,
        remedy=None if severity is Severity.PASS else f"{REGISTER}, or {other}",
    )


def _against_known(own: Own, known: Placed, policy: Policy) -> Finding:
    claim, is_entry = known.claim, known.claim.who is Who.ENTRY
    measured = own.calibration.intrinsics.fx / known.fx - 1.0
    limit = _limit_of(own, known, policy)
    shown_by = next((one.shown_by for one in own.weighed.against if one.one.claim is claim), ())
    severity, by, more, remedy = Severity.PASS, "", "", None
    of = "the registry's " if is_entry else "the catalogue's "
    if abs(measured) <= limit:
        pass
    elif shown_by:
        severity, more = Severity.WARNING, f"; it is not believed: {' and '.join(shown_by)} show it wrong"
    elif is_entry:
        # Either may be wrong: the entry may belong to another unit, or to the lens before a repair.
        severity, by, of = Severity.UNPROVEN, f" by {own.chosen.tag}", f"{claim.name}'s "
        more = ", the approved entry of the registry"
        remedy = (
            f"'calibrary extract FOLDER --verify' asks the pixels which of the two is right; {claim.name} stays "
            "unless they contradict it"
        )
    else:
        severity = Severity.ERROR
        remedy = f"check the sensor size and the lens; if this unit differs, {REGISTER}"
    found = f"fx = {own.calibration.intrinsics.fx:.1f} px{by} is {measured:+.2%} from {of}"
    return Finding(
        rule=PLAUSIBLE,
        severity=severity,
        measured=measured,
        limit=limit,
        message=f"{found}{known.fx:.1f} px for this camera, at most ±{limit:.1%}{more}",
        remedy=remedy,
    )


def _limit_of(own: Own, known: Placed, policy: Policy) -> float:
    """How far K may be from what is known of its camera, as a fraction."""
    if known.claim.who is not Who.ENTRY:
        return known.claim.tolerance
    if not (known.claim.is_measured and own.weighed.claim.is_measured):
        return limit_between(own.weighed.claim, known.claim)
    # Units of a model differ; that one unit moved is told as a distance over the frame.
    granted = known.claim.granted
    return granted if granted is not None else known_tolerance(policy)


def _source_agreement(own: Own, policy: Policy) -> Iterator[Finding]:
    causes = {one.other.tag: one.cause for one in own.stated.conflicts}
    for one, limit, severity in _contradicting(own, policy, causes):
        fx = one.intrinsics.fx
        message = f"{one.tag} states fx = {fx:.1f} px, {fx / own.calibration.intrinsics.fx - 1.0:+.1%}"
        if (cause := causes.get(one.tag)) is not None:
            message += f": {cause.value}"
        yield Finding(
            rule="source-agreement",
            severity=severity,
            measured=own.apart(fx),
            limit=limit,
            message=message,
            remedy=f"find out which of the two is right; {REGISTER}",
        )


def _contradicting(
    own: Own, policy: Policy, causes: Mapping[str, Cause]
) -> Iterator[tuple[SourceEstimate, float, Severity]]:
    """The other tags that contradict K, by how much they may, and what follows of it."""
    if not policy.independent_sources_settle:
        for one in own.others:
            limit = max(policy.source_agreement, one.tolerance)
            if not own.apart(one.intrinsics.fx) <= limit:
                yield one, limit, Severity.WARNING
        return
    is_known = own.known is not None and own.known.claim.who is not Who.TAG
    for against in own.weighed.against:
        other = next((one for one in own.others if one.tag == against.one.claim.name), None)
        if other is None:
            continue
        limit = max(policy.source_agreement, other.tolerance)
        is_far = own.apart(other.intrinsics.fx) > limit
        if is_known and not is_far:
            continue
        # Where all rest on one FocalLength, that two of them agree does not show the third wrong.
        is_outvoted = against.shown_by and against.one.claim.voice != own.weighed.claim.voice
        severity = Severity.WARNING if is_known or is_outvoted else Severity.UNPROVEN
        if is_known and other.source is Source.FOCAL_35MM and causes.get(other.tag) not in EXPLAINED:
            # A telephoto before the lens, a mode of the camera that it does not name, or another camera of this name.
            severity = Severity.UNPROVEN
        # Between the two limits a tag does not confirm K, and does not reject it either.
        is_confirmed = own.confirmed_by is not None and not own.is_assumed
        if own.stated.scene.weighs and is_far and not is_confirmed:
            severity = Severity.ERROR
        yield other, limit if is_known else against.limit, severity


def _sensor_stated(own: Own, policy: Policy) -> Iterator[Finding]:
    if own.is_assumed:
        yield Finding(
            rule=SENSOR_STATED,
            severity=Severity.UNPROVEN if policy.assumed_sensor_is_unproven else Severity.WARNING,
            message=f"{NOT_STATED}; K rests on an assumed one",
            remedy=_sensor_or_register(own),
        )


def _focal_stated(own: Own, _: Policy) -> Iterator[Finding]:
    why = _no_focal(own.stated) if own.chosen.source is Source.CATALOGUE_DESIGN else None
    if why is not None:
        yield Finding(
            rule="focal-stated",
            severity=Severity.UNPROVEN,
            message=f"{why}; K is the catalogue's, and nothing in the image confirms the lens",
            remedy=f"ask the pixels (--verify), or {REGISTER}",
        )


def _camera_stated(own: Own, _: Policy) -> Iterator[Finding]:
    stated = own.stated.scene.metadata.stated
    if stated and not own.calibration.grade.is_measured:
        what = " and ".join(name for name in ("camera", "focal length") if name.split()[0] in stated)
        yield Finding(
            rule="camera-stated",
            severity=Severity.UNPROVEN,
            message=f"nothing in the image confirms the {what} that you state",
            remedy=f"ask the pixels (--verify), or {REGISTER}",
        )


def _no_focal(evidence: Evidence) -> str | None:
    """Why the catalogue's lens is used, unconfirmed by the image; None if the camera writes no FocalLength."""
    scene = evidence.scene
    if not scene.fills or scene.focal_mm is not None:
        return None
    fault = scene.metadata.fault("EXIF FocalLength")
    if fault is not None:
        return f"EXIF FocalLength is {fault.found}, expected {fault.expected}"
    if scene.metadata.focal_mm is not None:
        return f"EXIF FocalLength is {scene.metadata.focal_mm:g} mm, and this camera is known to write a wrong one"
    is_thermal = scene.known is not None and scene.known.sub_camera == THERMAL
    return None if is_thermal else "EXIF has no FocalLength"


def _digital_zoom(own: Own, policy: Policy) -> Iterator[Finding]:
    """For an unknown camera, K with digital zoom and K without it are contradicting claims."""
    zoom = own.evidence.scene.written.zoom
    if zoom <= 1.0:
        return
    severity = Severity.UNPROVEN if policy.assumed_sensor_is_unproven else Severity.WARNING
    # They contradict each other beyond the tolerances of both.
    contradicts = own.stated.scene.weighs and zoom > 1.0 + 2 * policy.source_agreement
    if contradicts and policy.independent_sources_settle and (own.confirmed_by is None or own.is_assumed):
        severity = Severity.ERROR
    yield Finding(
        rule="digital-zoom",
        severity=severity,
        message=f"digital zoom {zoom:.3g}× is on, and no tag states how it changed the image",
        remedy="fly without digital zoom, or calibrate and register this zoom state",
    )


def _as_the_camera_wrote_it(own: Own, policy: Policy) -> Iterator[Finding]:
    """A program that crops, resizes or corrects an image moves its pixels, and mostly leaves the tags unchanged."""
    for one in own.edits:
        yield edited(one, policy)


def _sensor_or_register(own: Own) -> str:
    return f"{name_sensor(own.calibration.camera)}, or {REGISTER}"


Rule: TypeAlias = Callable[[Own, Policy], Iterator[Finding]]

RULES: Final[tuple[Rule, ...]] = (
    # A leak makes the focal length implausible, so it is reported first.
    _leak_35mm,
    _focal_symmetry,
    _alone("principal-point-drift"),
    _focal_plausibility,
    _alone("zero-skew"),
    _source_agreement,
    _sensor_stated,
    _focal_stated,
    _camera_stated,
    _digital_zoom,
    _as_the_camera_wrote_it,
    _alone("distortion-monotonic"),
)
"""The rules in the order in which they are reported."""
