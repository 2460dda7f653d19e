"""The JSON form of a Calibration, the same wherever one is printed (schemas/calibration-1.schema.json)."""

from __future__ import annotations

from calibrary.calibration import Calibration, CameraKey, Covariance, Intrinsics, Provenance, Quality
from calibrary.distortion import Distortion
from calibrary.records import Json

__all__ = ["calibration_json", "camera_json", "distortion_json", "intrinsics_json"]


def calibration_json(calibration: Calibration) -> dict[str, Json]:
    """One calibration as a JSON object, K and distortion apart."""
    return {
        "camera": camera_json(calibration.camera),
        "intrinsics": intrinsics_json(calibration.intrinsics),
        "K": [[float(value) for value in row] for row in calibration.intrinsics.matrix],
        "distortion": distortion_json(calibration.distortion),
        "grade": calibration.grade.value,
        "quality": _quality(calibration.quality),
        "provenance": _provenance(calibration.provenance),
        "notes": list(calibration.notes),
    }


def camera_json(key: CameraKey) -> dict[str, Json]:
    """Which camera; every field is there, null where it does not matter."""
    return {
        "make": key.make,
        "model": key.model,
        "sub_camera": key.sub_camera,
        "lens": key.lens,
        "focal_mm": key.focal_mm,
        "capture_mode": key.capture_mode,
        "image_size": list(key.image_size) if key.image_size is not None else None,
        "serial": key.serial,
        "firmware": key.firmware,
    }


def intrinsics_json(K: Intrinsics) -> dict[str, Json]:
    """K's numbers with the pixel origin they count from."""
    return {
        "pixel_origin": "corner",
        "fx": K.fx,
        "fy": K.fy,
        "cx": K.cx,
        "cy": K.cy,
        "skew": K.skew,
        "image_size": list(K.image_size),
    }


def distortion_json(distortion: Distortion | None) -> Json:
    """The model and its coefficients by name; null is unknown, which is not "none"."""
    if distortion is None:
        return None
    return {"model": distortion.model, **distortion.coefficients}


def _quality(quality: Quality | None) -> Json:
    if quality is None:
        return None
    std: dict[str, Json] = dict(quality.std)
    covariance = quality.covariance
    return {
        "rms_px": quality.rms_px,
        "points": quality.points,
        "views": quality.views,
        "std": std,
        "covariance": _covariance(covariance) if covariance is not None else None,
        "kappa2": quality.kappa2,
        "coverage": quality.coverage,
    }


def _covariance(covariance: Covariance) -> dict[str, Json]:
    return {"names": list(covariance.names), "upper": list(covariance.upper)}


def _provenance(provenance: Provenance) -> dict[str, Json]:
    reference = provenance.reference_size
    return {
        "kind": provenance.kind,
        "source": provenance.source,
        "tag": provenance.tag,
        "reference_size": list(reference) if reference is not None else None,
        "adaptation": provenance.adaptation,
        "assumptions": list(provenance.assumptions),
        "sha256": provenance.sha256,
        "sources": [{"name": file.name, "sha256": file.sha256} for file in provenance.sources],
        "tool": provenance.tool,
        "date": provenance.date,
        "operator": provenance.operator,
        "firmware": provenance.firmware,
        "focus": provenance.focus,
    }
