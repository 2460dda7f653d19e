"""JSON document of an audit (schemas/registry-audit-1.schema.json): the one result, which every display reads."""

from __future__ import annotations

from datetime import date
from enum import StrEnum
from typing import Annotated, Literal, TypeAlias

from calibrary.calibration import CameraKey, Grade
from calibrary.jobs.images.folders import SkippedFile
from calibrary.pages.notebook import in_notebook
from calibrary.records import Meta, Record
from calibrary.registry.git.objects import ObjectId
from calibrary.sfm.pixel_check import PixelCheck
from calibrary.validation import Finding, Severity

Count: TypeAlias = Annotated[int, Meta(ge=0)]

LEVELS = (Severity.ERROR, Severity.WARNING, Severity.NOTE)
"""Severities of an audit's findings, most severe first."""


class Use(StrEnum):
    """Whether there is an entry to use."""

    USED = "used"
    EXPIRED = "expired"
    DRAFT = "draft"
    RETIRED = "retired"
    NONE = "none"


class Change(StrEnum):
    """Kind of change of K over time; the value is the text shown to the user."""

    STEADY = "steady"
    DRIFT = "drifts"
    STEP = "changed with the firmware"
    UNSTEADY = "differs between dates"
    SEVERAL_UNITS = "differs, of unknown units"
    UNKNOWN = "cannot tell"


class FindingCounts(Record):
    """Numbers of findings.

    Attributes:
        error, warning, note: number of findings of this severity.
    """

    error: Count
    warning: Count
    note: Count


class FlownSource(Record):
    """What states a K of the images, compared with the entry.

    Attributes:
        tag: its name.
        grade: origin of its intrinsics.
        fx: px.
        tolerance: of the source itself, as a fraction of fx.
        difference: largest of fx and fy as a fraction, and of a measured centre over the width.
        limit: largest allowed difference of the focal lengths; 0 if both were measured, which diff compares.
        contradicts: whether it contradicts the entry.
        chosen: whether it is the best of the images' sources.
    """

    tag: str
    grade: Grade
    fx: float
    tolerance: float
    difference: float
    limit: float
    contradicts: bool
    chosen: bool


class AuditedCamera(Record):
    """One unit with one firmware that flew.

    Attributes:
        name: the camera in words, with its unit and firmware, as findings name it.
        unit: name of its unit.
        camera: camera key; the serial number is a hash.
        images: number of images it took.
        first, last: first and last date of its images; None if none states a date.
        use: whether there is an entry to use.
        entry: id of the entry; None if there is none.
        why: reason for this entry.
        fx: of the entry at the images' size, px; None if nothing shows how they came from its frame.
        tolerance: largest allowed difference from the entry, as a fraction of fx.
        sources: estimates of the images' sources, compared with the entry.
    """

    name: str
    unit: str
    camera: CameraKey
    images: Annotated[int, Meta(ge=1)]
    first: date | None
    last: date | None
    use: Use
    entry: str | None
    why: str | None
    fx: float | None
    tolerance: float | None
    sources: tuple[FlownSource, ...]

    @property
    def own(self) -> FlownSource | None:
        """The best of the images' sources, if it can be compared with the entry."""
        return next((source for source in self.sources if source.chosen), None)


class Leg(Record):
    """Images of one unit on one flight.

    Attributes:
        flight: name of the folder.
        images: number of images.
        first, last: first and last date of the images; None if none states a date.
    """

    flight: str
    images: Annotated[int, Meta(ge=1)]
    first: date | None
    last: date | None


class AuditedUnit(Record):
    """One unit (or a model without a known unit) and its findings.

    Attributes:
        name: label, camera and first digits of the hash of its serial number.
        label: label of the unit in the registry.
        serial: hash of its serial number.
        level: severity of its most severe finding; None without findings.
        next: what to do first; None if nothing needs attention.
        entries: ids of the entries that apply to it.
        images: number of images it took.
        flights: its images by flight.
        findings: of this unit, most severe first.
    """

    name: str
    label: str | None
    serial: str | None
    level: Severity | None
    next: str | None
    entries: tuple[str, ...]
    images: Count
    flights: tuple[Leg, ...]
    findings: tuple[Finding, ...]

    @property
    def is_due(self) -> bool:
        """Whether something needs attention: a note alone does not."""
        return self.level not in {None, Severity.NOTE}


