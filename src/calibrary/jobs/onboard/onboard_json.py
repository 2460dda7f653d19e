"""The JSON form of a payload taken on board (schemas/onboard-1.schema.json)."""

from __future__ import annotations

from collections.abc import Mapping

from calibrary.jobs.onboard.comparison import EstimateComparison, Relative
from calibrary.jobs.onboard.estimates import Estimate
from calibrary.jobs.onboard.proposal import sources_of
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
    skipped = (*payload.others, *done.cameras.skipped)
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
            "skipped": [{"file": one.name, "reason": one.reason} for one in skipped],
        },
        "cameras": [_camera(one, done) for one in done.outcomes],
        "branches": branches,
        "page": page,
    }


def _camera(one: CameraDecision, done: Onboarding) -> dict[str, Json]:
    entry = one.entry
    return {
        "camera": to_json(one.camera.key),
        "decision": one.decision.value,
        "reason": one.reason,
        "next": one.advice,
        "estimates": [_estimate(estimate, one.comparison) for estimate in one.estimates],
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
            for what, source in sources_of(one.camera, done.payload)
        ],
    }


def _estimate(estimate: Estimate, comparison: EstimateComparison | None) -> dict[str, Json]:
    others = comparison.others if comparison is not None else ()
    compared = next((one for one in others if one.estimate is estimate), None)
    return {
        "kind": estimate.kind.value,
        "name": estimate.name,
        "grade": estimate.grade.value if estimate.grade is not None else None,
        "intrinsics": to_json(estimate.intrinsics),
        "chosen": comparison is not None and estimate is comparison.chosen,
        "difference": compared.difference if compared is not None else None,
        "limit": estimate.limit,
        "agrees": compared.agrees if compared is not None else None,
        "overruled": comparison is not None and compared is not None and compared in comparison.overruled,
    }


def _board(board: BoardSolve) -> dict[str, Json]:
    result = board.result
    quality = result.calibration.quality if result is not None else None
    return {
        "frames": board.frames,
        "board": str(result.observations.board) if result is not None else None,
        "verdict": result.verdict.value if result is not None else None,
        "rms_px": quality.rms_px if quality is not None else None,
        "reason": board.reason,
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
        "reason": relative.reason,
    }
