"""The onboard job: from a folder to a decision on every camera, with reasons and possibly a draft entry.

Only :func:`write_drafts` writes, and only to a separate branch: the calibrations in use change only by
approval.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from calibrary.calib.result import CalibrationResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import CameraKey
from calibrary.errors import CalibraryError, CalibrationError, InputError, RegistryError
from calibrary.jobs.calibrate.frames import describe_frames
from calibrary.jobs.calibrate.run import SolveRequest, calibrate_from, observe
from calibrary.jobs.exchange.material import with_material_changes
from calibrary.jobs.onboard.cameras import PayloadCamera, find_cameras
from calibrary.jobs.onboard.classify import Payload, classify_payload
from calibrary.jobs.onboard.comparison import (
    Agreement,
    EstimateComparison,
    compare_estimates,
    held_against,
    refused_by,
    relatives,
)
from calibrary.jobs.onboard.estimates import MEASURED, Estimate, Kind, estimates
from calibrary.jobs.onboard.flight import flight_of, solved_flight
from calibrary.jobs.onboard.proposal import FRAME, Serves, entry_for, is_same, sources_of
from calibrary.jobs.onboard.records import (
    CameraDecision,
    Decision,
    ImageSolve,
    Onboarding,
    Questions,
    Request,
)
from calibrary.progress import counted, labelled
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.writing import Written
from calibrary.registry.paths import proposal_path, slug
from calibrary.registry.proposals import propose, save
from calibrary.registry.registry import Registry
from calibrary.registry.resolution import Resolution
from calibrary.registry.writing import note_of

__all__ = ["BRANCHES", "branch_name", "branch_of", "onboard", "write_drafts"]

BRANCHES: Final = "onboard/"


def onboard(request: Request) -> Onboarding:
    """Classify the files, identify the cameras, compare the estimates and propose entries; writes nothing.

    Raises:
        InputError: the folder cannot be read, or contains nothing about a camera.
        RegistryError: the registry cannot be read.
    """
    payload = classify_payload(
        request.folder,
        board=request.board,
        workers=request.workers,
        progress=labelled(request.progress, "files"),
    )
    if not payload.states and not payload.files:
        raise InputError(
            "contains neither an image nor a calibration file; give the folder of what came with the payload",
            source=str(request.folder),
        )
    cameras = find_cameras(payload, request.policy, request.said, image_size=request.image_size)
    chosen = [one for one in cameras.found if _is_meant(one, request.only)]
    if cameras.found and not chosen:
        names = "; ".join(str(one.key) for one in cameras.found)
        raise InputError(
            f"no camera in it is called {request.only!r:.60}: {names}", source=str(request.folder)
        )
    # A payload is one unit, so a stated serial number applies to all its cameras.
    chosen = [replace(one, key=replace(one.key, serial=request.said(one.key).serial)) for one in chosen]
    square_mm = _square_mm(chosen, request)
    outcomes = tuple(_outcome(one, payload, square_mm, request) for one in chosen)
    if any(one.decision is Decision.REFUSED for one in outcomes):
        outcomes = tuple(_waiting(one, request) for one in outcomes)
    return Onboarding(request=request, payload=payload, cameras=cameras, outcomes=outcomes)


def branch_of(entry: Entry) -> str:
    """Name of the branch on which drafts of a model wait for approval."""
    return branch_name(entry.calibration.camera)


def branch_name(camera: CameraKey) -> str:
    """Name of that branch for a camera without an entry."""
    return f"{BRANCHES}{slug(camera.make or '')}-{slug(camera.model or '')}"


def write_drafts(done: Onboarding, reason: str | None = None) -> dict[str, Written]:
    """Write the proposed entries, with a branch for each model and a commit for each branch.

    Raises:
        FileConflictError: the same entry was written on the branch in the meantime.
        RegistryError: the registry cannot be written.
    """
    registry, branches = done.request.registry, {}
    for branch in sorted({branch_of(entry) for entry in done.drafts}):
        entries = [entry for entry in done.drafts if branch_of(entry) == branch]
        named = entries[0].id if len(entries) == 1 else f"{len(entries)} cameras"
        note = note_of(f"Propose {named}, taken on board", entries, reason)
        note = replace(note, sources=_with_sources(note.sources, done, entries))
        proposals = propose(registry.branch(branch), entries)
        branches[branch] = save(registry, proposals, note=note, branch=branch)
    return branches


def _with_sources(
    known: Sequence[tuple[str | None, str]], done: Onboarding, entries: Sequence[Entry]
) -> tuple[tuple[str | None, str], ...]:
    """Append name and SHA-256 of every file that was used for the entries to the known ones."""
    # Frames of a board are numerous, and the entry itself lists them.
    read = {
        source.sha256: (source.name, source.sha256)
        for one in done.outcomes
        if one.entry in entries
        for what, source in sources_of(one.camera, done.payload)
        if what != FRAME
    }
    there = {sha256 for _, sha256 in known}
    return (*known, *(pair for sha256, pair in read.items() if sha256 not in there))


def _waiting(one: CameraDecision, request: Request) -> CameraDecision:
    """Decision on an acceptable camera that is not written because another camera was refused."""
    if one.decision is not Decision.PROPOSED:
        return one
    return replace(
        one, advice=f"to take it alone: calibrary onboard {request.folder} --only '{one.camera.key}'"
    )


def _is_meant(camera: PayloadCamera, only: str | None) -> bool:
    return only is None or only.casefold() in str(camera.key).casefold()


def _square_mm(cameras: Sequence[PayloadCamera], request: Request) -> float:
    """Side of the board's square in mm, asked once for all cameras; 0 if no camera has frames of a board."""
    frames = sum(len(camera.frames) for camera in cameras)
    if request.board is not None:
        return request.board.pitch
    return request.questions.square_mm(frames) if frames else 0.0


