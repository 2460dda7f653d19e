"""Arguments and results of an onboarding."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path

from msgspec import Struct, field

from calibrary.arguments import Stated
from calibrary.calib.board import Board
from calibrary.calib.detection import Detections
from calibrary.calib.result import CalibrationResult
from calibrary.calibration import CameraKey, ImageSize
from calibrary.jobs.onboard.cameras import PayloadCamera, PayloadCameras
from calibrary.jobs.onboard.classify import Payload
from calibrary.jobs.onboard.comparison import EstimateComparison, Relative
from calibrary.jobs.onboard.estimates import Estimate, Kind
from calibrary.jobs.onboard.proposal import Serves
from calibrary.policy import Policy
from calibrary.progress import Progress
from calibrary.registry.entry import Entry
from calibrary.registry.registry import Registry
from calibrary.validation import Finding, Report

__all__ = ["CameraDecision", "Decision", "ImageSolve", "Onboarding", "Questions", "Request"]


class Decision(StrEnum):
    """Decision on one camera; the value is the text shown to the user."""

    PROPOSED = "draft proposed"
    KNOWN = "nothing new"
    REFUSED = "refused"


class Questions(Struct, frozen=True, kw_only=True):
    """Questions that only the user can answer, asked only if needed.

    Attributes:
        square_mm: returns the side of a board's square in mm; called with the number of frames that show a
            board.
        serves: returns whether a measured K applies to this unit only; called with the camera in words.
        stated: the answer to ``serves`` stated in advance; None to ask.
    """

    square_mm: Callable[[int], float]
    serves: Callable[[str], Serves]
    stated: Serves | None = None


class Request(Struct, frozen=True, kw_only=True):
    """Arguments of an onboarding.

    Attributes:
        folder: files that came with the payload.
        registry: the registry for the proposal.
        questions: questions to the user.
        said: replaces known camera fields by those that the user states, for cameras without a name.
        image_size: for calibration files that do not state theirs.
        board: the board in the frames; None for a checkerboard with numbers of corners to be found by trying.
        trusted: kind of source to use if estimates disagree and nothing else decides.
        only: part of the name of the cameras to onboard; None for all.
        stated: provenance of calibrations that their sources do not state.
        flight: whether to calibrate also from the images of a flight, which takes minutes.
        label: label of the unit; None keeps the present one.
        workers: processes; 0 for automatic.
        progress: called with the number done, the total and the unit: first files, then frames.
    """

    folder: Path
    registry: Registry
    questions: Questions
    said: Callable[[CameraKey], CameraKey] = lambda known: known
    image_size: ImageSize | None = None
    board: Board | None = None
    trusted: Kind | None = None
    only: str | None = None
    stated: Stated = field(default_factory=Stated)
    flight: bool = False
    label: str | None = None
    workers: int = 0
    progress: Progress | None = None

    @property
    def policy(self) -> Policy:
        """Policy of the registry."""
        return self.registry.configuration.policy


class ImageSolve(Struct, frozen=True, kw_only=True, eq=False):
    """Result of solving the frames of a board or the images of a flight.

    Attributes:
        images: number of images.
        collected, result: None if no board was found or nothing could be solved.
        reason: why there is no result.
    """

    images: int
    collected: Detections | None = None
    result: CalibrationResult | None = None
    reason: str | None = None


class CameraDecision(Struct, frozen=True, kw_only=True, eq=False):
    """Decision on one camera, with all evidence.

    Attributes:
        camera: the camera and its files.
        decision: the decision.
        reason: of the decision, in a sentence.
        advice: what to do next.
        board: solve of its frames of a board, None if there are none.
        flight: solve of the images of its flight; None if there is none, or not requested.
        flight_images: number of images that K could also be calibrated from, but was not.
        estimates: all estimates, the proposed one first.
        comparison: of the others with it; None if no source gives a K.
        report: validation of the K.
        entry: the entry to write; None if there is none.
        current: the entry at its path on the registry's main branch.
        findings: of the registry check.
        relatives: entries of the same model.
    """

    camera: PayloadCamera
    decision: Decision
    reason: str
    advice: str | None = None
    board: ImageSolve | None = None
    flight: ImageSolve | None = None
    flight_images: int = 0
    estimates: tuple[Estimate, ...] = ()
    comparison: EstimateComparison | None = None
    report: Report | None = None
    entry: Entry | None = None
    current: Entry | None = None
    findings: tuple[Finding, ...] = ()
    relatives: tuple[Relative, ...] = ()


class Onboarding(Struct, frozen=True, kw_only=True, eq=False):
    """Result of an onboarding.

    Attributes:
        request: the arguments.
        payload: the classified files.
        cameras: its cameras, and the files that belong to none.
        outcomes: decision on each camera.
    """

    request: Request
    payload: Payload
    cameras: PayloadCameras
    outcomes: tuple[CameraDecision, ...]

    @property
    def is_good(self) -> bool:
        """Whether there is a camera, and none was refused."""
        return bool(self.outcomes) and all(one.decision is not Decision.REFUSED for one in self.outcomes)

    @property
    def drafts(self) -> tuple[Entry, ...]:
        """The entries to write; none if a camera was refused."""
        due = (one.entry for one in self.outcomes if one.decision is Decision.PROPOSED)
        return tuple(entry for entry in due if entry is not None) if self.is_good else ()
