"""Whether a K is right for a camera's images, by everything else that states a K for them: one place decides.

>>> from calibrary.jobs.weigh import Source, weigh
>>> mine = calibrary.read("camera.xml")
>>> K = Source.measured("camera.xml", mine)
>>> nominal = calibrary.Calibration.from_opencv([[3667, 0, 2736], [0, 3667, 1824], [0, 0, 1]], image_size=(5472, 3648))
>>> tag = Source(name="EXIF FocalLength ÷ listed sensor", calibration=nominal, tolerance=0.02)
>>> weigh(K, [tag], mine.camera, calibrary.FLEET).standing.value
'confirmed'

Every command that judges gathers what it knows as sources and shows the answer; none decides by itself. Two thresholds
are kept apart: a source *contradicts* a K beyond the tolerances of both, and it *confirms* a K only within
:data:`CONFIRMS`: a wide tolerance must not make a witness. Measured calibrations of one unit are compared as ``diff``
compares them, in pixels over the frame with the camera free to turn. The tolerances are measured ones: on 3 565 models
two public lists of sensor widths differ by 0.5 % at the 95th percentile; focal plane and list by 0.9 % at the median;
published calibrations differ from nominal focal lengths by up to 3.3 %.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.errors import CalibraryError, InputError
from calibrary.evidence.context import Source as TagSource
from calibrary.evidence.context import SourceEstimate
from calibrary.evidence.optics import DIAGONAL_35MM
from calibrary.evidence.weighing import Evidence
from calibrary.jobs.diff.common_numbers import K_NAMES, SAME, common_numbers
from calibrary.known_camera import SUB_CAMERAS, normalise_sub_camera
from calibrary.policy import Policy
from calibrary.provenance import Provenance
from calibrary.records import replace
from calibrary.registry.entry import USUAL_TOLERANCE

if TYPE_CHECKING:
    from calibrary.registry.resolution import Resolution

__all__ = [
    "EXIF",
    "MEASURED",
    "NOMINAL",
    "UNJUDGED_CENTRE",
    "Contradiction",
    "Source",
    "Standing",
    "Weighed",
    "engraved",
    "foreign",
    "known_tolerance",
    "limit_between",
    "model_of",
    "of_images",
    "of_tags",
    "weigh",
]

MEASURED: Final = frozenset({Grade.CALIBRATED, Grade.ADJUSTED})
CONFIRMS: Final = 0.03
"""Largest relative difference of two focal lengths that confirm each other, before the rounding of a tag."""
CONFIRMS_AT_MOST: Final = 0.05
NOMINAL: Final = 0.05
"""Least relative difference at which a nominal focal length contradicts a measured one: lenses are not as engraved."""
SQUARE: Final = 0.02
"""Largest difference of fx and fy of a sensor size that is the camera's: pixels are square."""
EXIF: Final = "EXIF"
"""Voice of the tags that rest on EXIF's focal lengths."""
UNJUDGED_CENTRE: Final = "the principal point was not judged"
OTHER_FOCAL: Final = 0.05
"""Relative difference of two focal lengths in millimetres that are of two lenses, or two settings of a zoom."""

OF_KNOWN: Final = frozenset({TagSource.CATALOGUE_PITCH, TagSource.CATALOGUE_DESIGN})
"""What is known of a camera by its name, which includes how its lens differs from the engraved focal length."""

TOLERANCES: Final = {
    TagSource.GIVEN_SENSOR: (0.02, "a data sheet's sensor size"),
    TagSource.FOCAL_PLANE: (0.02, "a resolution of the focal plane"),
    TagSource.CATALOGUE_PITCH: (0.03, "the catalogue's pixel pitch"),
    TagSource.CATALOGUE_DESIGN: (0.03, "the catalogue's focal length"),
    TagSource.DJI_DESIGN: (0.03, "the maker's design value"),
    TagSource.FIELD_OF_VIEW: (0.03, "a stated field of view"),
    TagSource.LISTED_SENSOR: (0.02, "a list's sensor width"),
    TagSource.FULL_FRAME: (0.02, "a 36 mm sensor"),
    TagSource.FOCAL_35MM: (0.02, "whole millimetres of a 35 mm equivalent"),
}
"""How far the focal length of a nominal source may be off as a fraction, and why."""


