"""What a run reports, as one JSON document (schemas/report-1.schema.json)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import msgspec

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics
from calibrary.evidence.conflict import Cause
from calibrary.evidence.estimate import Dropped, SourceEstimate
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.extraction import CameraReport, Extraction
from calibrary.jobs.extract.fallback import Step
from calibrary.jobs.extract.hand_off import seed_command
from calibrary.jobs.extract.states import StateDocument
from calibrary.jobs.images.folders import SkippedFile
from calibrary.records import Json, Meta, Record, encoded
from calibrary.sfm.pixel_check import PixelCheck
from calibrary.validation import Finding, Report, Verdict

__all__ = ["CameraDocument", "ExtractReport", "encode", "report_of"]


class JudgedSource(SourceEstimate):
    """What one source says of K.

    Attributes:
        chosen: whether the camera's K rests on it.
    """

    chosen: bool


class Disagreement(Record):
    """Two sources of one camera that are further apart than they may be.

    Attributes:
        chosen: tag of the better one.
        other: tag of the one that disagrees with it.
        difference: (other − chosen) / chosen of the focal length.
        cause: the likeliest reason.
    """

    chosen: str
    other: str
    difference: float
    cause: Cause


class RejectedCandidate(Record):
    """The numbers that failed, for whoever looks into it.

    Attributes:
        grade: what such a K is good for.
        tag: where it is from.
        intrinsics: the numbers.
        findings: of every rule.
    """

    grade: Grade
    tag: str | None
    intrinsics: Intrinsics
    findings: tuple[Finding, ...]


class Seed(Record):
    """Where a self-calibration may start; not a K.

    Attributes:
        grade: always ``seed``.
        intrinsics: where to start.
        note: what it is for.
        colmap: the commands that refine it.
    """

    grade: Grade
    intrinsics: Intrinsics
    note: str
    colmap: str


class CameraDocument(Record):
    """One camera of a run.

    Attributes:
        id: its name in file names, unique in the run.
        camera: which camera.
        calibration: its K; None where there is none to use. It is written with the camera in it, and a camera without
            a K is written as ``{"camera": …}``: no "K" is there to be picked up by mistake.
        verdict: of K.
        why: the reason, where K is not valid or not the images' own.
        what_to_do: the next step; None where there is nothing to do.
        uncalibrated: whether principal point and distortion are defaults.
        output: name of the file K is written to.
        rejected_candidate: the K that the images gave and the policy rejected.
        known_as: what the catalogue calls the camera.
        sources: what each source states of K.
        dropped: sources that are there and cannot be of these images.
        conflicts: sources that disagree.
        findings: of every rule.
        spread: of fx over the images, as a share of it.
        fallback: what was tried where the images give no valid K.
        seed: where a self-calibration may start.
        images: path of each image below the folder, or of the first of very many.
        more_images: how many more there are than are listed; 0 in reports of earlier versions.
        states: those images by what can change K or its meaning; none in reports of earlier versions.
        label: what the registry calls the unit; None where its entry is of no unit, or no entry is used for it.
        pixels: what the pixels of some images say of K; None where they were not asked.
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
    sources: tuple[JudgedSource, ...]
    dropped: tuple[Dropped, ...]
    conflicts: tuple[Disagreement, ...]
    findings: tuple[Finding, ...]
    spread: float | None
    fallback: tuple[Step, ...]
    seed: Seed | None
    images: tuple[str, ...]
    states: tuple[StateDocument, ...] = ()
    more_images: Annotated[int, Meta(ge=0)] = 0
    label: str | None = None
    pixels: PixelCheck | None = None

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


class ExtractReport(Record, tag_field="schema", tag="calibrary/report-1"):
    """What ``calibrary extract`` found.

    Attributes:
        policy: the name of the policy that K is judged by.
        uncalibrated: whether any camera goes on without measured principal point and distortion.
        images: how many were looked at.
        cameras: in a fixed order.
        rejected: images that cannot be read.
        skipped: pictures that are not images of a camera, such as a preview or a map; none in earlier versions.
        warnings: what to know of the run itself.
        exit_code: 0 where every image has a valid K, and the solver got what was asked for; 3 where some were not
            read because the processes that read them were killed.
        more_rejected, more_skipped: how many more there are of each than are listed.
    """

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


def report_of(outcome: Extraction, outputs: Mapping[str, str]) -> ExtractReport:
    """The whole run.

    Args:
        outcome: what was found.
        outputs: the K file of each camera that has one, by slug.
    """
    return ExtractReport(
        policy=outcome.policy.name,
        uncalibrated=outcome.uncalibrated,
        images=outcome.images,
        cameras=tuple(_camera(c, outputs.get(c.slug)) for c in outcome.cameras),
        rejected=outcome.rejected,
        warnings=outcome.warnings,
        exit_code=outcome.exit_code,
        skipped=outcome.skipped,
        more_rejected=outcome.more_rejected,
        more_skipped=outcome.more_skipped,
    )


def encode(document: Mapping[str, Json] | Record) -> bytes:
    """A JSON file's content."""
    return encoded(document) + b"\n"


def _camera(c: CameraReport, output: str | None) -> CameraDocument:
    evidence = c.camera.evidence
    failed = c.camera.calibration if c.calibration is None else None
    return CameraDocument(
        id=c.slug,
        camera=c.calibration.camera if c.calibration is not None else c.camera.key,
        calibration=c.calibration,
        verdict=c.verdict,
        why=c.reason,
        what_to_do=c.advice,
        uncalibrated=c.uncalibrated,
        output=output,
        rejected_candidate=_candidate(c.camera, failed) if failed is not None else None,
        known_as=c.camera.states[0].known.title,
        sources=tuple(
            JudgedSource(**msgspec.structs.asdict(one), chosen=one is evidence.chosen)
            for one in evidence.estimates
        ),
        dropped=tuple(dropped for dropped, _ in c.camera.dropped),
        conflicts=tuple(
            Disagreement(
                chosen=conflict.chosen.tag,
                other=conflict.other.tag,
                difference=conflict.difference,
                cause=conflict.cause,
            )
            for conflict in evidence.conflicts
        ),
        findings=_findings(c.report),
        spread=c.camera.spread,
        fallback=c.fallback.steps if c.fallback is not None else (),
        seed=_seed(c),
        images=c.camera.names,
        more_images=c.camera.count - len(c.camera.names),
        states=c.states,
        label=c.label,
        pixels=c.pixels,
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


def _seed(c: CameraReport) -> Seed | None:
    seed = c.fallback.seed if c.fallback is not None else None
    if seed is None:
        return None
    return Seed(
        grade=seed.grade,
        intrinsics=seed.intrinsics,
        note="no K: a start for self-calibration",
        colmap=seed_command(seed),
    )
