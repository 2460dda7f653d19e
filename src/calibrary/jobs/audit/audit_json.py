"""The JSON form of an audit (schemas/registry-audit-1.schema.json)."""

from __future__ import annotations

from calibrary.jobs.audit.agreement import gaps
from calibrary.jobs.audit.answers import Answer
from calibrary.jobs.audit.run import LEVELS, Audit
from calibrary.policy import Policy
from calibrary.records import Json, to_json

__all__ = ["audit_json"]


def audit_json(done: Audit) -> dict[str, Json]:
    """The whole audit; no position, no serial number, but hashes of them."""
    request, seen = done.request, done.flights
    counts: dict[str, Json] = {level.value: done.of(level) for level in LEVELS}
    return {
        "schema": "calibrary/registry-audit-1",
        "verdict": "clean" if done.is_clean else "findings",
        "registry": str(request.snapshot.place),
        "commit": request.snapshot.commit,
        "policy": done.policy.name,
        "on": request.today.isoformat(),
        "since": request.since.isoformat() if request.since is not None else None,
        "stale_after_months": request.stale_months,
        "folders": [str(folder) for folder in request.folders],
        "images": seen.images,
        "images_before": seen.before,
        "images_undated": seen.undated,
        "entries": done.entries,
        "counts": counts,
        "cameras": [_camera(answer, done.policy) for answer in done.answers],
        "findings": [to_json(finding) for finding in done.findings],
        "unreadable": [{"file": one.name, "reason": one.reason} for one in seen.unreadable],
    }


def _camera(answer: Answer, policy: Policy) -> dict[str, Json]:
    flown, resolution = answer.flown, answer.resolution
    return {
        "camera": to_json(flown.key),
        "images": flown.images,
        "first": flown.first.isoformat() if flown.first is not None else None,
        "last": flown.last.isoformat() if flown.last is not None else None,
        "use": answer.use.value,
        "entry": answer.entry_id,
        "why": resolution.why if resolution is not None else None,
        "fx": resolution.calibration.intrinsics.fx if resolution is not None else None,
        "sources": [
            {
                "tag": gap.estimate.tag,
                "grade": gap.estimate.grade.value,
                "fx": gap.estimate.intrinsics.fx,
                "difference": gap.share,
                "of": gap.of,
                "limit": gap.limit,
                "chosen": gap.estimate is flown.camera.evidence.chosen,
            }
            for gap in gaps(answer, policy)
        ],
    }