class Source(Struct, frozen=True, kw_only=True):
    """What states a K.

    Attributes:
        name: as the user knows it: a tag, a file, the path of an entry.
        calibration: at the size of the images.
        tolerance: how far its focal length may be off, as a fraction.
        rounding: of the tag, in addition.
        why: reason for the tolerance.
        engraved: least relative difference at which it contradicts a measured K, if it rests on a nominal focal length.
        granted: what a person states that a K of this camera may be off from it, which replaces all of these.
        is_measured: whether it was measured on one unit.
        rests_on: the inputs that it depends on; sources that share one are no two witnesses.
        voice: of what it is a statement: a firmware that writes another lens's focal length writes it into all tags.
    """

    name: str
    calibration: Calibration
    tolerance: float = 0.0
    rounding: float = 0.0
    why: str = ""
    engraved: float = 0.0
    granted: float | None = None
    is_measured: bool = False
    rests_on: frozenset[str] = frozenset()
    voice: str = ""

    @classmethod
    def measured(cls, name: str, calibration: Calibration) -> Source:
        """A calibration that was measured: a file, an entry of the registry, pixels."""
        return cls(
            name=name,
            calibration=calibration,
            why="it was measured",
            is_measured=calibration.grade in MEASURED,
            rests_on=frozenset({name}),
            voice=name,
        )

    @classmethod
    def of_entry(cls, found: Resolution, policy: Policy) -> Source:
        """The entry of a registry that applies to a camera, at the size of its images."""
        return cls.in_registry(found.path, found.calibration, found.entry.tolerance, policy)

    @classmethod
    def in_registry(
        cls, name: str, calibration: Calibration, tolerance: float | None, policy: Policy
    ) -> Source:
        """What is in use for a camera, with the tolerance that its entry states."""
        source = replace(cls.measured(name, calibration), granted=tolerance)
        if source.is_measured:
            return source
        return replace(source, tolerance=known_tolerance(policy), why="a nominal entry of the registry")

    @property
    def fx(self) -> float:
        """Focal length in px."""
        return self.calibration.intrinsics.fx

    def is_independent_of(self, other: Source) -> bool:
        """Whether the two share no input and are no copies; only then is their agreement evidence."""
        return not self.rests_on & other.rests_on and not self.is_copy_of(other)

    def is_copy_of(self, other: Source) -> bool:
        """Whether both have the numbers of one source, as a file does that a program wrote from the image's tag.

        A K that was computed from a tag is none that was measured, whatever a file calls it that has its numbers.
        """
        if self.is_measured and other.is_measured:
            return common_numbers(self.calibration, other.calibration).is_one_measurement
        K, L = self.calibration.intrinsics, other.calibration.intrinsics
        return self.is_measured != other.is_measured and all(
            math.isclose(getattr(K, name), getattr(L, name), rel_tol=SAME) for name in K_NAMES
        )


class Standing(StrEnum):
    """How a K stands among the other sources."""

    CONFIRMED = "confirmed"
    ALONE = "uncontradicted"
    CONTRADICTED = "contradicted"
    FOREIGN = "another camera's"


class Contradiction(Struct, frozen=True, kw_only=True):
    """A source that contradicts a K.

    Attributes:
        source: which.
        difference: source ÷ K − 1 of fx.
        message: the difference in words.
        disbelieved_by: names of two independent sources that show it wrong; empty if nothing does.
    """

    source: Source
    difference: float
    message: str
    disbelieved_by: tuple[str, ...] = ()


