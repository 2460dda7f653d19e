"""The JSON form of a comparison (schemas/diff-1.schema.json)."""

from __future__ import annotations

import math

from calibrary.jobs.diff.comparison import Comparison, Numbers
from calibrary.records import Json, to_json

__all__ = ["comparison_json"]


def comparison_json(comparison: Comparison, labels: tuple[str, str], altitude_m: float) -> dict[str, Json]:
    """One comparison, with the two calibrations as they were given."""
    numbers = comparison.numbers
    return {
        "schema": "calibrary/diff-1",
        "verdict": comparison.verdict.value,
        "alarm": comparison.alarm,
        "reasons": list(comparison.reasons),
        "structural": [{"kind": one.kind.value, "reason": one.reason} for one in comparison.structural],
        "steps": list(comparison.steps),
        "a": {"label": labels[0], "calibration": to_json(comparison.a)},
        "b": {"label": labels[1], "calibration": to_json(comparison.b)},
        "numbers": _numbers(numbers, altitude_m) if numbers is not None else None,
    }


def _numbers(numbers: Numbers, altitude_m: float) -> dict[str, Json]:
    seen, ground = numbers.difference, numbers.ground(altitude_m)
    return {
        "image_size": list(numbers.a.intrinsics.image_size),
        "parameters": [
            {
                "name": row.name,
                "a": row.a,
                "b": row.b,
                "std_a": row.std_a,
                "std_b": row.std_b,
                "delta": row.delta,
                "z": row.z,
            }
            for row in numbers.parameters
        ],
        "focal_change": numbers.focal_change,
        "projection": {
            "rms_px": seen.rms_px,
            "max_px": seen.max_px,
            "centre_rms_px": seen.centre_rms_px,
            "rotation_deg": seen.rotation_deg,
            "valid_share": float(seen.region.mean()),
        },
        "ground": {
            "altitude_m": ground.altitude_m,
            "gsd_cm": ground.gsd_cm,
            "rms_cm": ground.rms_cm,
            "max_cm": ground.max_cm,
            "height_cm": ground.height_cm,
        },
        "significance": {
            "p": numbers.p,
            "tests": [
                {"of": test.of, "chi2": test.value if math.isfinite(test.value) else None, "dof": test.dof}
                for test in numbers.chi2
            ],
            "spread_a": numbers.spread_a.source,
            "spread_b": numbers.spread_b.source,
        },
        "distortion_compared": numbers.lens_compared,
    }
