"""JSON document of an onboarding (schemas/onboard-1.schema.json)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, TypeAlias

from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics
from calibrary.jobs.diff.comparison import ChangeVerdict
from calibrary.jobs.images.folders import SkippedFile
from calibrary.jobs.onboard.comparison import Agreement, EstimateComparison, Relative
from calibrary.jobs.onboard.estimates import Estimate, Kind
from calibrary.jobs.onboard.proposal import sources_of
from calibrary.jobs.onboard.records import CameraDecision, Decision, ImageSolve, Onboarding
from calibrary.records import Meta, Record
from calibrary.registry.entry import Status
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.writing import Written
from calibrary.validation import Finding

__all__ = ["OnboardReport", "report_of"]

Count: TypeAlias = Annotated[int, Meta(ge=0)]


class SortedFolder(Record):
    """Content of the payload's folder.

    Attributes:
        images: number of images of flights.
        board_frames: number of images that show a calibration board.
        calibration_files: number of calibration files of any format.
        skipped: all other files, with the reason.
    """

    images: Count
    board_frames: Count
    calibration_files: Count
    skipped: tuple[SkippedFile, ...]


class EstimateReport(Record):
    """Estimate of K from one source.

    Attributes:
        kind: of the source.
        name: of the tag, file or entry.
        grade: of its K; None if it is only an expectation.
        intrinsics: at the size of the camera's images.
        chosen: whether its K is proposed.
        difference: relative difference from the chosen estimate.
        limit: of the difference.
        agrees: whether the difference is irrelevant; None for the chosen estimate.
        agreement: in a word: agrees; differs by an amount relevant to a map but within the limit; or disagrees.
        overruled: whether it disagrees and is overruled.
    """

    kind: Kind
    name: str
    grade: Grade | None
    intrinsics: Intrinsics
    chosen: bool
    difference: float | None
    limit: float
    agrees: bool | None
    agreement: Agreement | None
    overruled: bool


class SolveReport(Record):
    """Result of solving the frames of a board or the images of a flight.

    Attributes:
        images: number of images.
        board: the board, or the ground points; None if nothing was solved, like the next two.
        verdict: on the calibration.
        rms_px: reprojection error (RMS).
        reason: why there is no K; None if there is one.
    """

    images: Annotated[int, Meta(ge=1)]
    board: str | None
    verdict: BoardVerdict | None
    rms_px: float | None
    reason: str | None


class ProposedEntry(Record):
    """The proposed entry.

    Attributes:
        id: of the entry.
        path: of its file.
        status: proposed status.
        status_before: present status in the registry; None for a new entry.
        calibration: its K.
    """

    id: str
    path: str
    status: Status
    status_before: Status | None
    calibration: Calibration


class RelativeReport(Record):
    """An entry of the same model, and how the proposed K differs from it.

    Attributes:
        id: of the entry.
        own: whether it is the entry of this camera.
        verdict: of the comparison; None if they cannot be compared, like the next three.
        alarm: whether the difference needs attention.
        focal_change: relative change of fx or fy, whichever is larger.
        max_px: largest difference of the projections.
        reason: why they cannot be compared.
    """

    id: str
    own: bool
    verdict: ChangeVerdict | None
    alarm: bool | None
    focal_change: float | None
    max_px: float | None
    reason: str | None


class SourceReport(Record):
    """One file that was used to judge K.

    Attributes:
        what: image, calibration file or frame of a board.
        name: relative to the folder.
        sha256: of its bytes.
    """

    what: str
    name: str
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]


class DecisionReport(Record):
    """One camera of the payload.

    Attributes:
        camera: camera key; the serial number is a hash.
        decision: the decision.
        reason: of the decision, in a sentence.
        next: what to do; None if there is nothing to do.
        estimates: all estimates of K, the proposed one first.
        board: solve of its frames of a board; None if there are none.
        flight: solve of the images of its flight; None if not requested.
        findings: of the validation of K.
        entry: the proposed entry; None if there is none.
        check: findings of the registry check on the entry.
        relatives: entries of the same model.
        sources: all files that were used.
    """

    camera: CameraKey
    decision: Decision
    reason: str
    next: str | None
    estimates: tuple[EstimateReport, ...]
    board: SolveReport | None
    flight: SolveReport | None
    findings: tuple[Finding, ...]
    entry: ProposedEntry | None
    check: tuple[Finding, ...]
    relatives: tuple[RelativeReport, ...]
    sources: tuple[SourceReport, ...]


class OnboardReport(Record, tag_field="schema", tag="calibrary/onboard-1"):
    """Output of ``calibrary onboard --json``.

    Attributes:
        verdict: refused if a camera was refused; nothing is written then.
        folder: of the payload.
        registry: folder of the registry.
        policy: name of the registry's policy.
        sorted: content of the folder.
        cameras: of the payload.
        branches: commits by branch.
        page: name of the report's page.
    """

    verdict: Literal["good", "refused"]
    folder: str
    registry: str
    policy: str
    sorted: SortedFolder
    cameras: tuple[DecisionReport, ...]
    branches: Mapping[str, ObjectId]
    page: str | None


def report_of(done: Onboarding, written: Mapping[str, Written], page: str | None) -> OnboardReport:
    """Make the report of an onboarding.

    Args:
        done: result of the onboarding.
        written: commits by branch; empty if nothing was written.
        page: name of the page.
    """
    payload, frames = done.payload, len(done.payload.frames)
    return OnboardReport(
        verdict="good" if done.is_good else "refused",
        folder=str(payload.folder),
        registry=str(done.request.registry.repo.path),
        policy=done.request.policy.name,
        sorted=SortedFolder(
            images=payload.images - frames,
            board_frames=frames,
            calibration_files=len(payload.files),
            skipped=(*payload.others, *done.cameras.skipped),
        ),
        cameras=tuple(_camera(one, done) for one in done.outcomes),
        branches={branch: one.commit for branch, one in written.items()},
        page=page,
    )


def _camera(one: CameraDecision, done: Onboarding) -> DecisionReport:
    return DecisionReport(
        camera=one.camera.key,
        decision=one.decision,
        reason=one.reason,
        next=one.advice,
        estimates=tuple(_estimate(estimate, one.comparison) for estimate in one.estimates),
        board=_solve(one.board) if one.board is not None else None,
        flight=_solve(one.flight) if one.flight is not None else None,
        findings=one.report.findings if one.report is not None else (),
        entry=_entry(one),
        check=one.findings,
        relatives=tuple(map(_relative, one.relatives)),
        sources=tuple(
            SourceReport(what=what, name=source.name, sha256=source.sha256)
            for what, source in sources_of(one.camera, done.payload)
        ),
    )


def _entry(one: CameraDecision) -> ProposedEntry | None:
    entry = one.entry
    if entry is None:
        return None
    return ProposedEntry(
        id=entry.id,
        path=entry.path,
        status=entry.status,
        status_before=one.current.status if one.current is not None else None,
        calibration=entry.calibration,
    )


def _estimate(estimate: Estimate, comparison: EstimateComparison | None) -> EstimateReport:
    others = comparison.others if comparison is not None else ()
    compared = next((one for one in others if one.estimate is estimate), None)
    return EstimateReport(
        kind=estimate.kind,
        name=estimate.name,
        grade=estimate.grade,
        intrinsics=estimate.intrinsics,
        chosen=comparison is not None and estimate is comparison.chosen,
        difference=compared.difference if compared is not None else None,
        limit=estimate.limit,
        agrees=compared.agrees if compared is not None else None,
        agreement=compared.agreement if compared is not None else None,
        overruled=comparison is not None and compared is not None and compared in comparison.overruled,
    )


def _solve(solve: ImageSolve) -> SolveReport:
    result = solve.result
    quality = result.calibration.quality if result is not None else None
    return SolveReport(
        images=solve.images,
        board=str(result.observations.board) if result is not None else None,
        verdict=result.verdict if result is not None else None,
        rms_px=quality.rms_px if quality is not None else None,
        reason=solve.reason,
    )


def _relative(relative: Relative) -> RelativeReport:
    found = relative.comparison
    numbers = found.numbers if found is not None else None
    return RelativeReport(
        id=relative.id,
        own=relative.own,
        verdict=found.verdict if found is not None else None,
        alarm=found.alarm if found is not None else None,
        focal_change=numbers.focal_change if numbers is not None else None,
        max_px=numbers.projection.max_px if numbers is not None else None,
        reason=relative.reason,
    )
