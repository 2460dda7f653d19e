"""The rules on a K that images state themselves: what their other claims say of it, and what its tag leaves open.

Every rule is asked, even if another fails. Of a camera that is known, what is known of it decides; of another one,
whether its claims confirm or contradict each other; a policy that does not weigh claims has the literal limits of the
source document instead. A new rule is a function here and its place in :data:`RULES`; add what it finds to
``docs/reference/rules.md``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from shlex import quote
from typing import TYPE_CHECKING, Final, TypeAlias

from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.evidence.context import Source, SourceEstimate
from calibrary.evidence.optics import THERMAL
from calibrary.evidence.originality import Originality
from calibrary.evidence.readings import RESIZED
from calibrary.evidence.weighing import Cause, Evidence
from calibrary.jobs.survey import words
from calibrary.jobs.survey.claims import Claim, Who, is_statement, of_catalogue, of_entry, of_tag
from calibrary.jobs.survey.limits import CONFIRMS
from calibrary.jobs.survey.placing import Placed, Settled
from calibrary.jobs.survey.relating import gap
from calibrary.jobs.survey.survey import Against, Survey, Weighed
from calibrary.jobs.survey.words import CONTRADICTED
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.paths import id_of
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

if TYPE_CHECKING:
    from calibrary.registry.resolution import Resolution

NOT_STATED: Final = "its sensor size is not stated"
ASK_PIXELS: Final = (
    "'calibrary extract FOLDER --verify' asks the pixels which of the two is right; the entry stays unless they "
    "contradict it"
)
EXPLAINED: Final = frozenset({Cause.DIGITAL_ZOOM, Cause.CROP})
"""Causes of a disagreement that change the image in a way that K takes into account."""


class Own(Struct, frozen=True, kw_only=True):
    """A K of the tags of images.

    Attributes:
        chosen: the tag.
        stated: what the images with that tag state.
        evidence: what the images state that are judged; some may lack the tag, and take K over.
        weighed: K among all claims on these images.
        frame: the tag at the size of the images, by what else is stated of them; None if it is of that size.
        others: what the other tags state.
        edits: what was done to the images, each a sentence.
        image: path of one of them.
    """

    chosen: SourceEstimate
    stated: Evidence
    evidence: Evidence
    weighed: Weighed
    frame: Placed | None
    others: tuple[SourceEstimate, ...]
    edits: tuple[str, ...]
    image: str

    @property
    def calibration(self) -> Calibration:
        """K."""
        return self.weighed.claim.calibration

    @property
    def known(self) -> Placed | None:
        """What is known of this camera, not its tags alone; None if it is unknown."""
        return self.weighed.survey.known

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
    entry: Resolution | None,
    edits: Sequence[str],
    policy: Policy,
    image: str,
) -> Report:
    """Judge the K of images by all that is known of them.

    Args:
        calibration: the K.
        stated: of the images that state it.
        evidence: of the images that are judged.
        entry: the registry's for them.
        edits: what was done to them, each a sentence.
        policy: the limits.
        image: path of one of them.
    """
    chosen, camera = stated.chosen, calibration.camera
    assert chosen is not None  # noqa: S101  it gives the K
    claim = replace(of_tag(chosen, stated, camera, policy), calibration=calibration)
    others = tuple(one for one in dict.fromkeys((*evidence.estimates, *stated.estimates)) if one != chosen)
    tags = (of_tag(one, evidence, camera, policy) for one in others if is_statement(one))
    entries = (of_entry(entry, policy),) if entry is not None else ()
    claims = (claim, *tags, *of_catalogue(evidence, camera, policy), *entries)
    survey = Survey(evidence.scene.metadata, claims, policy)
    own = Own(
        chosen=chosen,
        stated=stated,
        evidence=evidence,
        weighed=survey.weigh(claim),
        frame=_frame(stated, calibration, survey),
        others=others,
        edits=tuple(edits),
        image=image,
    )
    return Report(policy=policy.name, findings=tuple(one for rule in RULES for one in rule(own, policy)))


def _frame(stated: Evidence, calibration: Calibration, survey: Survey) -> Placed | None:
    """The tag of a K as it is stated, among the other claims, without the K that was made of it."""
    chosen, scene, (_, *others) = stated.chosen, stated.scene, survey.claims
    assert chosen is not None  # noqa: S101  it gives the K
    is_of_many = scene.known is not None and scene.known.focal_35mm is None
    if scene.metadata.whole_frame is True or (is_of_many and scene.metadata.focal_35mm is not None):
        # A thumbnail tells that nothing was cut off since; and a body for many lenses writes the equivalent of the
        # part that it keeps. The reader of the tag has asked both.
        return None
    claim = of_tag(chosen, stated, calibration.camera, survey.policy)
    if claim.calibration.intrinsics.image_size == survey.metadata.size:
        return None
    placed = Survey(survey.metadata, (claim, *others), survey.policy).placed
    return next((one for one in placed if one.claim is claim), None)


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


def _focal_plausibility(own: Own, policy: Policy) -> Iterator[Finding]:
    """What is known of this very camera decides, then what its images confirm, only then what lenses in general have.

    Of 58 UAV cameras with a published focal length 40 are outside 0.8 … 1.5 W (tests/registry/test_catalogue.py).
    """
    weighs, settles = own.stated.scene.weighs, policy.independent_sources_settle
    widest = (policy.measured_over_width or policy.focal_over_width)[0]
    by = None
    if policy.known_camera_tolerance is not None and own.known is not None:
        if any(one.one is own.known for one in own.weighed.against):
            return
        by = f"as {own.known.claim.name} states it"
    # Two tags of a sensor size use the same FocalLength, so they agree even if it is wrong.
    elif settles and own.confirmed_by is not None and not (weighs and own.over_width < widest):
        by = f"confirmed independently by {own.confirmed_by}"
    if by is not None:
        message = f"fx = {own.over_width:.3f} W, {by}"
        yield Finding(rule=PLAUSIBLE, severity=Severity.PASS, measured=own.over_width, message=message)
    elif settles and not own.is_assumed:
        # An assumed sensor is no claim, so a K that rests on it can only be held to the band.
        yield _unconfirmed(own, policy)
    else:
        yield from OF_K[PLAUSIBLE](own.calibration, policy)


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


def _contradicted(own: Own, policy: Policy) -> Iterator[Finding]:
    """The claims that contradict K; a policy that does not weigh them warns of each tag beyond its limit."""
    if policy.independent_sources_settle:
        for against in own.weighed.against:
            is_tag = against.one.claim.who is Who.TAG
            found = _by_tag(own, against, policy) if is_tag else _by_known(own, against)
            if found is not None:
                stated = f"fx = {own.calibration.intrinsics.fx:.1f} px by {own.chosen.tag}"
                yield replace(found, message=f"{stated}, and {found.message}")
        return
    for one in own.others:
        limit, fx = max(policy.source_agreement, one.tolerance), one.intrinsics.fx
        if not own.apart(fx) <= limit:
            yield Finding(
                rule=CONTRADICTED,
                severity=Severity.WARNING,
                measured=own.apart(fx),
                limit=limit,
                message=f"{one.tag} states fx = {fx:.1f} px, {fx / own.calibration.intrinsics.fx - 1.0:+.1%}",
                remedy=f"find out which of the two is right; {REGISTER}",
            )


def _by_known(own: Own, against: Against) -> Finding:
    """What is known of the camera contradicts K: of several the first decides, which is the registry's entry."""
    claim = against.one.claim
    is_first = own.known is not None and own.known.claim is claim
    if against.shown_by or not is_first or not against.is_sure:
        return against.finding(Severity.WARNING, _compare(own, claim) if claim.is_measured else None)
    if claim.who is Who.CATALOGUE:
        # What is of the whole frame does not show wrong what an image states of its own, which may be a part of it.
        may_be_part = own.weighed.claim.is_framed and not own.weighed.claim.is_measured
        remedy = f"check the sensor size and the lens; if this unit differs, {REGISTER}"
        return against.finding(Severity.UNPROVEN if may_be_part else Severity.ERROR, remedy)
    # Either may be wrong: the entry may belong to another unit, or to the lens before a repair.
    are_measured = claim.is_measured and own.weighed.claim.is_measured
    return against.finding(Severity.UNPROVEN, _compare(own, claim) if are_measured else ASK_PIXELS)