class Weighed(Struct, frozen=True, kw_only=True):
    """The answer.

    Attributes:
        source: whose K was weighed.
        standing: the answer.
        confirmed_by: the independent sources that confirm it.
        copies: the sources that hold the same measurement.
        contradicted_by: the sources that contradict it, the disbelieved ones among them.
        centre_judged: whether another source knows the principal point.
        reason: why it is another camera's, or contradicted; None otherwise.
    """

    source: Source
    standing: Standing
    confirmed_by: tuple[Source, ...] = ()
    copies: tuple[Source, ...] = ()
    contradicted_by: tuple[Contradiction, ...] = ()
    centre_judged: bool = False
    reason: str | None = None

    @property
    def may_be_used(self) -> bool:
        """Whether nothing that is believed speaks against it."""
        return self.standing in {Standing.CONFIRMED, Standing.ALONE}

    @property
    def disbelieved(self) -> tuple[Contradiction, ...]:
        """The sources that contradict it and are shown wrong."""
        return tuple(one for one in self.contradicted_by if one.disbelieved_by)

    @property
    def computed(self) -> str | None:
        """That a K is no measurement but what a tag gives, which nothing confirms; None if it is one."""
        tag = next((one.name for one in self.copies if not one.is_measured), None)
        if tag is None or not self.source.is_measured or self.confirmed_by:
            return None
        return f"its numbers are those of {tag}, so it was computed, and not measured"

    @property
    def believed_against(self) -> tuple[Contradiction, ...]:
        """The sources that contradict it and are believed."""
        return tuple(one for one in self.contradicted_by if not one.disbelieved_by)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader of the answer should know besides: who is disbelieved by whom, and what was not judged."""
        named = (
            f"{one.source.name} states fx = {one.source.fx:.1f} px, {one.difference:+.1%}, and is not believed: "
            f"{' and '.join(one.disbelieved_by)} show it wrong"
            for one in self.disbelieved
        )
        return (*named, *(() if self.centre_judged else (UNJUDGED_CENTRE,)))


def weigh(source: Source, others: Iterable[Source], camera: CameraKey, policy: Policy) -> Weighed:
    """Weigh the K of one source against all others.

    A source that contradicts is disbelieved only if two independent sources show it wrong (K, and one that confirms
    K), and no independent source stands by it. Copies of one measurement are one source.

    Args:
        source: whose K is in question.
        others: everything else that states a K for these images, at their size.
        camera: key of the images' camera.
        policy: with the limits of ``diff``.
    """
    name = foreign(source.calibration, camera)
    if name is not None:
        return Weighed(source=source, standing=Standing.FOREIGN, reason=name)
    copies: list[Source] = []
    witnesses: list[Source] = []
    for one in others:
        if one is not source:
            (copies if one.is_copy_of(source) else witnesses).append(one)
    said = {id(one): _contradicts(one, source, policy) for one in (*copies, *witnesses)}
    confirming = tuple(
        one
        for one in witnesses
        if one.is_independent_of(source) and said[id(one)] is None and _is_near(one, source)
    )
    against = []
    for one in (*copies, *witnesses):
        message = said[id(one)]
        if message is not None:
            shown_by = _disbelieving(one, source, confirming, witnesses, policy)
            difference = one.fx / source.fx - 1.0
            against.append(
                Contradiction(source=one, difference=difference, message=message, disbelieved_by=shown_by)
            )
    believed = next((one for one in against if not one.disbelieved_by), None)
    reason = (
        f"{believed.source.name} {believed.message}" if believed is not None else _off_centre(source, policy)
    )
    standing = Standing.CONFIRMED if confirming else Standing.ALONE
    return Weighed(
        source=source,
        standing=standing if reason is None else Standing.CONTRADICTED,
        confirmed_by=confirming,
        copies=tuple(one for one in copies if all(one is not other.source for other in against)),
        contradicted_by=tuple(against),
        centre_judged=any(one.is_measured for one in (*copies, *witnesses)),
        reason=reason,
    )


def of_images(
    evidence: Evidence, camera: CameraKey, policy: Policy, resolution: Resolution | None = None
) -> tuple[Source, ...]:
    """All sources that images state, and the registry's entry for them.

    Args:
        evidence: of the images.
        camera: their key.
        policy: with the tolerance of a known camera.
        resolution: the entry that applies to them.
    """
    entry = (Source.of_entry(resolution, policy),) if resolution is not None else ()
    return (*of_tags(evidence, camera, policy), *entry)


def of_tags(evidence: Evidence, camera: CameraKey, policy: Policy) -> Iterator[Source]:
    """The sources that are the tags of an image; an assumed sensor size is none, nor one that contradicts itself."""
    known = evidence.scene.known
    usual = known_tolerance(policy)
    for one in evidence.estimates:
        K = one.intrinsics
        if one.source is TagSource.ASSUMED_SENSOR or abs(K.fx / K.fy - 1.0) > SQUARE:
            continue
        tolerance, why = TOLERANCES.get(one.source, (0.0, "it was measured"))
        is_known = one.source in OF_KNOWN
        if is_known:
            tolerance = max(usual, known.spread or 0.0) if known is not None else usual
        tolerance += known_to_be_off(one.source, evidence)
        yield Source(
            name=one.tag,
            calibration=_calibration(one, camera),
            tolerance=tolerance,
            rounding=one.tolerance,
            why=why,
            engraved=engraved(one),
            is_measured=one.grade in MEASURED,
            rests_on=one.rests_on,
            voice=one.tag if one.source.rank < TagSource.GIVEN_SENSOR.rank else EXIF,
        )


def known_to_be_off(source: TagSource, evidence: Evidence) -> float:
    """How far what a camera writes is from its fitted focal length, where the catalogue states both."""
    known, written = evidence.scene.known, evidence.scene.metadata
    fitted = known.fx_over_w_at(known.focal_mm) if known is not None and known.zoom_mm is None else None
    if known is None or known.native_size is None or fitted is None:
        return 0.0
    width, nominal = known.native_size[0], None
    if source is TagSource.CATALOGUE_PITCH and known.focal_mm and known.pitch_um and written.focal_mm:
        if abs(written.focal_mm / known.focal_mm - 1.0) <= OTHER_FOCAL:
            nominal = written.focal_mm * 1000.0 / known.pitch_um / width
    elif source is TagSource.FOCAL_35MM and known.focal_35mm and known.focal_35mm == written.focal_35mm:
        nominal = known.focal_35mm / DIAGONAL_35MM * math.hypot(*known.native_size) / width
    return abs(fitted / nominal - 1.0) if nominal is not None else 0.0


def known_tolerance(policy: Policy) -> float:
    """How far a K of a known camera may be from what is known of it, as a fraction."""
    return policy.known_camera_tolerance if policy.known_camera_tolerance is not None else USUAL_TOLERANCE


def engraved(one: SourceEstimate) -> float:
    """Relative difference of a nominal focal length from a measured one that is usual, because it is as engraved."""
    return 0.0 if one.source in OF_KNOWN or one.grade in MEASURED else NOMINAL


def _calibration(one: SourceEstimate, camera: CameraKey) -> Calibration:
    return Calibration(
        camera=camera,
        intrinsics=one.intrinsics,
        distortion=one.distortion,
        grade=one.grade,
        provenance=Provenance(kind="image-metadata", tag=one.tag),
    )


def foreign(calibration: Calibration, camera: CameraKey) -> str | None:
    """Which name of a calibration's camera is not that of the images, in words; None if none contradicts."""
    stated, model = calibration.camera, model_of(calibration)
    if model and camera.model and not _alike(model, camera.model):
        return f"it is of {model}, and these images are of {camera.model}"
    for what, one, other in (
        ("the unit", stated.serial, camera.serial),
        ("the camera", _part(stated.sub_camera), camera.sub_camera),
    ):
        if one and other and one != other:
            return f"it is of {what} {one[:8]}, and these images are of {other[:8]}"
    if stated.focal_mm and camera.focal_mm and abs(stated.focal_mm / camera.focal_mm - 1.0) > OTHER_FOCAL:
        return f"it is of a lens at {stated.focal_mm:g} mm, and these images are of {camera.focal_mm:g} mm"
    return None


