"""Validation of K before it reaches a solver: a policy's limits, rules that give a verdict, and how to add one.

Every rule is evaluated, even if another fails, and NaN fails every rule. Two policies are shipped: ``source``
requires fx / W of every camera to be in one range; ``fleet`` compares a known camera with its expected fx,
because most UAV cameras are outside that range, and judges an unknown camera by whether the sources in its
images confirm or contradict each other.

A new rule is a function here and its row in :data:`RULES`:

1.  Write the function. It yields a :class:`Finding` with the rule's name, also when K passes, or nothing where the rule
    does not apply. Compare as ``measured <= limit``, so that NaN fails. ``message`` says what was found and what was
    expected, ``remedy`` what to do; a rule that fails has one.
2.  Give it a row in :data:`RULES`, in the order in which findings are reported.
3.  A limit is a field of :class:`~calibrary.policy.Policy`, with its bounds and one line under ``Attributes``. The
    policy ``source`` holds the source document's limits alone: switch the rule off in it, unless that document has it.
    Run ``make schemas``.
4.  What the rule must know besides K is a field of :class:`ValidationContext`; what makes the context of an image's K
    is ``jobs/extract/judging.py``. Without that fact a rule says nothing, because entries and files lack it.
5.  Add what it finds to ``docs/reference/rules.md``, and a K that breaks it to ``BROKEN`` in
    ``tests/core/test_validation_remedies.py``; its own tests are in ``tests/core/test_validation.py``.

The tests name each of these that is missing.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Iterator, Mapping
from enum import StrEnum
from typing import Final, TypeAlias

import numpy as np
from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey
from calibrary.policy import Policy
from calibrary.records import Json, Record, replace


class Severity(StrEnum):
    """Effect of a finding on the verdict, mildest first; only the last two prevent the use of a K."""

    PASS = "pass"  # noqa: S105  a word of the report, not a password
    NOTE = "note"
    WARNING = "warning"
    UNPROVEN = "unproven"
    ERROR = "error"


EDITED: Final = "as-recorded"
"""Rule that finds images which are not as the camera wrote them; its message states their number."""

UNPROVEN_LEGEND = "unproven: plausible, but no second source confirms it, or one contradicts it"
"""Explanation of the verdict, printed once in every report."""


class Verdict(StrEnum):
    """Whether a K may be used.

    Unproven: plausible, but no second source confirms it, or one contradicts it.

    >>> calibrary.extract("survey").cameras[0].verdict is calibrary.Verdict.VALID
    True
    """

    VALID = "valid"
    UNPROVEN = "unproven"
    REJECTED = "rejected"


class Finding(Record):
    """Result of one rule, as reported by validation, the registry check, an audit and a board calibration.

    Attributes:
        rule: name of the rule.
        severity: effect on the verdict.
        camera: camera in words, if the findings concern several cameras.
        place: entry or file, if the findings concern several.
        measured: measured value, in the unit that the message names; None if the rule measures none.
        limit: limit of the measured value.
        message: what was found and what was expected.
        remedy: what to do; None if there is nothing to do.
    """

    rule: str
    severity: Severity
    camera: str | None = None
    place: str | None = None
    measured: float | None = None
    limit: float | None = None
    message: str
    remedy: str | None = None

    def __str__(self) -> str:
        where = f"{self.place}: " if self.place else ""
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{where}{self.rule}: {self.message}{remedy}"

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        # A rule that measured NaN fails; JSON cannot represent NaN.
        stated = {name: document[name] for name in ("measured", "limit")}
        finite = {name: value if _is_finite(value) else None for name, value in stated.items()}
        return document | finite


def _is_finite(value: Json) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


class Report(Record):
    """The findings of all rules, and the verdict that follows from them.

    Attributes:
        policy: name of the policy that was used.
        findings: of all rules.

    >>> report = calibrary.validate(calibrary.read("camera.xml"), calibrary.FLEET)
    >>> report.policy, report.verdict.value, report.failures
    ('fleet', 'valid', ())
    """

    policy: str
    findings: tuple[Finding, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The verdict, determined by the most severe finding."""
        severities = {finding.severity for finding in self.findings}
        if Severity.ERROR in severities:
            return Verdict.REJECTED
        return Verdict.UNPROVEN if Severity.UNPROVEN in severities else Verdict.VALID

    @property
    def failures(self) -> tuple[Finding, ...]:
        """The findings that prevent a valid verdict, most severe first."""
        errors = [f for f in self.findings if f.severity is Severity.ERROR]
        return (*errors, *(f for f in self.findings if f.severity is Severity.UNPROVEN))

    @property
    def remedy(self) -> str | None:
        """What to do first, or None for a valid K. A missing sensor size precedes its consequences."""
        if not self.failures:
            return None
        unstated = next((f for f in self.findings if f.rule == "sensor-stated"), None)
        return (unstated or self.failures[0]).remedy


