"""Validation of K before it reaches a solver: a policy's limits, rules that give a verdict, and how to add one.

Every rule is evaluated, even if another fails, and NaN fails every rule. The rules here ask of nothing but K and its
lens. What else is stated of a camera is judged where it is known: ``jobs/survey`` weighs all claims on some images, and
``jobs/survey/own.py`` has the rules on a K that images state themselves. Two policies are shipped: ``source`` requires
fx / W of every camera to be in one range; ``fleet`` compares what is known of a camera, because most UAV cameras are
outside that range.

A new rule is a function here and its row in :data:`RULES`:

1.  Write the function. It yields a :class:`Finding` with the rule's name, also when K passes, or nothing where the rule
    does not apply. Compare as ``measured <= limit``, so that NaN fails. ``message`` says what was found and what was
    expected, ``remedy`` what to do; a rule that fails has one.
2.  Give it a row in :data:`RULES`, in the order in which findings are reported.
3.  A limit is a field of :class:`~calibrary.policy.Policy`, with its bounds and one line under ``Attributes``. The
    policy ``source`` holds the source document's limits alone: switch the rule off in it, unless that document has it.
    Run ``make schemas``.
4.  Add what it finds to ``docs/reference/rules.md``, and a K that breaks it to ``BROKEN`` in
    ``tests/core/test_validation_remedies.py``; its own tests are in ``tests/core/test_validation.py``.

The tests name each of these that is missing.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import StrEnum
from typing import Final, Self, TypeAlias

from calibrary.arrays import np
from calibrary.calibration import Calibration, CameraKey
from calibrary.policy import Policy
from calibrary.records import Json, Record


class Severity(StrEnum):
    """Effect of a finding on the verdict, mildest first; only the last two prevent the use of a K."""

    PASS = "pass"  # noqa: S105  a word of the report, not a password
    NOTE = "note"
    WARNING = "warning"
    UNPROVEN = "unproven"
    ERROR = "error"


EDITED: Final = "as-recorded"
"""Rule that finds images which are not as the camera wrote them; its message states their number."""

PLAUSIBLE: Final = "focal-plausibility"
"""Rule on the focal length: what is known of the camera, what confirms it, or what lenses in general have."""

SENSOR_STATED: Final = "sensor-stated"
"""Rule that finds a K which rests on an assumed sensor size."""

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


class Use(StrEnum):
    """What a solver may do with a K: keep it fixed, start from it, or leave it."""

    FIXED = "fixed"
    START = "start"
    NONE = "none"

    @classmethod
    def of(cls, findings: Iterable[Finding]) -> Self:
        """Return what findings leave: an error forbids every use, an unproven finding all but a start."""
        severities = {finding.severity for finding in findings}
        if Severity.ERROR in severities:
            return cls.NONE
        return cls.START if Severity.UNPROVEN in severities else cls.FIXED


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
        unstated = next((f for f in self.findings if f.rule == SENSOR_STATED), None)
        return (unstated or self.failures[0]).remedy


REGISTER = "register the camera (--registry)"
GIVE_FILES = "provide the original files from the camera"


def name_sensor(camera: CameraKey) -> str:
    """The advice to state the sensor's size of a camera, by the flag that also serves a run of several cameras."""
    if camera.model is None:
        return "name the sensor in mm (--sensor-width-mm, --sensor-height-mm)"
    name = " ".join(word for word in (camera.model, camera.sub_camera) if word)
    return f"name the sensor in mm (--sensor {shlex.quote(name)}=WxH)"


def validate(calibration: Calibration, policy: Policy) -> Report:
    """Validate a calibration by itself against a policy; every rule is evaluated.

    Args:
        calibration: K and distortion.
        policy: limits of the rules.

    >>> calibrary.validate(calibrary.read("camera.xml"), calibrary.SOURCE).failures[0].rule
    'focal-plausibility'
    """
    findings = tuple(f for rule in RULES.values() for f in rule(calibration, policy))
    return Report(policy=policy.name, findings=findings)


def lacks_confirmation(finding: Finding) -> bool:
    """Whether the only problem is that K has a single source, so that a second source would resolve it."""
    return (finding.rule, finding.severity, finding.limit) == (PLAUSIBLE, Severity.UNPROVEN, None)


def _focal_symmetry(c: Calibration, policy: Policy) -> Iterator[Finding]:
    K = c.intrinsics
    measured = abs(K.fx - K.fy) / max(K.fx, K.fy)
    limit = policy.focal_symmetry_max
    severity = Severity.PASS
    if not measured <= limit:
        severity = Severity.ERROR
    elif policy.focal_symmetry_proven is not None and not measured <= policy.focal_symmetry_proven:
        severity, limit = Severity.UNPROVEN, policy.focal_symmetry_proven
    message, remedy = f"fx and fy differ by {measured:.2%}, at most {limit:.2%}", None
    if severity is not Severity.PASS:
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


def _principal_point(c: Calibration, policy: Policy) -> Iterator[Finding]:
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


def _within_band(c: Calibration, policy: Policy) -> Iterator[Finding]:
    fx_over_w = c.intrinsics.fx / c.intrinsics.image_size[0]
    # A K that was measured may be of any real lens. The narrow band is for arithmetic on tags, where a wrong sensor
    # size or a 35 mm equivalent is likelier than a rare lens.
    measured = c.provenance.kind not in {"image-metadata", "stated"} and c.grade.is_metric
    low, high = (policy.measured_over_width if measured else None) or policy.focal_over_width
    in_band = low <= fx_over_w <= high
    message, remedy = f"fx = {fx_over_w:.3f} W, expected {low:g} … {high:g} W", None
    if not in_band:
        message += ": a 35 mm equivalent or a wrong sensor size, unless the lens has this focal length"
        knows = policy.known_camera_tolerance is not None
        way = REGISTER if knows else "use --policy fleet, which has limits for known cameras"
        remedy = f"check the sensor size; if the focal length is right, {way}"
    yield Finding(
        rule=PLAUSIBLE,
        severity=Severity.PASS if in_band else Severity.ERROR,
        measured=fx_over_w,
        limit=low if fx_over_w < low else high,
        message=message,
        remedy=remedy,
    )


def _zero_skew(c: Calibration, policy: Policy) -> Iterator[Finding]:
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


def _distortion_monotonic(c: Calibration, policy: Policy) -> Iterator[Finding]:
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


Rule: TypeAlias = Callable[[Calibration, Policy], Iterator[Finding]]

RULES: Final[Mapping[str, Rule]] = {
    "focal-symmetry": _focal_symmetry,
    "principal-point-drift": _principal_point,
    PLAUSIBLE: _within_band,
    "zero-skew": _zero_skew,
    "distortion-monotonic": _distortion_monotonic,
}
"""The rules by the names of their findings, in the order in which they are reported."""