class AuditedFlight(Record):
    """One flight: a folder of images, without the folders that cameras create.

    Attributes:
        name: of the folder.
        first, last: first and last date of its images; None if none states a date.
        images: number of images.
        units: names of the units that took them.
        without: names of those units without a usable entry.
        level: severity of the most severe finding on its units; None without findings.
    """

    name: str
    first: date | None
    last: date | None
    images: Count
    units: tuple[str, ...]
    without: tuple[str, ...]
    level: Severity | None


class DatedCheck(Record):
    """Check of K against the pixels of one flight.

    Attributes:
        flight: name of the folder.
        day: date of its images; None if they state none.
        firmware: of the camera, as stated by its images.
        entry: id of the entry that gives K for that day; None if K is from the images' own tags.
        tolerance: of that entry, as a fraction of fx.
        valid_from, valid_until: validity of the entry; None for an open end.
        pixels: result of the check of that K.
    """

    flight: str
    day: date | None
    firmware: str | None
    entry: str | None
    tolerance: float | None
    valid_from: date | None
    valid_until: date | None
    pixels: PixelCheck


class UnitOverTime(Record):
    """K of one unit over time, at one image size.

    Attributes:
        name: label, camera and first digits of the hash of its serial number.
        camera: camera key without firmware.
        flights: the checked flights, one per date, oldest first.
        change: kind of change of K, from the flights with pixels that determine it.
        by: relative change of fx; None if no change is stated.
        std: standard deviation of ``by``.
        reason: explanation in one sentence.
    """

    name: str
    camera: CameraKey
    flights: tuple[DatedCheck, ...]
    change: Change
    by: float | None
    std: float | None
    reason: str


class Verification(Record):
    """Check of K against the pixels of several flights.

    Attributes:
        images: largest number of images chosen from a flight.
        minutes: the time limit.
        left_out: number of flights not checked because of the time limit.
        units: the units with at least one checked flight.
    """

    images: Annotated[int, Meta(ge=1)]
    minutes: Annotated[float, Meta(gt=0)]
    left_out: Annotated[int, Meta(ge=0)]
    units: tuple[UnitOverTime, ...]


class NotCompared(Record):
    """What states a K, or should, and was not compared with an entry.

    Attributes:
        what: a camera that flew, an image, a file, or the KEY of a proposal.
        reason: why not.
    """

    what: str
    reason: str


class AuditReport(Record, tag_field="schema", tag="calibrary/registry-audit-1"):
    """Output of ``calibrary registry audit --json``. It contains no positions, and serial numbers only as hashes.

    Attributes:
        verdict: clean if there are no findings other than notes, and everything was compared; incomplete if something
            was not.
        registry: folder of the registry.
        commit: of the registry; None for a plain folder.
        policy: name of the registry's policy.
        on: the date that counted as today.
        since: images of earlier days were skipped.
        stale_after_months: age in months from which a calibration is stale.
        folders: of the images.
        images: number of images that were read.
        images_before: number of images skipped because they are older than requested.
        images_undated: number of images without a date; they are included.
        entries: number of entries in the registry.
        counts: numbers of findings.
        cameras: each unit and firmware that flew.
        findings: most severe first.
        units: cameras and findings by unit, most urgent first.
        flights: cameras by flight, those with the most severe findings first.
        unreadable: images from which no camera can be identified.
        not_compared: cameras, files and proposals that could not be compared, with the reason; images of which this is
            true are in ``unreadable``.
        verification: K over time from the pixels of one flight per unit and date; None if not requested.
    """

    verdict: Literal["clean", "incomplete", "findings"]
    registry: str
    commit: ObjectId | None
    policy: str
    on: date
    since: date | None
    stale_after_months: Annotated[int, Meta(ge=1)]
    folders: tuple[str, ...]
    images: Count
    images_before: Count
    images_undated: Count
    entries: Count
    counts: FindingCounts
    cameras: tuple[AuditedCamera, ...]
    findings: tuple[Finding, ...]
    units: tuple[AuditedUnit, ...]
    flights: tuple[AuditedFlight, ...]
    unreadable: tuple[SkippedFile, ...]
    not_compared: tuple[NotCompared, ...] = ()
    verification: Verification | None = None

    @property
    def is_clean(self) -> bool:
        """Whether everything was compared and no finding needs attention; there may be notes."""
        return self.verdict == "clean"

    def cameras_of(self, unit: AuditedUnit) -> tuple[AuditedCamera, ...]:
        """The cameras of a unit: one for each firmware and image size."""
        return tuple(one for one in self.cameras if one.unit == unit.name)

    def _repr_html_(self) -> str:
        """The units that flew, most urgent first, as HTML, for notebooks."""
        return in_notebook(self)
