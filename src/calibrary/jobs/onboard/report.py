"""What taking a payload on board reports, as one JSON document (schemas/onboard-1.schema.json)."""

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
    """What lies in the payload's folder.

    Attributes:
        images: of flights.
        board_frames: images that show a calibration board.
        calibration_files: of any format.
        skipped: all the rest, each with the reason.
    """

    images: Count
    board_frames: Count
    calibration_files: Count
    skipped: tuple[SkippedFile, ...]


class EstimateReport(Record):
    """What one source says K is.

    Attributes:
        kind: of source.
        name: the tag, the file, the entry.
        grade: of its K; None where it is only an expectation.
        intrinsics: at the size of the camera's images.
        chosen: whether its K is proposed.
        difference: from the chosen, as a share.
        limit: of the difference.
        agrees: whether the difference does not matter; None for the chosen itself.
        agreement: the same in a word: it agrees, differs by what matters on a map but within the limit, or disagrees.
        overruled: whether it disagrees and is outvoted.
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
    """What became of the frames of a board, or of the images of a flight.

    Attributes:
        images: how many there are.
        board: which one, or the points of the ground; None where nothing was solved, as the next two.
        verdict: of the calibration.
        rms_px: reprojection error.
        reason: why there is no K; None where there is one.
    """

    images: Annotated[int, Meta(ge=1)]
    board: str | None
    verdict: BoardVerdict | None
    rms_px: float | None
    reason: str | None


class ProposedEntry(Record):
    """The entry as it would be written.

    Attributes:
        id: of the entry.
        path: of its file.
        status: it would have.
        status_before: it has in the registry; None where it is new.
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
        own: whether it is of this very camera.
        verdict: of the comparison; None where they cannot be compared, as the next three.
        alarm: whether a person has to look.
        focal_change: of fx or fy, whichever is larger, as a share.
        max_px: of the difference of the projections.
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
    """One file that the K was judged by.

    Attributes:
        what: image, calibration file or frame of a board.
        name: below the folder.
        sha256: of its bytes.
    """

    what: str
    name: str
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]


class DecisionReport(Record):
    """One camera of the payload.

    Attributes:
        camera: which; the serial number is a hash.
        decision: what becomes of it.
        reason: why, in a sentence.
        next: what to do; None where there is nothing to do.
        estimates: every estimate of K, the proposed one first.
        board: of its frames of a board; None where there are none.
        flight: of the images of its flight; None where that was not asked for.
        findings: K against the policy.
        entry: None where it came to none.
        check: what the registry's check says of the entry.
        relatives: entries of the same model.
        sources: every file that was read for it.
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
    """What ``calibrary onboard --json`` prints.

    Attributes:
        verdict: refused where one camera was, and nothing is written.
        folder: of the payload.
        registry: its folder.
        policy: of the registry, by its name.
        sorted: what lies in the folder.
        cameras: of the payload.
        branches: the commit on each branch that was written.
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
    """The whole of it.

    Args:
        done: what was found.
        written: the commit on each branch; empty where nothing was written.
        page: the name of the page beside it.
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
        max_px=numbers.difference.max_px if numbers is not None else None,
        reason=relative.reason,
    )