REGISTER = "register the camera (--registry)"
GIVE_FILES = "provide the original files from the camera"
NOT_STATED = "its sensor size is not stated"
NOTHING_CONFIRMS = "alone: nothing confirms it"


def name_sensor(camera: CameraKey) -> str:
    """The advice to state the sensor's size of a camera, by the flag that also serves a run of several cameras."""
    if camera.model is None:
        return "name the sensor in mm (--sensor-width-mm, --sensor-height-mm)"
    name = " ".join(word for word in (camera.model, camera.sub_camera) if word)
    return f"name the sensor in mm (--sensor {shlex.quote(name)}=WxH)"


def _sensor_or_register(camera: CameraKey) -> str:
    return f"{name_sensor(camera)}, or {REGISTER}"


class Expected(Struct, frozen=True, kw_only=True):
    """Expected fx of a known camera, at the image size of the calibration.

    Attributes:
        fx: px.
        spread: relative tolerance known for this camera, None for the policy's.
        tolerance: relative tolerance of the registry entry, which replaces the policy's.
        source: "catalogue" or "registry".
        entry: path of the registry entry that states it.
        by_exif_focal: whether it is EXIF FocalLength ÷ known pitch, so that comparing cannot reveal a wrong
            FocalLength.
    """

    fx: float
    spread: float | None = None
    tolerance: float | None = None
    source: str
    entry: str | None = None
    by_exif_focal: bool = False


class NamedFocal(Struct, frozen=True, kw_only=True):
    """Focal length from another source, at the image size of the calibration.

    Attributes:
        name: tag of the source.
        fx: px.
        tolerance: relative rounding of the source itself.
        cause: most likely cause if it disagrees.
        independent: whether it shares no input with the validated source, so that agreement confirms K.
        confirms_within: largest relative difference that counts as agreement; None for the policy's.
        is_explained: whether the cause of its disagreement changes the image in a way that K takes into account.
    """

    name: str
    fx: float
    tolerance: float = 0.0
    cause: str | None = None
    independent: bool = True
    confirms_within: float | None = None
    is_explained: bool = False


class ValidationContext(Struct, frozen=True, kw_only=True):
    """What is known about a calibration and its camera when it is validated.

    Attributes:
        expected: expected fx of a known camera.
        others: focal lengths from the other sources.
        focal_mm, focal_35mm: from EXIF, if the K is based on them.
        weighed: whether the camera is unknown, so that only the sources in its images can be compared.
        sensor_assumed: whether the K is based on an assumed sensor size.
        sensor_given: whether the K is based on a sensor size stated by the user.
        no_focal: why the catalogue's focal length is used, in words; None if the image states one, or none is needed.
        zoom: factor by which digital zoom may have enlarged the image; K depends on how the camera applies it.
        edits: what was done to the image after the camera wrote it, each a sentence.
        spread: spread of K over the images of this camera, as a fraction of fx.
    """

    expected: Expected | None = None
    others: tuple[NamedFocal, ...] = ()
    focal_mm: float | None = None
    focal_35mm: float | None = None
    weighed: bool = False
    sensor_assumed: bool = False
    sensor_given: bool = False
    no_focal: str | None = None
    zoom: float = 1.0
    edits: tuple[str, ...] = ()
    spread: float | None = None


def validate(calibration: Calibration, policy: Policy, context: ValidationContext | None = None) -> Report:
    """Validate a calibration against a policy; every rule is evaluated.

    Args:
        calibration: K and distortion.
        policy: limits of the rules.
        context: what is known of the camera besides; without it, some rules find nothing to compare with.

    >>> calibrary.validate(calibrary.read("camera.xml"), calibrary.SOURCE).failures[0].rule
    'focal-plausibility'
    """
    context = context or ValidationContext()
    findings = tuple(f for rule in RULES.values() for f in rule(calibration, policy, context))
    return Report(policy=policy.name, findings=findings)


