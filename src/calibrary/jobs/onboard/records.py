"""What is asked of a payload, and what becomes of each of its cameras."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path

from msgspec import Struct, field

from calibrary.calib.board import Board
from calibrary.calib.collect import Collected
from calibrary.calib.result import CalibrationResult
from calibrary.calibration import CameraKey, ImageSize
from calibrary.jobs.exchange.add import Stated
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
    """What becomes of one camera; the value is what people read."""

    PROPOSED = "draft proposed"
    KNOWN = "nothing new"
    REFUSED = "refused"


class Questions(Struct, frozen=True, kw_only=True):
    """What only a person knows, asked where it is needed and nowhere else.

    Attributes:
        square_mm: the side of a board's square; given how many frames show one.
        serves: whether a measured K is this unit's alone; given the camera in words.
        stated: what was said of that beforehand; None where a person is asked.
    """

    square_mm: Callable[[int], float]
    serves: Callable[[str], Serves]
    stated: Serves | None = None


class Request(Struct, frozen=True, kw_only=True):
    """What to take on board.

    Attributes:
        folder: what came with the payload.
        registry: to propose to.
        questions: see there.
        said: puts what was said of a camera in the place of what is known, for cameras without a name.
        image_size: of calibration files that do not say theirs.
        board: which board the frames show; None for a checkerboard whose corners are counted by trying.
        trusted: whom to believe where estimates disagree and nothing else decides.
        only: a part of the name of the cameras that are meant; None for all.
        stated: of the making of calibrations whose source does not say it.
        flight: whether to calibrate from the images of a flight too, which takes minutes.
        label: what the keeper calls the unit that the payload is; None leaves what it is called.
        workers: processes; 0 decides by itself.
        progress: called with how many are done, of how many, and of what: files, then frames.
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
        """The registry's."""
        return self.registry.configuration.policy


class ImageSolve(Struct, frozen=True, kw_only=True, eq=False):
    """What became of the frames of a board, or of the images of a flight.

    Attributes:
        images: how many there are.
        collected, result: None where no board was found or nothing could be solved.
        reason: then why.
    """

    images: int
    collected: Collected | None = None
    result: CalibrationResult | None = None
    reason: str | None = None


class CameraDecision(Struct, frozen=True, kw_only=True, eq=False):
    """One camera.

    Attributes:
        camera: which, and what came for it.
        decision: what becomes of it.
        reason: why, in a sentence.
        advice: what to do next.
        board: of its frames of a board, None where there are none.
        flight: of the images of its flight; None where there is none, or that was not asked for.
        flight_images: how many images there are that K could be calibrated from as well, and was not.
        estimates: everybody heard, the one that is proposed first.
        comparison: how the others stand to it; None where no source states a K.
        report: the K against the policy.
        entry: as it would be written; None where it came to none.
        current: what the registry's main branch has at its place.
        findings: what the registry's check says of it.
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
    """A payload and what becomes of it.

    Attributes:
        request: what was asked.
        payload: the folder, sorted.
        cameras: its cameras, and what is of none.
        outcomes: of each camera.
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
        """What is to be written: nothing, where a camera was refused."""
        due = (one.entry for one in self.outcomes if one.decision is Decision.PROPOSED)
        return tuple(entry for entry in due if entry is not None) if self.is_good else ()