def _part(name: str | None) -> str | None:
    """The sub-camera or band that a name states; None for what a file calls its cameras itself, as cam0 or by model."""
    word = normalise_sub_camera(name) if name else None
    return word if word and any(f"{word}-".startswith(f"{one}-") for one in SUB_CAMERAS) else None


def model_of(calibration: Calibration) -> str | None:
    """The camera model that a calibration states, in its key or as part of OpenSfM's name of a camera; None if none."""
    # Maker and model, then width, height, projection and focal length.
    named = dict(calibration.extras).get("opensfm/camera", "").split()[:-4]
    is_named = named and named[-1] != "unknown"
    return calibration.camera.model or (" ".join(named) if is_named else None)


def _alike(one: str, other: str) -> bool:
    """Whether two names may be of one model: words of one, run together, are the other, as GR II of Ricoh GR II."""
    a, b = (re.findall(r"\w+", name.casefold().replace("_", " ")) for name in (one, other))
    return _holds(a, "".join(b)) or _holds(b, "".join(a))


def _holds(words: Sequence[str], name: str) -> bool:
    ends = range(len(words))
    return any("".join(words[first : last + 1]) == name for first in ends for last in ends[first:])


def _off_centre(source: Source, policy: Policy) -> str | None:
    """What is wrong with a principal point that no lens has, whatever its focal length; None if nothing is."""
    K = source.calibration.intrinsics
    off = max(abs(K.cx / K.image_size[0] - 0.5), abs(K.cy / K.image_size[1] - 0.5))
    if off <= policy.principal_point_drift_max:
        return None
    limit = policy.principal_point_drift_max
    return f"its principal point is {off:.1%} of the image size from the middle, at most {limit:.0%} is usual"