def lacks_confirmation(finding: Finding) -> bool:
    """Whether the only problem is that K has a single source, so that a second source would resolve it."""
    return finding.severity is Severity.UNPROVEN and finding.message.endswith(NOTHING_CONFIRMS)


def _focal_symmetry(c: Calibration, policy: Policy, context: ValidationContext) -> Iterator[Finding]:
    K = c.intrinsics
    measured = abs(K.fx - K.fy) / max(K.fx, K.fy)
    limit = policy.focal_symmetry_max
    severity = Severity.PASS
    if not measured <= limit:
        severity = Severity.ERROR
    elif policy.focal_symmetry_proven is not None and not measured <= policy.focal_symmetry_proven:
        severity, limit = Severity.UNPROVEN, policy.focal_symmetry_proven
        if context.sensor_assumed and policy.assumed_sensor_is_unproven:
            # Pixels are square, so a sensor with an aspect ratio other than the image's is not this camera's.
            severity = Severity.ERROR
    message, remedy = f"fx and fy differ by {measured:.2%}, at most {limit:.2%}", None
    if severity is not Severity.PASS and context.sensor_assumed and policy.assumed_sensor_is_unproven:
        message, remedy = (
            f"{NOT_STATED}, and its sides are not those of the one assumed",
            _sensor_or_register(c.camera),
        )
    elif severity is not Severity.PASS:
        message += ": a wrong sensor size, a transcoded frame, or corrupt EXIF"
        remedy = f"check the sensor size, or {GIVE_FILES}"
    yield Finding(
        rule="focal-symmetry",
        severity=severity,
        measured=measured,
        limit=limit,
        message=message,
        remedy=remedy,
    )


def _principal_point(c: Calibration, policy: Policy, _: ValidationContext) -> Iterator[Finding]:
    K, (width, height) = c.intrinsics, c.intrinsics.image_size
    measured = max(abs(K.cx - width / 2) / width, abs(K.cy - height / 2) / height)
    limit = policy.principal_point_drift_max
    ok = measured <= limit
    message = (
        f"principal point is {measured:.2%} of the image size from the image centre, at most {limit:.2%}"
    )
    if not ok:
        message += ": a decentred lens, or a K of another image size"
    yield Finding(
        rule="principal-point-drift",
        severity=Severity.PASS if ok else Severity.ERROR,
        measured=measured,
        limit=limit,
        message=message,
        remedy=None if ok else "check the image size of this calibration, or calibrate again",
    )


def _focal_plausibility(c: Calibration, policy: Policy, context: ValidationContext) -> Iterator[Finding]:
    # What is known of this very camera decides, then what its images confirm, only then what lenses in general have: of
    # 58 UAV cameras with a published focal length 40 are outside 0.8 … 1.5 W (tests/registry/test_catalogue.py).
    expected = context.expected
    if policy.known_camera_tolerance is not None and expected is not None:
        # Units of some models scatter by more than the policy allows; what a registry entry states replaces both.
        usual = max(policy.known_camera_tolerance, expected.spread or 0.0)
        yield _against_known(c, expected, expected.tolerance if expected.tolerance is not None else usual)
        return
    confirming = _agreeing(c, policy, context)
    fx_over_w = c.intrinsics.fx / c.intrinsics.image_size[0]
    widest = (policy.measured_over_width or policy.focal_over_width)[0]
    # Two sources of a sensor size use the same FocalLength, so they agree even if it is wrong.
    if confirming is not None and not (context.weighed and fx_over_w < widest):
        message = f"fx = {fx_over_w:.3f} W, confirmed independently by {confirming.name}"
        yield Finding(rule="focal-plausibility", severity=Severity.PASS, measured=fx_over_w, message=message)
        return
    # An assumed sensor is no source, so a K that rests on it can only be held to the band.
    if context.weighed and policy.independent_sources_settle and not context.sensor_assumed:
        yield _unconfirmed(c, policy, context)
        return
    found = _within_band(c, policy)
    if found.severity is not Severity.PASS and context.sensor_assumed and policy.assumed_sensor_is_unproven:
        # The band shows that the assumed size is not this camera's, and nothing of its focal length.
        found = replace(
            found,
            message=f"{NOT_STATED}, and is not the one assumed",
            remedy=_sensor_or_register(c.camera),
        )
    yield found


def _confirming(c: Calibration, policy: Policy, context: ValidationContext) -> NamedFocal | None:
    """An independent source that confirms K; None if there is none or K is based on an assumed sensor."""
    return None if context.sensor_assumed else _agreeing(c, policy, context)