def _compare(own: Own, entry: Claim) -> str:
    command = f"calibrary diff {id_of(entry.name)} {quote(own.image)}"
    return f"{command} compares them in this registry; approve the right one"


def _by_tag(own: Own, against: Against, policy: Policy) -> Finding | None:
    """Another tag contradicts K: a warning if what is known of the camera decides, or if it is outvoted."""
    other = next((one for one in own.others if one.tag == against.one.claim.name), None)
    if other is None:
        return None
    is_far = abs(gap(against.one, against.K)) > max(policy.source_agreement, other.tolerance)
    is_known = own.known is not None and own.known.claim.who is not Who.TAG
    if is_known and not is_far:
        return None
    cause = own.stated.cause(other.tag)
    # Where all rest on one FocalLength, that two of them agree does not show the third wrong.
    is_outvoted = against.shown_by and against.one.claim.voice != own.weighed.claim.voice
    severity = Severity.WARNING if is_known or is_outvoted else Severity.UNPROVEN
    if is_known and other.source is Source.FOCAL_35MM and cause not in EXPLAINED:
        # A telephoto before the lens, a mode of the camera that it does not name, or another camera of this name.
        severity = Severity.UNPROVEN
    # Between the two limits a tag does not confirm K, and does not reject it either.
    is_confirmed = own.confirmed_by is not None and not own.is_assumed
    if own.stated.scene.weighs and is_far and not is_confirmed:
        severity = Severity.ERROR
    remedy = f"find out which of the two is right; {REGISTER}"
    found = against.finding(severity, remedy)
    return found if cause is None else replace(found, message=f"{found.message}: {cause}")


def _frame_known(own: Own, policy: Policy) -> Iterator[Finding]:
    """A tag of another size, where nothing tells whether the frame was scaled or cut."""
    if own.frame is None or own.edits or not policy.independent_sources_settle:
        return
    if own.frame.settled is Settled.AMBIGUOUS or own.apart(own.frame.fx) > CONFIRMS:
        yield words.frame_unknown(own.frame, [])


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
        yield words.edited(one, policy)


def _sensor_or_register(own: Own) -> str:
    return f"{name_sensor(own.calibration.camera)}, or {REGISTER}"


Rule: TypeAlias = Callable[[Own, Policy], Iterator[Finding]]

RULES: Final[tuple[Rule, ...]] = (
    # A leak makes the focal length implausible, so it is reported first.
    _leak_35mm,
    _alone("focal-symmetry"),
    _alone("principal-point-drift"),
    _focal_plausibility,
    _alone("zero-skew"),
    _contradicted,
    _frame_known,
    _sensor_stated,
    _focal_stated,
    _camera_stated,
    _digital_zoom,
    _as_the_camera_wrote_it,
    _alone("distortion-monotonic"),
)
"""The rules in the order in which they are reported."""
