"""The JSON form of a payload taken on board (schemas/onboard-1.schema.json)."""

from __future__ import annotations

from collections.abc import Mapping

from calibrary.jobs.onboard.claims import Claim
from calibrary.jobs.onboard.judging import Hearing, Relative
from calibrary.jobs.onboard.proposing import sources_of
from calibrary.jobs.onboard.records import BoardSolve, CameraDecision, Onboarding
from calibrary.records import Json, to_json
from calibrary.registry.git.writing import Written
from calibrary.validation import Report

__all__ = ["onboard_json"]


def onboard_json(done: Onboarding, written: Mapping[str, Written], page: str | None) -> dict[str, Json]:
    """The whole of it.

    Args:
        done: what was found.
        written: the commit on each branch; empty where nothing was written.
        page: the name of the page beside it.
    """
    payload, frames = done.payload, len(done.payload.frames)
    aside = (*payload.others, *done.subjects.aside)
    branches: dict[str, Json] = {branch: one.commit for branch, one in written.items()}
    return {
        "schema": "calibrary/onboard-1",
        "verdict": "good" if done.is_good else "refused",
        "folder": str(payload.folder),
        "registry": str(done.request.registry.repo.path),
        "policy": done.request.policy.name,
        "sorted": {
            "images": payload.images - frames,
            "board_frames": frames,
            "calibration_files": len(payload.files),
            "aside": [{"file": one.name, "reason": one.reason} for one in aside],
        },
        "cameras": [_camera(one, done) for one in done.outcomes],
        "branches": branches,
        "page": page,
    }


def _camera(one: CameraDecision, done: Onboarding) -> dict[str, Json]:
    entry = one.entry
    return {
        "camera": to_json(one.subject.key),
        "decision": one.decision.value,
        "reason": one.reason,
        "next": one.advice,
        "witnesses": [_claim(claim, one.hearing) for claim in one.claims],
        "board": _board(one.board) if one.board is not None else None,
        "findings": _report(one.report),
        "entry": {
            "id": entry.id,
            "path": entry.path,
            "status": entry.status.value,
            "status_before": one.current.status.value if one.current is not None else None,
            "calibration": to_json(entry.calibration),
        }
        if entry is not None
        else None,
        "check": [to_json(finding) for finding in one.findings],
        "relatives": [_relative(relative) for relative in one.relatives],
        "sources": [
            {"what": what, "name": source.name, "sha256": source.sha256}
            for what, source in sources_of(one.subject, done.payload)
        ],
    }


def _claim(claim: Claim, hearing: Hearing | None) -> dict[str, Json]:
    voices = hearing.voices if hearing is not None else ()
    voice = next((voice for voice in voices if voice.claim is claim), None)
    return {
        "who": claim.kind.value,
        "name": claim.name,
        "grade": claim.grade.value if claim.grade is not None else None,
        "intrinsics": to_json(claim.intrinsics),
        "chosen": hearing is not None and claim is hearing.chosen,
        "difference": voice.share if voice is not None else None,
        "limit": claim.limit,
        "agrees": voice.agrees if voice is not None else None,
        "overruled": hearing is not None and voice is not None and voice in hearing.overruled,
    }


def _board(board: BoardSolve) -> dict[str, Json]:
    result = board.result
    quality = result.calibration.quality if result is not None else None
    return {
        "frames": board.frames,
        "board": str(result.observations.board) if result is not None else None,
        "verdict": result.verdict.value if result is not None else None,
        "rms_px": quality.rms_px if quality is not None else None,
        "why_not": board.why_not,
    }


def _report(report: Report | None) -> Json:
    return [to_json(finding) for finding in (report.findings if report is not None else ())]


def _relative(relative: Relative) -> dict[str, Json]:
    found = relative.comparison
    numbers = found.numbers if found is not None else None
    return {
        "id": relative.id,
        "own": relative.own,
        "verdict": found.verdict.value if found is not None else None,
        "alarm": found.alarm if found is not None else None,
        "focal_change": numbers.focal_change if numbers is not None else None,
        "max_px": numbers.difference.max_px if numbers is not None else None,
        "why_not": relative.why_not,
    }
