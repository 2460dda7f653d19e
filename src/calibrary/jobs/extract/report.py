"""JSON document of a run (schemas/report-1.schema.json)."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Annotated, Any

from msgspec import Struct, field

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics
from calibrary.evidence.context import Dropped, SourceEstimate
from calibrary.interop.colmap_database import DatabaseChange
from calibrary.jobs.extract.calibration_files import CalibrationsOfFile
from calibrary.jobs.extract.cameras import Camera, StateDocument
from calibrary.jobs.extract.extraction import JudgedCamera, name_of
from calibrary.jobs.extract.fallback import Step
from calibrary.jobs.extract.hand_off import HandOff
from calibrary.jobs.extract.targets import seed_command
from calibrary.jobs.images.folders import SkippedFile
from calibrary.jobs.use import Allowed
from calibrary.pages.notebook import in_notebook
from calibrary.policy import FLEET, Policy
from calibrary.records import Json, Meta, Record, encoded
from calibrary.sfm.pixel_check import PixelCheck
from calibrary.validation import Finding, Report, Verdict


class RejectedCandidate(Record):
    """A K that was rejected, for analysis.

    Attributes:
        grade: origin of its intrinsics.
        tag: its source.
        intrinsics: the numbers.
        findings: of all rules.
    """

    grade: Grade
    tag: str | None
    intrinsics: Intrinsics
    findings: tuple[Finding, ...]


class Seed(Record):
    """Initial values for a self-calibration; not a K.

    Attributes:
        grade: always ``seed``.
        intrinsics: the initial values.
        note: purpose.
        colmap: commands that refine it.
    """

    grade: Grade
    intrinsics: Intrinsics
    note: str
    colmap: str


class CameraDocument(Record):
    """One camera of a run.

    Attributes:
        id: its name in file names, unique in the run.
        camera: camera key.
        calibration: its K; None without a usable one. The written form contains the camera; a camera without
            a K is written as ``{"camera": …}``, without a "K" that could be used by mistake.
        verdict: on K.
        why: reason if K is not valid or not from the images.
        what_to_do: the next step; None if there is nothing to do.
        uncalibrated: whether principal point and distortion are defaults.
        output: name of the file that K is written to.
        rejected_candidate: the K from the images that the policy rejected.
        known_as: name of the camera in the catalogue.
        sources: estimates of K from each source.
        dropped: sources that are present but cannot belong to these images.
        findings: of all rules.
        spread: spread of K over the images, as a fraction of fx.
        fallback: steps that were tried because the images give no valid K.
        seed: initial values for a self-calibration.
        images: path of each image relative to the folder; only the first if there are very many.
        more_images: number of images that are not listed; 0 in reports of earlier versions.
        states: the images by camera state; empty in reports of earlier versions.
        label: label of the unit in the registry; None if its entry has none, or no entry is used.
        pixels: check of K against the pixels of some images; None if not requested.
        use: what a solver may do with K; None in reports of earlier versions.
    """

    id: str
    camera: CameraKey
    calibration: Calibration | None
    verdict: Verdict
    why: str | None
    what_to_do: str | None
    uncalibrated: bool
    output: str | None
    rejected_candidate: RejectedCandidate | None
    known_as: str | None
    sources: tuple[SourceEstimate, ...]
    dropped: tuple[Dropped, ...]
    findings: tuple[Finding, ...]
    spread: float | None
    fallback: tuple[Step, ...]
    seed: Seed | None
    images: tuple[str, ...]
    states: tuple[StateDocument, ...] = ()
    more_images: Annotated[int, Meta(ge=0)] = 0
    label: str | None = None
    pixels: PixelCheck | None = None
    use: Allowed | None = None

    @property
    def name(self) -> str:
        """The camera in words."""
        return name_of(self.camera, self.id, self.label)

    @property
    def count(self) -> int:
        """Number of images."""
        return len(self.images) + self.more_images

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        camera = document.pop("camera")
        return document | {"calibration": document["calibration"] or {"camera": camera}}

    @classmethod
    def _unwire(cls, document: dict[str, Json]) -> dict[str, Json]:
        found = document.get("calibration")
        if isinstance(found, dict) and "camera" in found:
            document["camera"] = found["camera"]
            document["calibration"] = found if len(found) > 1 else None
        return document

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], _defs: dict[str, Any]) -> dict[str, Any]:
        members = schema["properties"]
        without = {
            "type": "object",
            "required": ["camera"],
            "additionalProperties": False,
            "properties": {"camera": members.pop("camera")},
        }
        schema["required"].remove("camera")
        calibration = members["calibration"]
        alternatives = [one for one in calibration["anyOf"] if one != {"type": "null"}]
        members["calibration"] = calibration | {"anyOf": [*alternatives, without]}
        return schema


class Outputs(Struct, frozen=True, kw_only=True):
    """Files to be written.

    Attributes:
        files: content by path.
        report: path of the report.
        matrices: name of the K file by camera slug.
        stale: K and solver files of an earlier run that this run does not replace.
        database: change to be written to a COLMAP database.
        is_dry_run: whether nothing of it is written.
    """

    files: dict[Path, bytes] = field(default_factory=dict)
    report: Path | None = None
    matrices: dict[str, str] = field(default_factory=dict)
    stale: tuple[Path, ...] = ()
    database: DatabaseChange | None = None
    is_dry_run: bool = False


class ExtractReport(Record, tag_field="schema", tag="calibrary/report-1"):
    """Report of ``calibrary extract``.

    Attributes:
        policy: name of the policy with the limits.
        uncalibrated: whether any camera has no measured principal point and distortion.
        images: number of images.
        cameras: in a fixed order.
        rejected: images that cannot be read, and therefore have no K.
        skipped: pictures that are not camera images, such as a preview or a map, which do not affect the result; empty
            in earlier versions.
        warnings: on the run itself.
        exit_code: 0 if every image has a valid K and the requested hand-off succeeded; 3 if some images were
            not read because the reading processes were killed.
        more_rejected, more_skipped: numbers of those that are not listed.
        hand_off: what the program gets; None without one.
        limits: the policy; like all that follows, not written.
        judged: the cameras with their evidence.
        calibration_files: calibration files in the folders of the images.
        unreadable_files: files that look like calibrations but cannot be read, with the reason.
        root: folder that image names are relative to.
        places: last names of the given folders, archives and URLs.
        days: first and last date of the images; None if none states a date, or dates were not requested.
        outputs: files that were planned or written, and what their reader must know.

    >>> found = calibrary.extract("survey")
    >>> found.is_good, [camera.verdict.value for camera in found.cameras], found.skipped
    (True, ['valid'], ())
    """

    _unwritten = frozenset(
        {"limits", "judged", "calibration_files", "unreadable_files", "root", "places", "days", "outputs"}
    )

    policy: str
    uncalibrated: bool
    images: Annotated[int, Meta(ge=0)]
    cameras: tuple[CameraDocument, ...]
    rejected: tuple[SkippedFile, ...]
    warnings: tuple[str, ...]
    exit_code: Annotated[int, Meta(ge=0, le=3)]
    skipped: tuple[SkippedFile, ...] = ()
    more_rejected: Annotated[int, Meta(ge=0)] = 0
    more_skipped: Annotated[int, Meta(ge=0)] = 0
    hand_off: HandOff | None = None
    limits: Policy = FLEET
    judged: tuple[JudgedCamera, ...] = ()
    calibration_files: tuple[CalibrationsOfFile, ...] = ()
    unreadable_files: tuple[tuple[str, str], ...] = ()
    root: Path = Path()
    places: tuple[str, ...] = ()
    days: tuple[date, date] | None = None
    outputs: Outputs = field(default_factory=Outputs)

    @property
    def is_good(self) -> bool:
        """Whether there is at least one camera and every image has a valid K."""
        valid = all(camera.verdict is Verdict.VALID for camera in self.cameras)
        return bool(self.cameras) and valid and not self.rejected

    @property
    def unread(self) -> str | None:
        """Number of images and folders that cannot be read, in words; None if there are none."""
        folders = sum(one.name.endswith("/") for one in self.rejected)
        files = len(self.rejected) + self.more_rejected - folders
        images = files + sum(len(camera.images) + camera.more_images for camera in self.cameras)
        counted = [f"{files} of {images} images"] if files else []
        counted += [f"{folders} folder{'s' if folders > 1 else ''}"] if folders else []
        return f"{' and '.join(counted)} unread" if counted else None

    def _repr_html_(self) -> str:
        """Return the answer as HTML, for notebooks."""
        return in_notebook(self)


def encode(document: Mapping[str, Json] | Record) -> bytes:
    """Encode the content of a JSON file."""
    return encoded(document) + b"\n"


def camera_document(c: JudgedCamera) -> CameraDocument:
    """What the report says of a camera; where its K is written is planned later."""
    failed = c.camera.calibration if c.calibration is None else None
    return CameraDocument(
        id=c.slug,
        camera=c.calibration.camera if c.calibration is not None else c.camera.key,
        calibration=c.calibration,
        verdict=c.verdict,
        why=c.reason,
        what_to_do=c.advice,
        uncalibrated=c.uncalibrated,
        output=None,
        rejected_candidate=_candidate(c.camera, failed) if failed is not None else None,
        known_as=c.camera.states[0].known.title,
        sources=c.camera.evidence.estimates,
        dropped=tuple(dropped for dropped, _ in c.camera.dropped),
        findings=_findings(c.report),
        spread=c.camera.spread,
        fallback=c.fallback.steps if c.fallback is not None else (),
        seed=_seed(c),
        images=c.camera.names,
        more_images=c.camera.count - len(c.camera.names),
        states=c.states,
        label=c.label,
        pixels=c.pixels,
        use=c.use,
    )


def _candidate(camera: Camera, failed: Calibration) -> RejectedCandidate:
    return RejectedCandidate(
        grade=failed.grade,
        tag=failed.provenance.tag,
        intrinsics=failed.intrinsics,
        findings=_findings(camera.report),
    )


def _findings(report: Report | None) -> tuple[Finding, ...]:
    return report.findings if report is not None else ()


def _seed(c: JudgedCamera) -> Seed | None:
    seed = c.fallback.seed if c.fallback is not None else None
    if seed is None:
        return None
    return Seed(
        grade=seed.grade,
        intrinsics=seed.intrinsics,
        note="no K: a start for self-calibration",
        colmap=seed_command(seed),
    )
