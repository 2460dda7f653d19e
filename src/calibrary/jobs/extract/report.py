"""The run's report as one JSON document (schemas/report-1.schema.json)."""

from __future__ import annotations

import json
from collections.abc import Mapping

from calibrary.calibration import Calibration
from calibrary.evidence.collect import Evidence
from calibrary.evidence.witness import Witness
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.extraction import CameraReport, Extraction
from calibrary.jobs.extract.hand_off import seed_command
from calibrary.records import Json, to_json
from calibrary.validation import Report, finding_json

__all__ = ["encode", "report_json"]

SCHEMA = "calibrary/report-1"


def report_json(outcome: Extraction, outputs: Mapping[str, str]) -> dict[str, Json]:
    """The whole run.

    Args:
        outcome: what was found.
        outputs: the K file of each camera that has one, by slug.
    """
    return {
        "schema": SCHEMA,
        "policy": outcome.policy.name,
        "uncalibrated": outcome.uncalibrated,
        "images": sum(len(c.camera.names) for c in outcome.cameras) + len(outcome.rejected),
        "cameras": [_camera(c, outputs.get(c.slug)) for c in outcome.cameras],
        "rejected": [{"file": r.name, "reason": r.reason} for r in outcome.rejected],
        "warnings": list(outcome.warnings),
        "exit_code": outcome.exit_code,
    }


def encode(document: Mapping[str, Json]) -> bytes:
    """UTF-8 JSON; NaN and infinity are not JSON and never come this far.

    What Python makes of a file name that is no UTF-8 is written as the JSON escape of the same character, so the
    document is valid and ``os.fsencode`` of the name it gives back is the file's.
    """
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    return text.encode(errors="backslashreplace")


def _camera(c: CameraReport, output: str | None) -> dict[str, Json]:
    failed = c.camera.calibration if c.calibration is None else None
    return {
        "id": c.slug,
        # A camera without a valid K has no "K" to be picked up by mistake.
        "calibration": to_json(c.calibration) if c.calibration else {"camera": to_json(c.camera.key)},
        "verdict": c.verdict.value,
        "why": c.reason,
        "what_to_do": c.advice,
        "uncalibrated": c.uncalibrated,
        "output": output,
        "rejected_candidate": _candidate(c.camera, failed) if failed is not None else None,
        "known_as": c.camera.states[0].known.title,
        "witnesses": [_witness(w, c.camera.evidence) for w in c.camera.evidence.witnesses],
        "dropped": [
            {"source": d.source.value, "tag": d.tag, "reason": d.reason} for d in c.camera.evidence.dropped
        ],
        "conflicts": [
            {
                "chosen": conflict.chosen.tag,
                "other": conflict.other.tag,
                "difference": conflict.difference,
                "cause": conflict.cause.value,
            }
            for conflict in c.camera.evidence.conflicts
        ],
        "findings": _findings(c.report),
        "spread": c.camera.spread,
        "fallback": [
            {"step": s.step.value, "outcome": s.outcome.value, "source": s.source, "why": s.why}
            for s in (c.fallback.steps if c.fallback is not None else ())
        ],
        "seed": _seed(c),
        "images": list(c.camera.names),
    }


def _candidate(camera: Camera, failed: Calibration) -> dict[str, Json]:
    """The numbers that failed, for whoever looks into it."""
    return {
        "grade": failed.grade.value,
        "tag": failed.provenance.tag,
        "intrinsics": to_json(failed.intrinsics),
        "findings": _findings(camera.report),
    }


def _witness(witness: Witness, evidence: Evidence) -> dict[str, Json]:
    return {
        "source": witness.source.value,
        "tag": witness.tag,
        "grade": witness.grade.value,
        "chosen": witness is evidence.chosen,
        "intrinsics": to_json(witness.intrinsics),
        "distortion": to_json(witness.distortion) if witness.distortion is not None else None,
        "principal_point_measured": witness.measured_centre,
        "reference_size": list(witness.reference_size),
        "steps": list(witness.steps),
        "assumptions": list(witness.assumptions),
        "pinhole": witness.pinhole,
    }


def _findings(report: Report | None) -> Json:
    return [finding_json(finding) for finding in (report.findings if report is not None else ())]


def _seed(c: CameraReport) -> Json:
    seed = c.fallback.seed if c.fallback is not None else None
    if seed is None:
        return None
    return {
        "grade": seed.grade.value,
        "intrinsics": to_json(seed.intrinsics),
        "note": "no K: a start for self-calibration",
        "colmap": seed_command(seed),
    }
