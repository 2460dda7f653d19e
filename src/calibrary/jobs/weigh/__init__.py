"""Whether a K is right for a camera's images, by everything else that states a K for them: one place decides.

>>> from calibrary.jobs.weigh import Source, weigh
>>> mine = calibrary.read("camera.xml")
>>> K = Source.measured("camera.xml", mine)
>>> tag = Source(name="EXIF FocalLength ÷ listed sensor", calibration=mine.scaled((5472, 3648)), tolerance=0.02)
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

from collections.abc import Iterable, Iterator, Sequence
from enum import StrEnum
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.errors import CalibraryError, InputError
from calibrary.evidence.estimate import Source as TagSource
from calibrary.evidence.estimate import SourceEstimate
from calibrary.policy import Policy
from calibrary.provenance import Provenance

__all__ = ["NOMINAL", "Contradiction", "Source", "Standing", "Weighed", "foreign", "of_tags", "weigh"]

MEASURED: Final = frozenset({Grade.CALIBRATED, Grade.ADJUSTED})
CONFIRMS: Final = 0.03
"""Largest relative difference of two focal lengths that confirm each other, before the rounding of a tag."""
CONFIRMS_AT_MOST: Final = 0.05
NOMINAL: Final = 0.05
"""Least relative difference at which a nominal focal length contradicts a measured one: lenses are not as engraved."""
SQUARE: Final = 0.02
"""Largest difference of fx and fy of a sensor size that is the camera's: pixels are square."""
OTHER_FOCAL: Final = 0.05
"""Relative difference of two focal lengths in millimetres that are of two lenses, or two settings of a zoom."""

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
        why: reason for the tolerance.
        is_measured: whether it was measured on one unit.
        rests_on: the inputs that it depends on; sources that share one are no two witnesses.
    """

    name: str
    calibration: Calibration
    tolerance: float = 0.0
    why: str = ""
    is_measured: bool = False
    rests_on: frozenset[str] = frozenset()

    @classmethod
    def measured(cls, name: str, calibration: Calibration) -> Source:
        """A calibration that was measured: a file, an entry of the registry, pixels."""
        return cls(
            name=name,
            calibration=calibration,
            why="it was measured",
            is_measured=calibration.grade in MEASURED,
            rests_on=frozenset({name}),
        )

    @property
    def fx(self) -> float:
        """Focal length in px."""
        return self.calibration.intrinsics.fx

    def is_independent_of(self, other: Source) -> bool:
        """Whether the two share no input; only then is their agreement evidence."""
        return not self.rests_on & other.rests_on


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
        confirmed_by: the sources that confirm it.
        contradicted_by: the sources that contradict it, the disbelieved ones among them.
        reason: why it is another camera's, or contradicted; None otherwise.
    """

    source: Source
    standing: Standing
    confirmed_by: tuple[Source, ...] = ()
    contradicted_by: tuple[Contradiction, ...] = ()
    reason: str | None = None

    @property
    def may_be_used(self) -> bool:
        """Whether nothing that is believed speaks against it."""
        return self.standing in {Standing.CONFIRMED, Standing.ALONE}


def weigh(source: Source, others: Iterable[Source], camera: CameraKey, policy: Policy) -> Weighed:
    """Weigh the K of one source against all others.

    A source that contradicts is disbelieved only if K and an independent source that confirms K stand against it, and
    no independent source stands by it.

    Args:
        source: whose K is in question.
        others: everything else that states a K for these images, at their size.
        camera: key of the images' camera.
        policy: with the limits of ``diff``.
    """
    name = foreign(source.calibration, camera)
    if name is not None:
        return Weighed(source=source, standing=Standing.FOREIGN, reason=name)
    witnesses = [one for one in others if one is not source]
    confirming = tuple(
        one for one in witnesses if one.is_independent_of(source) and _confirms(one, source, policy)
    )
    against = tuple(
        Contradiction(
            source=one,
            difference=one.fx / source.fx - 1.0,
            message=message,
            disbelieved_by=_disbelieving(one, source, confirming, witnesses, policy),
        )
        for one in witnesses
        if (message := _contradicts(one, source, policy)) is not None
    )
    believed = [one for one in against if not one.disbelieved_by]
    if believed:
        reason = f"{believed[0].source.name} {believed[0].message}"
        return Weighed(
            source=source,
            standing=Standing.CONTRADICTED,
            confirmed_by=confirming,
            contradicted_by=against,
            reason=reason,
        )
    standing = Standing.CONFIRMED if confirming else Standing.ALONE
    return Weighed(source=source, standing=standing, confirmed_by=confirming, contradicted_by=against)