def _agreeing(c: Calibration, policy: Policy, context: ValidationContext) -> NamedFocal | None:
    """An independent source that agrees with K; None if there is none or the policy does not use such sources."""
    if not policy.independent_sources_settle:
        return None
    # Rounding can explain a disagreement, but it does not prove agreement (a 35 mm equivalent of 1).
    return next((o for o in context.others if o.independent and _apart(c, o) <= _near(o, policy)), None)


def _near(other: NamedFocal, policy: Policy) -> float:
    within = other.confirms_within
    return policy.source_agreement if within is None else min(within, policy.source_agreement)


def _unconfirmed(c: Calibration, policy: Policy, context: ValidationContext) -> Finding:
    """Judge the single source of an unknown camera: rejected if no lens has this fx, otherwise unproven."""
    fx_over_w = c.intrinsics.fx / c.intrinsics.image_size[0]
    low, high = policy.measured_over_width or policy.focal_over_width
    usual = policy.focal_over_width
    severity, limit = Severity.UNPROVEN, None
    if not low <= fx_over_w <= high:
        severity, limit = Severity.ERROR, low if fx_over_w < low else high
        message = f"fx = {fx_over_w:.3f} W, expected {low:g} … {high:g} W of any lens"
    else:
        message = f"fx = {fx_over_w:.3f} W by {c.provenance.tag or c.provenance.kind} {NOTHING_CONFIRMS}"
        if context.sensor_given and usual[0] <= fx_over_w <= usual[1]:
            severity, message = Severity.PASS, f"fx = {fx_over_w:.3f} W by the sensor that was given"
    # A sensor that was given is not asked for again.
    other = "ask the pixels (--verify)" if context.sensor_given else name_sensor(c.camera)
    return Finding(
        rule="focal-plausibility",
        severity=severity,
        measured=fx_over_w,
        limit=limit,
        message=message,
        remedy=None if severity is Severity.PASS else f"{REGISTER}, or {other}",
    )


def _within_band(c: Calibration, policy: Policy) -> Finding:
    fx_over_w = c.intrinsics.fx / c.intrinsics.image_size[0]
    # A K that was measured may be of any real lens. The narrow band is for arithmetic on tags, where a wrong sensor
    # size or a 35 mm equivalent is likelier than a rare lens.
    measured = c.provenance.kind != "image-metadata" and c.grade.is_metric
    low, high = (policy.measured_over_width if measured else None) or policy.focal_over_width
    in_band = low <= fx_over_w <= high
    message, remedy = f"fx = {fx_over_w:.3f} W, expected {low:g} … {high:g} W", None
    if not in_band:
        message += ": a 35 mm equivalent or a wrong sensor size, unless the lens has this focal length"
        knows = policy.known_camera_tolerance is not None
        way = REGISTER if knows else "use --policy fleet, which has limits for known cameras"
        remedy = f"check the sensor size; if the focal length is right, {way}"
    return Finding(
        rule="focal-plausibility",
        severity=Severity.PASS if in_band else Severity.ERROR,
        measured=fx_over_w,
        limit=low if fx_over_w < low else high,
        message=message,
        remedy=remedy,
    )


def _against_known(c: Calibration, expected: Expected, limit: float) -> Finding:
    measured = c.intrinsics.fx / expected.fx - 1.0
    ok = abs(measured) <= limit
    severity = Severity.PASS if ok else Severity.ERROR
    by, of = "", f"the {expected.source}'s "
    remedy = f"check the sensor size and the lens; if this unit differs, {REGISTER}"
    if not ok and expected.entry is not None and c.provenance.kind == "image-metadata":
        # Either may be wrong: the entry may belong to another unit, or to the lens before a repair.
        severity, by, of = Severity.UNPROVEN, f" by {c.provenance.tag}", f"{expected.entry}'s "
        remedy = (
            f"'calibrary extract FOLDER --verify' asks the pixels which of the two is right; {expected.entry} stays "
            "unless they contradict it"
        )
    message = f"fx = {c.intrinsics.fx:.1f} px{by} is {measured:+.2%} from {of}"
    message += f"{expected.fx:.1f} px for this camera, at most ±{limit:.1%}"
    if of == f"{expected.entry}'s ":
        message += ", the approved entry of the registry"
    return Finding(
        rule="focal-plausibility",
        severity=severity,
        measured=measured,
        limit=limit,
        message=message,
        remedy=None if ok else remedy,
    )