def _apart(one: Source, other: Source) -> float:
    return abs(one.fx / other.fx - 1.0)


def limit_between(one: Source, other: Source) -> float:
    """Relative difference of two focal lengths beyond which one source contradicts the other, if one is nominal."""
    granted = next((source.granted for source in (one, other) if source.granted is not None), None)
    if granted is not None:
        return max(granted, one.rounding, other.rounding)
    limit = one.tolerance + one.rounding + other.tolerance + other.rounding
    if one.is_measured or other.is_measured:
        limit = max(limit, one.engraved, other.engraved)
    return limit


def _confirms(one: Source, K: Source, policy: Policy) -> bool:
    return _is_near(one, K) and _contradicts(one, K, policy) is None


def _is_near(one: Source, K: Source) -> bool:
    """Whether a source that does not contradict a K confirms it: a wide tolerance makes no witness."""
    if one.is_measured and K.is_measured:
        return True
    return _apart(one, K) <= min(CONFIRMS + max(one.rounding, K.rounding), CONFIRMS_AT_MOST)


def _contradicts(one: Source, K: Source, policy: Policy) -> str | None:
    """How a source contradicts a K, in words; None if it does not."""
    if one.is_measured and K.is_measured:
        return _differs(one, K, policy)
    limit = limit_between(one, K)
    if _apart(one, K) <= limit:
        return None
    known = f"and is right to ±{limit:.0%}"
    if one.is_measured and not K.is_measured:
        known = f"and {K.name} is right to ±{limit:.0%}"
    why = K.why if one.is_measured else one.why
    return f"states fx = {one.fx:.1f} px, {one.fx / K.fx - 1.0:+.1%}, {known} ({why})"


def _differs(one: Source, K: Source, policy: Policy) -> str | None:
    """How two measured calibrations differ, by the rules of ``diff``; None if they do not differ in practice."""
    mine, other = one.calibration, K.calibration
    if (mine.intrinsics, mine.distortion) == (other.intrinsics, other.distortion):
        return None  # an entry and the tag it was made from: by far the most frequent case
    from calibrary.jobs.diff.comparison import compare
    from calibrary.jobs.diff.wording import pixels

    try:
        found = compare(other, mine, policy)
    except CalibraryError as error:
        return f"cannot be compared: {error.message if isinstance(error, InputError) else error}"
    if not found.alarm:
        return None
    # Where the kind of change is the first reason, the pixels are told besides.
    seen = found.numbers.projection if found.structural and found.numbers is not None else None
    far = (
        f"{pixels(seen.rms_px)} rms and {pixels(seen.max_px)} at most over the frame: "
        if seen is not None
        else ""
    )
    return f"states another K: {far}{found.reasons[0]}"


def _disbelieving(
    one: Source, K: Source, confirming: Sequence[Source], witnesses: Sequence[Source], policy: Policy
) -> tuple[str, ...]:
    """The names of K and of what confirms it, if these show a source wrong and nothing stands by that source.

    A measured source is shown wrong by two voices; and where two speak against a third, what repeats that third is no
    support of it.
    """
    if not K.is_independent_of(one):
        return ()
    # A witness so rough that it contradicts neither shows nothing wrong.
    against = [
        other
        for other in confirming
        if other.is_independent_of(one) and _contradicts(one, other, policy) is not None
    ]
    two_voices = [other for other in against if other.voice != K.voice]
    if one.is_measured:
        against = two_voices
    if not against:
        return ()
    outside = one.voice != K.voice and any(other.voice != one.voice for other in two_voices)
    for other in witnesses:
        repeats = outside and other.voice == one.voice
        if (
            other is not one
            and not repeats
            and other.is_independent_of(one)
            and _confirms(other, one, policy)
        ):
            return ()
    return (K.name, against[0].name)
