"""JSON document of an onboarding (schemas/onboard-1.schema.json): the one result, which terminal and page read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from hashlib import sha256
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import msgspec

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics
from calibrary.jobs.diff.comparison import ChangeVerdict
from calibrary.jobs.images.folders import SkippedFile
from calibrary.records import Meta, Record
from calibrary.registry.entry import Entry, Status
from calibrary.registry.git.objects import ObjectId
from calibrary.validation import Finding, Use

if TYPE_CHECKING:
    from calibrary.calib.detection import Detections
    from calibrary.calib.result import CalibrationResult
    from calibrary.jobs.survey.placing import Placed
else:
    Detections = CalibrationResult = Placed = (
        Any  # they have no JSON form, which the fields of a record are looked at for
    )

Count: TypeAlias = Annotated[int, Meta(ge=0)]


class Kind(StrEnum):
    """Kind of source; the value is the text shown to the user."""

    BOARD = "board"
    FLIGHT = "flight"
    FILE = "file"
    TAGS = "tags"
    CATALOGUE = "catalogue"
    REGISTRY = "registry"


class Agreement(StrEnum):
    """How an estimate compares with the chosen one."""

    AGREES = "agrees"
    DIFFERS = "differs"
    DISAGREES = "disagrees"


class Decision(StrEnum):
    """Decision on one camera; the value is the text shown to the user."""

    READY = "ready, not written"
    PROPOSED = "draft proposed"
    KNOWN = "nothing new"
    REFUSED = "refused"


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


class Estimate(Record):
    """Estimate of K from one source, compared with the chosen one.

    Attributes:
        kind: of the source.
        name: of the tag, file or entry.
        grade: of its K; None if it is only an expectation.
        intrinsics: at the size of the camera's images.
        measured_centre: whether the source states cx and cy.
        chosen: whether its K is proposed.
        disputed: whether it would be proposed if another estimate did not contradict it.
        difference: relative difference from the chosen estimate: of fx or fy, or of the principal point over the width.
        is_by_whole: whether that is of the whole frame, as the source is, and the images show a part of it.
        limit: of the difference, as a fraction of fx.
        agrees: whether the difference is irrelevant; None for the chosen estimate, and for a file for a start only.
        agreement: in a word: agrees; differs by an amount relevant to a map but within the limit for two cameras of one
            model; or disagrees.
        overruled: whether it disagrees and is overruled, by the other sources or by the user.
        is_copy: whether it has the numbers of the chosen one.
        placed: the claim that it is of, at the size of the camera's images.
        calibration: with distortion and quality, if the source is a complete calibration.
        rank: sort key, best first, of estimates that may become the entry; None for those that must not.
    """

    _unwritten = frozenset({"is_by_whole", "is_copy", "placed", "calibration", "rank"})

    kind: Kind
    name: str
    grade: Grade | None = None
    intrinsics: Intrinsics
    measured_centre: bool = False
    chosen: bool = False
    disputed: bool = False
    difference: float | None = None
    is_by_whole: bool = False
    limit: float = 0.0
    agrees: bool | None = None
    agreement: Agreement | None = None
    overruled: bool = False
    is_copy: bool = False
    placed: Placed | None = None
    calibration: Calibration | None = None
    rank: tuple[int, ...] | None = None

    @property
    def of_what(self) -> str:
        """Of what the difference is, in words; empty if it is of the images."""
        return " of the whole frame" if self.is_by_whole else ""

    @property
    def standing(self) -> str | None:
        """What became of it, in a word; None if no estimate of its camera gives a K."""
        if self.chosen:
            return "in dispute" if self.disputed else "proposed"
        return "not believed" if self.overruled else self.agreement


class ImageSolve(Record):
    """Result of solving the frames of a board or the images of a flight.

    Attributes:
        images: number of images.
        board: the board, or the ground points; None if nothing was solved, like the next two.
        verdict: on the calibration.
        rms_px: reprojection error (RMS).
        reason: why there is no K; None if there is one.
        detections, result: what was solved, for the plots of the page.
    """

    _unwritten = frozenset({"detections", "result"})

    images: Annotated[int, Meta(ge=1)]
    board: str | None = None
    verdict: Use | None = None
    rms_px: float | None = None
    reason: str | None = None
    detections: Detections | None = None
    result: CalibrationResult | None = None

    @classmethod
    def of(cls, images: Sequence[object], detections: Detections, result: CalibrationResult) -> ImageSolve:
        """The result of a solve; of a refused one with the reason."""
        quality, refused = result.calibration.quality, result.verdict is Use.NONE
        return cls(
            images=len(images),
            board=str(result.observations.board),
            verdict=result.verdict,
            rms_px=quality.rms_px if quality is not None else None,
            reason="; ".join(finding.message for finding in result.findings[:2]) if refused else None,
            detections=detections,
            result=result,
        )


class ProposedEntry(Record):
    """The proposed entry.

    Attributes:
        id: of the entry.
        path: of its file.
        status: proposed status.
        status_before: present status in the registry; None for a new entry.
        calibration: its K.
        digest: of its file, for ``registry approve --digest``; None until it is written.
        entry: the entry itself.
    """

    _unwritten = frozenset({"entry"})

    id: str
    path: str
    status: Status
    status_before: Status | None
    calibration: Calibration
    digest: ObjectId | None = None
    entry: Entry | None = None

    @classmethod
    def of(cls, entry: Entry, current: Entry | None) -> ProposedEntry:
        """The proposal of an entry in place of the current one, if there is one."""
        return cls(
            id=entry.id,
            path=entry.path,
            status=entry.status,
            status_before=current.status if current is not None else None,
            calibration=entry.calibration,
            entry=entry,
        )


class RelatedEntry(Record):
    """An entry of the same model, and how the proposed K differs from it.

    Attributes:
        id: of the entry.
        own: whether it is the entry of this camera.
        status: of the entry.
        verdict: of the comparison; None if they cannot be compared, like the next four.
        kinds: kinds of structural differences, such as a crop.
        alarm: whether the difference needs attention.
        focal_change: relative change of fx or fy, whichever is larger.
        max_px: largest difference of the projections.
        reason: why they cannot be compared.
    """

    id: str
    own: bool
    status: Status
    verdict: ChangeVerdict | None = None
    kinds: tuple[str, ...] = ()
    alarm: bool | None = None
    focal_change: float | None = None
    max_px: float | None = None
    reason: str | None = None


class UsedFile(Record):
    """One file that was used to judge K.

    Attributes:
        what: image, calibration file or frame of a board.
        name: relative to the folder.
        sha256: of its bytes.
    """

    what: str
    name: str
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]


class CameraDecision(Record):
    """One camera of the payload.

    Attributes:
        camera: camera key; the serial number is a hash.
        decision: the decision.
        reason: of the decision, in a sentence.
        next: what to do; None if there is nothing to do.
        estimates: all estimates of K, the one to propose first.
        board: solve of its frames of a board; None if there are none.
        flight: solve of the images of its flight; None if not requested.
        hint: another estimate that could be had from the images; None if there is none.
        findings: what speaks against K, the gravest first.
        entry: the proposed entry; None if there is none.
        branch: for its draft; None if there is none to propose.
        check: findings of the registry check on the entry.
        relatives: entries of the same model.
        sources: all files that were used.
    """

    camera: CameraKey
    decision: Decision
    reason: str
    next: str | None = None
    estimates: tuple[Estimate, ...] = ()
    board: ImageSolve | None = None
    flight: ImageSolve | None = None
    hint: str | None = None
    findings: tuple[Finding, ...] = ()
    entry: ProposedEntry | None = None
    branch: str | None = None
    check: tuple[Finding, ...] = ()
    relatives: tuple[RelatedEntry, ...] = ()
    sources: tuple[UsedFile, ...] = ()


class OnboardReport(Record, tag_field="schema", tag="calibrary/onboard-1"):
    """Output of ``calibrary onboard --json``.

    Attributes:
        verdict: refused if a camera was refused; nothing is written then.
        folder: of the payload.
        registry: folder of the registry.
        policy: name of the registry's policy.
        sorted: content of the folder.
        cameras: of the payload.
        branches: commits by branch; empty if nothing was written.
        page: name of the report's page.
        warnings: about what was written.
    """

    verdict: Literal["good", "refused"]
    folder: str
    registry: str
    policy: str
    sorted: SortedFolder
    cameras: tuple[CameraDecision, ...]
    branches: Mapping[str, ObjectId]
    page: str | None
    warnings: tuple[str, ...] = ()

    def name_of(self, camera: CameraKey) -> str:
        """A camera in words, with its unit if another is called alike."""
        alike = sum(str(one.camera) == str(camera) for one in self.cameras) > 1
        return f"{camera}, unit {camera.serial[:8]}" if alike and camera.serial else str(camera)

    @property
    def is_good(self) -> bool:
        """Whether there is a camera, and none was refused."""
        return self.verdict == "good"

    @property
    def digest(self) -> str:
        """Of what was decided and the files that it was decided by, for ``--digest``.

        It leaves out K: of the same files a flight gives K anew each time, equal but for its last digits.
        """
        return sha256(msgspec.json.encode([*map(_decided, self.cameras)])).hexdigest()

    def is_as_seen(self, digest: str | None) -> bool:
        """Whether this is what was looked at, by the beginning of its digest; whatever it is if none is given."""
        return self.digest.startswith((digest or "").lower())

    @property
    def drafts(self) -> tuple[Entry, ...]:
        """The entries to write; none if a camera was refused."""
        proposed = (one.entry for one in self.cameras if one.decision is Decision.READY and self.is_good)
        return tuple(one.entry for one in proposed if one is not None and one.entry is not None)


def _decided(one: CameraDecision) -> object:
    """What a digest is of: the camera, its files, and of the entry what these and the day decide, but for K."""
    if (entry := one.entry) is None:
        return one.camera, None, one.sources
    made = entry.calibration.provenance
    return one.camera, (entry.id, entry.status_before, made.date, made.operator), one.sources