def _zero_skew(c: Calibration, policy: Policy, _: ValidationContext) -> Iterator[Finding]:
    measured = abs(c.intrinsics.skew) / c.intrinsics.fx
    ok = measured <= policy.skew_max
    yield Finding(
        rule="zero-skew",
        severity=Severity.PASS if ok else Severity.ERROR,
        measured=measured,
        limit=policy.skew_max,
        message=f"skew is {c.intrinsics.skew:g} px, expected {'0' if policy.skew_max == 0 else 'close to 0'}",
        remedy=None if ok else "calibrate with skew fixed at 0",
    )


def _leak_35mm(c: Calibration, policy: Policy, context: ValidationContext) -> Iterator[Finding]:
    """EXIF FocalLength equals the 35 mm equivalent, but the pixel pitch is not that of a 36 × 24 mm sensor."""
    focal_mm, focal_35mm = context.focal_mm, context.focal_35mm
    if focal_mm is None or focal_35mm is None:
        return
    prior = next((o for o in context.others if o.name == "EXIF FocalLengthIn35mmFilm"), None)
    apart = _apart(c, prior) if prior is not None else 0.0
    # On a sensor of 36 × 24 mm both numbers are rightly equal, so K must also be far from what the equivalent gives.
    leaked = abs(focal_mm / focal_35mm - 1.0) <= 0.01 and apart > max(
        policy.source_agreement, prior.tolerance if prior else 0.0
    )
    message = f"FocalLength {focal_mm:g} mm beside a 35 mm equivalent of {focal_35mm:g} mm"
    if leaked:
        message += f": the equivalent was written as the focal length, and fx is {apart:+.0%} from it"
    yield Finding(
        rule="no-35mm-leak",
        severity=Severity.ERROR if leaked else Severity.PASS,
        message=message,
        remedy=GIVE_FILES if leaked else None,
    )


def _source_agreement(c: Calibration, policy: Policy, context: ValidationContext) -> Iterator[Finding]:
    settles = policy.independent_sources_settle
    confirmed = _confirming(c, policy, context) is not None
    for other in context.others:
        measured = _apart(c, other)
        # Of an unknown camera a source must agree as closely as it can confirm; its own rounding never contradicts.
        limit = max(_near(other, policy) if context.weighed else policy.source_agreement, other.tolerance)
        if measured <= limit:
            continue
        # A known camera is compared with its expected fx; for an unknown one either source may be wrong.
        is_known = context.expected is not None and not context.expected.by_exif_focal
        severity = Severity.WARNING if is_known or not settles else Severity.UNPROVEN
        if settles and is_known and other.name == "EXIF FocalLengthIn35mmFilm" and not other.is_explained:
            # A telephoto before the lens, a mode of the camera that it does not name, or another camera of this name.
            severity = Severity.UNPROVEN
        # Between the two limits a source does not confirm K, and does not reject it either.
        far = measured > max(policy.source_agreement, other.tolerance)
        if settles and context.weighed and far and not confirmed:
            severity = Severity.ERROR
        message = f"{other.name} states fx = {other.fx:.1f} px, {other.fx / c.intrinsics.fx - 1.0:+.1%}"
        if other.cause:
            message += f": {other.cause}"
        yield Finding(
            rule="source-agreement",
            severity=severity,
            measured=measured,
            limit=limit,
            message=message,
            remedy=f"find out which of the two is right; {REGISTER}",
        )


def _sensor_stated(c: Calibration, policy: Policy, context: ValidationContext) -> Iterator[Finding]:
    if not context.sensor_assumed:
        return
    yield Finding(
        rule="sensor-stated",
        severity=Severity.UNPROVEN if policy.assumed_sensor_is_unproven else Severity.WARNING,
        message=f"{NOT_STATED}; K rests on an assumed one",
        remedy=_sensor_or_register(c.camera),
    )


def _focal_stated(_: Calibration, __: Policy, context: ValidationContext) -> Iterator[Finding]:
    if context.no_focal is not None:
        yield Finding(
            rule="focal-stated",
            severity=Severity.UNPROVEN,
            message=f"{context.no_focal}; K is the catalogue's, and nothing in the image confirms the lens",
            remedy=f"ask the pixels (--verify), or {REGISTER}",
        )


