"""The onboard job: from a folder to a decision on every camera, with reasons and possibly a draft entry.

Only :func:`write_drafts` writes, and only to a separate branch: the calibrations in use change only by
approval.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.arguments import Stated, Terms
from calibrary.calib.board import Board
from calibrary.calib.result import CalibrationResult
from calibrary.calibration import Calibration, CameraKey
from calibrary.catalogue import overlay
from calibrary.errors import CalibraryError, CalibrationError, InputError, RegistryError, UsageError, first_of
from calibrary.extras import SFM
from calibrary.jobs.calibrate.flight_images import FlightOptions, solve_images
from calibrary.jobs.calibrate.frames import Told, describe_frames
from calibrary.jobs.calibrate.report import Asked
from calibrary.jobs.calibrate.run import observe, solved
from calibrary.jobs.fleet.changes import weighed
from calibrary.jobs.onboard.estimates import (
    Serves,
    chosen_of,
    compare_estimates,
    entry_for,
    estimates,
    held_against,
    is_same,
    refused_by,
    relatives,
)
from calibrary.jobs.onboard.payload import (
    FRAME,
    Payload,
    PayloadCamera,
    PayloadCameras,
    classify_payload,
    find_cameras,
    used_files,
    with_frames,
)
from calibrary.jobs.onboard.report import (
    Agreement,
    CameraDecision,
    Decision,
    Estimate,
    ImageSolve,
    Kind,
    OnboardReport,
    ProposedEntry,
    SortedFolder,
)
from calibrary.policy import Policy
from calibrary.progress import Progress, counted, labelled
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status
from calibrary.registry.paths import proposed_name, slug
from calibrary.registry.proposals import message_of, propose, save
from calibrary.registry.registry import Registry
from calibrary.registry.resolution import Resolution
from calibrary.sfm.pixel_judging import FEWEST_IMAGES
from calibrary.validation import Use

BRANCHES: Final = "onboard/"
SQUARE: Final = "--square-mm MM"
FOR: Final = "--for unit"
NAMELESS: Final = "nothing in it names make and model, by which an entry is found."
SECONDS_AN_IMAGE: Final = 7
"""Duration per image from features to adjustment, on two cores (docs/flight.md)."""


class Onboarding(Struct, frozen=True, kw_only=True):
    """The onboarding of one payload.

    Attributes:
        folder: files that came with the payload.
        registry: the registry for the proposal.
        camera: what the user states of the cameras, for those without a name.
        stated: provenance of calibrations that their sources do not state.
        board: the board in the frames; None for one that is found by trying.
        square_mm: side of the board's squares; None to ask for it.
        serves: whether a measured K applies to this unit only; None to ask.
        ask: returns the user's answer to a question, given the flags that would answer it; None if nobody can be asked.
        trusted: kind of source to use if estimates disagree and nothing else decides.
        flight: whether to calibrate also from the images of a flight, which takes minutes.
        label: label of the unit; None keeps the present one.
        workers: processes; 0 for automatic.
        progress: called with the number done, the total and the unit: first files, then frames.
    """

    folder: Path
    registry: Registry
    camera: CameraKey
    stated: Stated
    board: Board | None
    square_mm: float | None
    serves: Serves | None
    ask: Callable[[str, str], str] | None
    trusted: Kind | None
    flight: bool
    label: str | None
    workers: int
    progress: Progress | None

    @property
    def policy(self) -> Policy:
        """Policy of the registry."""
        return self.registry.snapshot().policy

    def run(self, only: str | None) -> OnboardReport:
        """Decide on every camera; writes nothing.

        Args:
            only: part of the name of the cameras to onboard; None for all.

        Returns:
            The result without page and branches.

        Raises:
            InputError: the folder cannot be read, or contains nothing about a camera.
            UsageError: an answer of the user is needed.
            RegistryError: the registry cannot be read.
        """
        payload = classify_payload(self.folder, workers=self.workers)
        if not payload.states and not payload.files:
            raise InputError(
                "contains neither an image nor a calibration file; give the folder of what came with the payload",
                source=str(self.folder),
            )
        said = overlay(self.camera)
        # Before the images are searched for a board, which takes long.
        self._chosen(find_cameras(payload, self.policy, said, image_size=self.camera.image_size), only)
        payload = with_frames(payload, board=self.board, progress=labelled(self.progress, "files"))
        cameras = find_cameras(payload, self.policy, said, image_size=self.camera.image_size)
        # A payload is one unit, so a stated serial number applies to all its cameras.
        chosen = [
            replace(one, key=replace(one.key, serial=said(one.key).serial))
            for one in self._chosen(cameras, only)
        ]
        known = self._asked(chosen, payload, is_nameless=bool(cameras.nameless) and not cameras.found)
        decided = tuple(known._decided(one, payload) for one in chosen)
        skipped = {one.name for one in cameras.skipped}
        is_good = bool(decided) and all(one.decision is not Decision.REFUSED for one in decided)
        if not is_good:
            decided = tuple(self._waiting(one) for one in decided)
        return OnboardReport(
            verdict="good" if is_good else "refused",
            folder=str(self.folder),
            registry=str(self.registry.repo.path),
            policy=self.policy.name,
            sorted=SortedFolder(
                images=payload.images - len(payload.frames),
                board_frames=len(payload.frames),
                calibration_files=sum(
                    path.relative_to(payload.folder).as_posix() not in skipped for path, _ in payload.files
                ),
                skipped=(*payload.others, *cameras.skipped),
            ),
            cameras=decided,
            branches={},
            page=None,
        )

    def _waiting(self, one: CameraDecision) -> CameraDecision:
        """Decision on an acceptable camera that is not written because another camera was refused."""
        if one.decision is not Decision.READY:
            return one
        return replace(one, next=f"to take it alone: calibrary onboard {self.folder} --only '{one.camera}'")

    def _chosen(self, cameras: PayloadCameras, only: str | None) -> list[PayloadCamera]:
        chosen = [one for one in cameras.found if only is None or only.casefold() in str(one.key).casefold()]
        if cameras.found and not chosen:
            names = "; ".join(str(one.key) for one in cameras.found)
            raise InputError(f"no camera in it is called {only!r:.60}: {names}", source=str(self.folder))
        return chosen

    def _asked(self, chosen: Sequence[PayloadCamera], payload: Payload, *, is_nameless: bool) -> Onboarding:
        """It with all answers that only a person knows.

        Raises:
            UsageError: nobody can be asked; its place has the flags of all that is missing.
        """
        frames = len(payload.frames) if is_nameless else sum(len(one.frames) for one in chosen)
        measured = [one for one in chosen if self.serves is None and self._may_be_of_unit(one, payload)]
        questions = {}
        if is_nameless:
            questions["--make NAME --model NAME"] = NAMELESS
        if frames and self.square_mm is None:
            shown = f"{frames} {'image shows' if frames == 1 else 'images show'} a calibration board"
            questions[SQUARE] = f"{shown}: the side of its squares in mm?"
        if measured:
            units = first_of(f"{one.key}, unit {(one.key.serial or '')[:8]}" for one in measured)
            whose = "this unit's only (--for unit), or every one's of its model (--for model)"
            questions[FOR] = f"{units}: is a measured K {whose}? [unit/model]"
        if questions and (self.ask is None or is_nameless):
            raise UsageError(" ".join(questions.values()), place=" ".join(questions))
        answers = {flag: self.ask(text, flag) for flag, text in questions.items()} if self.ask else {}
        return replace(
            self,
            square_mm=_side(answers[SQUARE]) if SQUARE in answers else self.square_mm,
            serves=_serves(answers[FOR]) if FOR in answers else self.serves,
        )

    def _may_be_of_unit(self, camera: PayloadCamera, payload: Payload) -> bool:
        """Whether a K that was measured on a unit may come of it."""
        if camera.key.serial is None or camera.frames or (self.flight and _flight_of(camera, payload)):
            return camera.key.serial is not None
        survey, found = estimates(camera, None, None, self._current(camera), self.policy)
        found, dispute = compare_estimates(survey, found, self.trusted)
        chosen = chosen_of(found) if dispute is None else None
        return chosen is not None and chosen.grade is not None and chosen.grade.is_measured

    def _decided(self, camera: PayloadCamera, payload: Payload) -> CameraDecision:
        board = self._board(camera) if camera.frames else None
        images = _flight_of(camera, payload)
        flight = self._flight(camera, images) if images and self.flight else None
        survey, found = estimates(camera, board, flight, self._current(camera), self.policy)
        found, dispute = compare_estimates(survey, found, self.trusted)
        so_far = CameraDecision(
            camera=camera.key,
            decision=Decision.REFUSED,
            reason="",
            board=board,
            flight=flight,
            hint=flight_hint(len(images)) if flight is None else None,
            estimates=found,
            sources=used_files(camera, payload),
        )
        chosen = chosen_of(found)
        if chosen is None or chosen.calibration is None:
            why, advice = _no_k(camera, board)
            return replace(so_far, reason=why, next=advice)
        if dispute is not None:
            advice = (
                "bring another estimate (frames of a board, a calibration file), take the wrong one out, or say whom "
                f"to believe: {_trusts(found)}"
            )
            return replace(so_far, reason=dispute, next=advice)
        so_far = replace(so_far, findings=held_against(survey, chosen, camera))
        refused = refused_by(so_far.findings)
        if refused is not None:
            return replace(
                so_far, reason=refused, next="correct that, or calibrate the camera: calibrary calibrate"
            )
        return self._proposed(so_far, camera, chosen, chosen.calibration)

    def _proposed(
        self,
        so_far: CameraDecision,
        camera: PayloadCamera,
        chosen: Estimate,
        K: Calibration,
    ) -> CameraDecision:
        """Propose the entry of a camera without objections so far, and check it against the registry."""
        solved = {Kind.BOARD: so_far.board, Kind.FLIGHT: so_far.flight}.get(chosen.kind)
        result = solved.result if solved is not None else None
        is_measured = chosen.grade is not None and chosen.grade.is_measured
        if self.serves is Serves.UNIT and is_measured and camera.key.serial is None:
            reason = "it is measured on one unit, and nothing in it states the serial number by which a unit is found"
            return replace(so_far, reason=reason, next="state it: --serial NUMBER, or --for model")
        # Nominal numbers are every unit's.
        is_unit = is_measured and camera.key.serial is not None and self.serves is Serves.UNIT
        serves = Serves.UNIT if is_unit else Serves.MODEL
        ordered = [chosen, *(one for one in so_far.estimates if one is not chosen)]
        try:
            entry = entry_for(
                camera, ordered, K, serves, so_far.sources, self.folder, solved=result, stated=self.stated
            )
            if entry.unit is not None:
                entry = replace(entry, label=self.label)
            snapshot = self.registry.snapshot()
            proposals = weighed(snapshot, propose(snapshot, [entry]), self.policy)
        except (InputError, RegistryError) as error:
            return replace(so_far, reason=str(error), next="see the current entry: calibrary registry list")
        [proposal] = proposals.items
        entry, current = proposal.after, proposal.before
        done = replace(
            so_far,
            entry=ProposedEntry.of(entry, current),
            check=proposals.findings,
            relatives=relatives(self.registry.snapshot(), entry, self.policy),
        )
        if proposals.errors:
            return replace(
                done, reason=str(proposals.errors[0]), next="correct that in the files of the payload"
            )
        branch = branch_of(entry.calibration.camera)
        if current is not None and is_same(current, entry):
            return replace(
                done,
                entry=ProposedEntry.of(current, current),
                decision=Decision.KNOWN,
                reason=f"the registry already has this K, {current.status.value}",
                next=f"calibrary registry approve {entry.id}" if current.status is Status.DRAFT else None,
            )
        approving = f"calibrary registry approve {entry.id} --from {branch}"
        waiting = self._waiting_at(branch, entry.path)
        if waiting is not None and is_same(waiting, entry):
            return replace(
                done,
                entry=ProposedEntry.of(waiting, current),
                decision=Decision.KNOWN,
                reason=f"a draft with this K is on the branch {branch}",
                next=approving,
            )
        nominal = self.serves is Serves.UNIT and serves is Serves.MODEL
        reason = _why(chosen, ordered[1:], result, nominal=nominal)
        return replace(done, decision=Decision.READY, reason=reason, branch=branch)

    def _board(self, camera: PayloadCamera) -> ImageSolve:
        """Calibrate the camera from its frames of a board."""
        frames = camera.frames
        try:
            metadata = describe_frames(frames, Told(camera=_said_of(camera)))
            advance = counted(self.progress, len(frames), "frames")
            board = self.board or self.square_mm or 0.0
            seen = observe(frames, metadata, board, workers=self.workers, progress=advance)
            told = self.stated if seen.observations.taken is None else replace(self.stated, date=None)
            result = solved(seen, Asked(), Told(stated=Stated(date=told.date, operator=told.operator)))
        except (CalibrationError, InputError) as error:
            return ImageSolve(images=len(frames), reason=str(error))
        return ImageSolve.of(frames, seen, result)

    def _flight(self, camera: PayloadCamera, images: tuple[Path, ...]) -> ImageSolve:
        """Calibrate the camera from the images of its flight."""
        try:
            told = Told(camera=_said_of(camera), stated=Stated(operator=self.stated.operator))
            flight = solve_images(images, told, FlightOptions(), progress=self.progress)
            result, seen = flight.calibrated(told)
        except (CalibrationError, InputError) as error:
            return ImageSolve(images=len(images), reason=str(error))
        return ImageSolve.of(images, seen, result)

    def _current(self, camera: PayloadCamera) -> Resolution | None:
        """The entry that applies to the camera at present."""
        try:
            return self.registry.snapshot().index().resolve(replace(camera.key, firmware=camera.firmware))
        except CalibraryError:
            # Two entries fit equally well, or one cannot be read: the registry check reports it; there is no estimate.
            return None

    def _waiting_at(self, branch: str, path: str) -> Entry | None:
        """The proposed or current entry on a branch, or on the main branch if that branch does not exist."""
        snapshot = self.registry.branch(branch)
        try:
            found = snapshot.at(proposed_name(path)) or snapshot.at(path)
        except RegistryError:
            return None
        return found.entry if found is not None else None


def _side(text: str) -> float:
    try:
        side = float(text)
    except ValueError:
        side = math.nan
    if not 0.01 <= side <= 10_000:
        raise UsageError(f"--square-mm: {text!r:.20}, expected a number from 0.01 to 10000")
    return side


def _serves(text: str) -> Serves:
    if text.lower() not in set(Serves):
        raise UsageError(f"--for: {text!r:.20}, expected unit or model")
    return Serves(text.lower())


def branch_of(camera: CameraKey) -> str:
    """Name of the branch on which drafts of a model wait for approval."""
    # The ~ of a slug is no letter of a branch name; no slug contains +.
    return f"{BRANCHES}{slug(camera.make or '')}-{slug(camera.model or '')}".replace("~", "+")


def page_name(done: OnboardReport) -> str:
    """Default file name of the page."""
    names = {branch_of(one.camera).removeprefix(BRANCHES) for one in done.cameras}
    return f"onboard-{names.pop() if len(names) == 1 else 'payload'}.html"


def write_drafts(done: OnboardReport, registry: Registry, reason: str | None) -> OnboardReport:
    """Write the proposed entries, with a branch for each model and a commit for each branch.

    Raises:
        FileConflictError: the same entry was written on the branch in the meantime.
        RegistryError: the registry cannot be written.
    """
    branches: dict[str, str] = {}
    digests: dict[str, str | None] = {}
    warnings: list[str] = []
    for branch in sorted({branch_of(entry.calibration.camera) for entry in done.drafts}):
        entries = [entry for entry in done.drafts if branch_of(entry.calibration.camera) == branch]
        named = entries[0].id if len(entries) == 1 else f"{len(entries)} cameras"
        sources = _sources(done, {entry.id for entry in entries})
        message = message_of(f"Propose {named}, taken on board", entries, reason, sources)
        proposals = propose(registry.branch(branch), entries)
        written = save(registry, proposals, Terms(branch=branch), message=message)
        digests |= {item.id: item.digest for item in proposals.items}
        branches[branch] = written.commit
        warnings += written.warnings
    cameras = tuple(
        _written(one, digests[one.entry.id]) if one.branch in branches and one.entry is not None else one
        for one in done.cameras
    )
    return replace(done, cameras=cameras, branches=branches, warnings=tuple(warnings))


def _written(one: CameraDecision, digest: str | None) -> CameraDecision:
    """Decision on a camera whose draft was written, with the command that approves it."""
    assert one.entry is not None  # noqa: S101  it was written
    approving = (
        f"calibrary registry approve {one.entry.id} --from {one.branch} --digest {(digest or '')[:12]}"
    )
    return replace(one, decision=Decision.PROPOSED, entry=replace(one.entry, digest=digest), next=approving)


def _sources(done: OnboardReport, entries: set[str]) -> dict[str, str | None]:
    """Return the name of every file that was used for entries, by its SHA-256."""
    # Frames of a board are numerous, and the entry itself lists them.
    return {
        source.sha256: source.name
        for one in done.cameras
        if one.entry is not None and one.entry.id in entries
        for source in one.sources
        if source.what != FRAME
    }


def flight_hint(images: int) -> str | None:
    """Sentence on a possible calibration from so many images, with its duration; None if it is not possible."""
    if images < FEWEST_IMAGES or any(find_spec(module) is None for module in SFM):
        return None
    minutes = math.ceil(min(images, FlightOptions().images) * SECONDS_AN_IMAGE / 60)
    return f"{images} images may be a flight: --flight also calibrates from them, about {minutes} min on two cores"


def _flight_of(camera: PayloadCamera, payload: Payload) -> tuple[Path, ...]:
    """The images of the folder with the most images, without frames of a board; empty if there are too few."""
    names = camera.judged.names if camera.judged is not None else ()
    by_folder = Counter(name.rpartition("/")[0] for name in names if name not in payload.frames)
    folder, count = max(by_folder.items(), key=lambda one: (one[1], one[0]), default=("", 0))
    if count < FEWEST_IMAGES:
        return ()
    return tuple(
        payload.folder / name
        for name in sorted(names)
        if name.rpartition("/")[0] == folder and name not in payload.frames
    )


def _said_of(camera: PayloadCamera) -> Callable[[CameraKey], CameraKey]:
    """The key of the camera in place of what its images state, but for their firmware."""
    return lambda known: replace(camera.key, firmware=known.firmware or camera.firmware)


def _why(
    chosen: Estimate, others: Sequence[Estimate], solved: CalibrationResult | None, *, nominal: bool
) -> str:
    grade = chosen.grade.value if chosen.grade is not None else "unknown"
    told = f"its K is that of {chosen.name}, grade {grade}"
    # What was written from another source is no second one.
    for is_copy, verbs in ((True, ("has its numbers", "have its numbers")), (False, ("agrees", "agree"))):
        names = [one.name for one in others if one.agrees and one.is_copy is is_copy]
        told += f"; {', '.join(names[:3])} {verbs[len(names) > 1]}" if names else ""
    differing = [
        f"{one.name} differs by {one.difference:+.2%}, which matters on a map"
        for one in others
        if one.agreement is Agreement.DIFFERS
    ]
    told += f"; {'; '.join(differing[:3])}" if differing else ""
    overruled = [one.name for one in others if one.overruled]
    told += f"; {', '.join(overruled)} not believed" if overruled else ""
    if nominal:
        told += "; a nominal K is of the model, so it is proposed for the model and not for the unit"
    if solved is not None and solved.verdict is Use.START:
        better = "take better frames" if chosen.kind is Kind.BOARD else "fly what its findings ask for"
        told += f"; a start only: {better} before approving it"
    return told


def _no_k(camera: PayloadCamera, board: ImageSolve | None) -> tuple[str, str]:
    if board is not None and board.reason is not None:
        return (
            f"its frames of a board give no K: {board.reason}",
            "take better frames: calibrary calibrate guide",
        )
    judged = camera.judged
    if judged is not None and judged.calibration is not None:
        return (
            "its sensor size is not stated, so K would rest on an assumed one",
            "bring frames of a board or a calibration file",
        )
    if judged is not None and judged.no_k is not None:
        return judged.no_k.message, "bring frames of a board or a calibration file for it"
    return "no file in the folder states its K", "bring frames of a board or a calibration file for it"


def _trusts(found: Sequence[Estimate]) -> str:
    kinds = dict.fromkeys(one.kind for one in found if one.rank is not None)
    return " or ".join(f"--trust {kind.value}" for kind in kinds)