def _outcome(camera: PayloadCamera, payload: Payload, square_mm: float, request: Request) -> CameraDecision:
    board = _board(camera, square_mm, request) if camera.frames else None
    images = flight_of(camera, payload)
    flight = solved_flight(camera, images, request) if images and request.flight else None
    heard = estimates(
        camera,
        board.result if board is not None else None,
        flight.result if flight is not None else None,
        _current(camera, request.registry),
        request.policy,
    )
    comparison = compare_estimates(heard, request.policy, request.trusted)
    so_far = CameraDecision(
        camera=camera,
        decision=Decision.REFUSED,
        reason="",
        board=board,
        flight=flight,
        flight_images=len(images) if flight is None else 0,
        estimates=heard,
        comparison=comparison,
    )
    if comparison is None:
        why, advice = _no_k(camera, board)
        return replace(so_far, reason=why, advice=advice)
    if comparison.dispute is not None:
        advice = (
            "bring another estimate (frames of a board, a calibration file), take the wrong one out, or say whom to "
            f"believe: {_trusts(heard)}"
        )
        return replace(so_far, reason=comparison.dispute, advice=advice)
    report = held_against(comparison.calibration, camera, comparison, request.policy)
    so_far = replace(so_far, report=report)
    refused = refused_by(report)
    if refused is not None:
        return replace(
            so_far, reason=refused, advice="correct that, or calibrate the camera: calibrary calibrate"
        )
    return _proposed(so_far, comparison, payload, request)


def _proposed(
    so_far: CameraDecision, comparison: EstimateComparison, payload: Payload, request: Request
) -> CameraDecision:
    """Propose the entry of a camera without objections so far, and check it against the registry."""
    camera, registry, solved = so_far.camera, request.registry, _solved(so_far, comparison)
    is_unit = request.questions.stated is Serves.UNIT and comparison.chosen.grade in MEASURED
    if is_unit and camera.key.serial is None:
        reason = (
            "it is measured on one unit, and nothing in it states the serial number by which a unit is found"
        )
        return replace(so_far, reason=reason, advice="state it: --serial NUMBER, or --for model")
    serves = _serves(camera, comparison, request.questions)
    try:
        entry = entry_for(camera, comparison, serves, payload, solved=solved, stated=request.stated)
        if entry.unit is not None:
            entry = replace(entry, label=request.label)
        proposals = with_material_changes(propose(registry.snapshot(), [entry]), request.policy)
    except (InputError, RegistryError) as error:
        return replace(so_far, reason=str(error), advice="see the current entry: calibrary registry list")
    [proposal] = proposals.items
    entry, current = proposal.entry, proposal.current
    done = replace(
        so_far,
        entry=entry,
        current=current,
        findings=proposals.findings,
        relatives=relatives(registry, entry, request.policy),
    )
    if proposals.errors:
        return replace(
            done, reason=str(proposals.errors[0]), advice="correct that in the files of the payload"
        )
    branch = branch_of(entry)
    waiting = _waiting_at(registry, branch, entry.path)
    if current is not None and is_same(current, entry):
        reason = f"the registry already contains it, from the same sources, {current.status.value}"
        advice = f"calibrary registry approve {entry.id}" if current.status is Status.DRAFT else None
        return replace(done, entry=current, decision=Decision.KNOWN, reason=reason, advice=advice)
    nominal = request.questions.stated is Serves.UNIT and serves is Serves.MODEL
    approving = f"calibrary registry approve {entry.id} --from {branch}"
    if waiting is not None and is_same(waiting, entry):
        reason = f"its draft is on the branch {branch}, from the same sources"
        return replace(done, entry=waiting, decision=Decision.KNOWN, reason=reason, advice=approving)
    return replace(
        done, decision=Decision.PROPOSED, reason=_why(comparison, solved, nominal=nominal), advice=approving
    )