def _digital_zoom(c: Calibration, policy: Policy, context: ValidationContext) -> Iterator[Finding]:
    """For an unknown camera, K with digital zoom and K without it are contradicting sources."""
    if context.zoom <= 1.0:
        return
    severity = Severity.UNPROVEN if policy.assumed_sensor_is_unproven else Severity.WARNING
    # K with the zoom and K without it are two sources: they contradict each other beyond the tolerances of both.
    contradicts = context.weighed and context.zoom > 1.0 + 2 * policy.source_agreement
    if contradicts and policy.independent_sources_settle and _confirming(c, policy, context) is None:
        severity = Severity.ERROR
    yield Finding(
        rule="digital-zoom",
        severity=severity,
        message=f"digital zoom {context.zoom:.3g}× is on, and no tag states how it changed the image",
        remedy="fly without digital zoom, or calibrate and register this zoom state",
    )


def _as_the_camera_wrote_it(_: Calibration, policy: Policy, context: ValidationContext) -> Iterator[Finding]:
    """A program that crops, resizes or corrects an image moves its pixels, and mostly leaves the tags unchanged."""
    for edit in context.edits:
        yield Finding(
            rule=EDITED,
            severity=Severity.UNPROVEN if policy.assumed_sensor_is_unproven else Severity.WARNING,
            message=edit,
            remedy=GIVE_FILES,
        )


def _distortion_monotonic(c: Calibration, policy: Policy, _: ValidationContext) -> Iterator[Finding]:
    """Distortion that is not monotonic up to the image corner maps two directions to one pixel."""
    if c.distortion is None or not policy.distortion_monotonic:
        return
    K, (width, height) = c.intrinsics, c.intrinsics.image_size
    # First a bound on the radius of all four corners: the quick test spares nearly every entry of a registry the
    # inverse of its lens, which takes 2 ms.
    y = max(abs(K.cy), abs(height - K.cy)) / abs(K.fy)
    x = (max(abs(K.cx), abs(width - K.cx)) + abs(K.skew) * y) / abs(K.fx)
    lost = 0
    if not c.distortion.covers(math.hypot(x, y)):
        corners = np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]])
        lost = int(np.isnan(c.unproject(corners)).any(axis=1).sum())
    yield Finding(
        rule="distortion-monotonic",
        severity=Severity.ERROR if lost else Severity.PASS,
        measured=float(lost),
        limit=0.0,
        message=f"the distortion is not monotonic out to {lost} of 4 image corners"
        if lost
        else "the distortion is monotonic over the whole image",
        remedy="calibrate with the corners of the image covered" if lost else None,
    )


def _group_spread(_: Calibration, policy: Policy, context: ValidationContext) -> Iterator[Finding]:
    if context.spread is not None:
        yield group_spread(context.spread, policy)


def group_spread(spread: float, policy: Policy) -> Finding:
    """Judge the spread of K over the images of one camera, as a fraction of fx."""
    ok = spread <= policy.group_spread_max
    message = f"K spreads by {spread:.2%} over this camera's images, at most {policy.group_spread_max:.2%}"
    if not ok:
        message += ": images of two units or two capture modes have the same camera key"
    return Finding(
        rule="one-k-per-camera",
        severity=Severity.PASS if ok else Severity.ERROR,
        measured=spread,
        limit=policy.group_spread_max,
        message=message,
        remedy=None if ok else "put the images of each unit and each capture mode into a separate folder",
    )


def _apart(c: Calibration, other: NamedFocal) -> float:
    apart = abs(other.fx / c.intrinsics.fx - 1.0)
    return math.inf if math.isnan(apart) else apart


Rule: TypeAlias = Callable[[Calibration, Policy, ValidationContext], Iterator[Finding]]

RULES: Final[Mapping[str, Rule]] = {
    # A leak makes the focal length implausible, so it is reported first.
    "no-35mm-leak": _leak_35mm,
    "focal-symmetry": _focal_symmetry,
    "principal-point-drift": _principal_point,
    "focal-plausibility": _focal_plausibility,
    "zero-skew": _zero_skew,
    "source-agreement": _source_agreement,
    "sensor-stated": _sensor_stated,
    "focal-stated": _focal_stated,
    "digital-zoom": _digital_zoom,
    EDITED: _as_the_camera_wrote_it,
    "distortion-monotonic": _distortion_monotonic,
    "one-k-per-camera": _group_spread,
}
"""The rules by the names of their findings, in the order in which they are reported."""