def of_tags(estimates: Sequence[SourceEstimate], camera: CameraKey) -> Iterator[Source]:
    """The sources that are the tags of an image; an assumed sensor size is none, nor one that contradicts itself."""
    for one in estimates:
        K = one.intrinsics
        if one.source is TagSource.ASSUMED_SENSOR or abs(K.fx / K.fy - 1.0) > SQUARE:
            continue
        tolerance, why = TOLERANCES.get(one.source, (0.0, "it was measured"))
        yield Source(
            name=one.tag,
            calibration=Calibration(
                camera=camera,
                intrinsics=one.intrinsics,
                distortion=one.distortion,
                grade=one.grade,
                provenance=Provenance(kind="image-metadata", tag=one.tag),
            ),
            tolerance=tolerance + one.tolerance,
            why=why,
            is_measured=one.grade in MEASURED,
            rests_on=one.rests_on,
        )


def foreign(calibration: Calibration, camera: CameraKey) -> str | None:
    """Which name of a calibration's camera is not that of the images, in words; None if none contradicts."""
    stated = calibration.camera
    # OpenSfM's name of a camera: maker and model, then width, height, projection and focal length.
    named = dict(calibration.extras).get("opensfm/camera", "").split()[:-4]
    model = stated.model or " ".join(named)
    if model and camera.model and not _alike(model, camera.model):
        return f"it is of {model}, and these images are of {camera.model}"
    for what, one, other in (
        ("the unit", stated.serial, camera.serial),
        ("the camera", stated.sub_camera, camera.sub_camera),
    ):
        if one and other and one != other:
            return f"it is of {what} {one[:8]}, and these images are of {other[:8]}"
    if stated.focal_mm and camera.focal_mm and abs(stated.focal_mm / camera.focal_mm - 1.0) > OTHER_FOCAL:
        return f"it is of a lens at {stated.focal_mm:g} mm, and these images are of {camera.focal_mm:g} mm"
    return None


def _alike(one: str, other: str) -> bool:
    """Whether two names may be of one model: one contains the other, without spaces, signs and case."""
    a, b = ("".join(c for c in name.casefold() if c.isalnum()) for name in (one, other))
    return a in b or b in a


def _apart(one: Source, other: Source) -> float:
    return abs(one.fx / other.fx - 1.0)


def _confirms(one: Source, K: Source, policy: Policy) -> bool:
    if one.is_measured and K.is_measured:
        return _differs(one, K, policy) is None
    rounding = one.tolerance if one.name.startswith("EXIF FocalLengthIn35mmFilm") else 0.0
    return _apart(one, K) <= min(CONFIRMS + rounding, CONFIRMS_AT_MOST)


def _contradicts(one: Source, K: Source, policy: Policy) -> str | None:
    """How a source contradicts a K, in words; None if it does not."""
    if one.is_measured and K.is_measured:
        return _differs(one, K, policy)
    limit = one.tolerance + K.tolerance
    if one.is_measured or K.is_measured:
        limit = max(limit, NOMINAL)
    if _apart(one, K) <= limit:
        return None
    return f"states fx = {one.fx:.1f} px, {one.fx / K.fx - 1.0:+.1%}, and is right to ±{limit:.0%} ({one.why or K.why})"


def _differs(one: Source, K: Source, policy: Policy) -> str | None:
    """How two measured calibrations differ, by the rules of ``diff``; None if they do not differ in practice."""
    from calibrary.jobs.diff.comparison import compare

    try:
        found = compare(K.calibration, one.calibration, policy)
    except CalibraryError as error:
        return f"cannot be compared: {error.message if isinstance(error, InputError) else error}"
    return f"states another K: {found.reasons[0]}" if found.alarm else None


def _disbelieving(
    one: Source, K: Source, confirming: Sequence[Source], witnesses: Sequence[Source], policy: Policy
) -> tuple[str, ...]:
    """The names of K and of what confirms it, if these show a source wrong and nothing stands by that source."""
    against = [other for other in confirming if other.is_independent_of(one)]
    if not against or not K.is_independent_of(one):
        return ()
    for other in witnesses:
        if other is not one and other.is_independent_of(one) and _confirms(other, one, policy):
            return ()
    return (K.name, against[0].name)