def _solved(so_far: CameraDecision, comparison: EstimateComparison) -> CalibrationResult | None:
    """The solve that gives the proposed K; None if another source gives it."""
    solves = {Kind.BOARD: so_far.board, Kind.FLIGHT: so_far.flight}
    solve = solves.get(comparison.chosen.kind)
    return solve.result if solve is not None else None


def _why(comparison: EstimateComparison, solved: CalibrationResult | None, *, nominal: bool) -> str:
    chosen = comparison.chosen
    grade = chosen.grade.value if chosen.grade is not None else "unknown"
    agreeing = [compared.estimate.name for compared in comparison.others if compared.agrees]
    told = f"its K is that of {chosen.name}, grade {grade}"
    told += f"; {', '.join(agreeing[:3])} {'agrees' if len(agreeing) == 1 else 'agree'}" if agreeing else ""
    differing = [
        f"{compared.estimate.name} differs by {compared.difference:+.2%}, which matters on a map"
        for compared in comparison.others
        if compared.agreement is Agreement.DIFFERS
    ]
    told += f"; {'; '.join(differing[:3])}" if differing else ""
    if comparison.overruled:
        told += f"; {', '.join(compared.estimate.name for compared in comparison.overruled)} not believed"
    if nominal:
        told += "; a nominal K is of the model, so it is proposed for the model and not for the unit"
    if solved is not None and solved.verdict is BoardVerdict.PROVISIONAL:
        better = "take better frames" if chosen.kind is Kind.BOARD else "fly what its findings ask for"
        told += f"; provisional: {better} before approving it"
    return told


def _serves(camera: PayloadCamera, comparison: EstimateComparison, questions: Questions) -> Serves:
    """Cameras that the entry applies to: nominal numbers to all units; for a measured K the user decides."""
    if comparison.chosen.grade not in MEASURED or camera.key.serial is None:
        return Serves.MODEL
    return questions.serves(str(camera.key))


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
    if judged is not None and judged.no_k_reason is not None:
        return judged.no_k_reason, "bring frames of a board or a calibration file for it"
    return "no file in the folder states its K", "bring frames of a board or a calibration file for it"


def _trusts(heard: Sequence[Estimate]) -> str:
    kinds = dict.fromkeys(estimate.kind for estimate in heard if estimate.rank is not None)
    return " or ".join(f"--trust {kind.value}" for kind in kinds)


def _board(camera: PayloadCamera, square_mm: float, request: Request) -> ImageSolve:
    frames = camera.frames
    advance = counted(request.progress, len(frames), "frames")

    def said(known: CameraKey) -> CameraKey:
        return replace(camera.key, firmware=known.firmware or camera.firmware)

    try:
        metadata = describe_frames(frames, said)
        collected = observe(
            frames, metadata, request.board or square_mm, workers=request.workers, progress=advance
        )
        result = calibrate_from(collected, SolveRequest(operator=request.stated.operator))
    except (CalibrationError, InputError) as error:
        return ImageSolve(images=len(frames), reason=str(error))
    if result.verdict is BoardVerdict.REFUSE:
        why = "; ".join(finding.message for finding in result.findings[:2])
        return ImageSolve(images=len(frames), collected=collected, result=result, reason=why)
    return ImageSolve(images=len(frames), collected=collected, result=result)


def _current(camera: PayloadCamera, registry: Registry) -> Resolution | None:
    """The entry that applies to the camera at present."""
    try:
        return registry.snapshot().index().resolve(replace(camera.key, firmware=camera.firmware))
    except CalibraryError:
        # Two entries fit equally well, or one cannot be read: the registry check reports it; there is no estimate.
        return None


def _waiting_at(registry: Registry, branch: str, path: str) -> Entry | None:
    """The proposed or current entry on a branch, or on the main branch if that branch does not exist."""
    snapshot = registry.branch(branch)
    oid = snapshot.proposed.get(proposal_path(path)) or snapshot.paths.get(path)
    if oid is None:
        return None
    try:
        return parse_entry(registry.repo.blob(oid), path)
    except InputError:
        return None
