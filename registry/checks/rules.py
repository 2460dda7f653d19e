"""Checks of a single entry."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.checks.findings import finding_of
from calibrary.registry.entry import UNSTATED, Entry
from calibrary.registry.entry_form import PARAMETERS
from calibrary.registry.paths import in_use_path, scripts
from calibrary.validation import Finding, Severity, validate

__all__ = ["BOARD_BLOCK", "RULES"]

SENSOR_AGREEMENT: Final = 0.05
"""Principal distance and nominal focal length differ by a few percent; a wrong sensor size by more."""
PITCH_AGREEMENT: Final = 0.02
STD_AGREEMENT: Final = 1e-3
SMALLEST_EIGENVALUE: Final = -1e-9
"""Limit for a correlation matrix; rounding errors are far smaller."""
BOARD_BLOCK: Final = "x-board-calibration"
"""Block that a calibration from a board or a flight adds to its entry: its verdict, and how it was made."""


def _path(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    if entry.path != in_use_path(path):
        yield finding_of(path, "path", f"its key gives {entry.path}; move it there, or correct the key")


def _provenance(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    if entry.is_usable and entry.calibration.provenance == UNSTATED:
        yield finding_of(
            path, "provenance", f"{entry.status.value} without a provenance; state where K is from"
        )


def _plausible(path: str, entry: Entry, policy: Policy) -> Iterator[Finding]:
    """Apply the policy's rules, except the range for unknown cameras, since the camera of an entry is known."""
    known, made = entry.calibration, entry.calibration.provenance
    if made.kind == "image-metadata":
        known = replace(known, provenance=replace(made, kind="registry"))
    for finding in validate(known, policy).findings:
        if finding.severity is Severity.PASS:
            continue
        is_error = finding.severity is Severity.ERROR and entry.is_usable
        yield replace(finding, severity=Severity.ERROR if is_error else Severity.WARNING, place=path)


def _sensor(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    sensor, K, camera = entry.sensor, entry.calibration.intrinsics, entry.calibration.camera
    if sensor is None:
        return
    width, height = K.image_size
    pitch_mm = sensor.pitch_um / 1000 if sensor.pitch_um is not None else None
    sides = ((sensor.width_mm, width, "width"), (sensor.height_mm, height, "height"))
    for side_mm, side_px, name in sides:
        if side_mm is None or pitch_mm is None or abs(pitch_mm * side_px / side_mm - 1.0) <= PITCH_AGREEMENT:
            continue
        message = (
            f"{side_px} pixels of {sensor.pitch_um:g} µm are {pitch_mm * side_px:.3f} mm, the sensor's {name} is "
            f"{side_mm:g} mm; the pitch is the frame's, after binning"
        )
        yield finding_of(path, "sensor", message, Severity.WARNING)
    pixel_mm = sensor.width_mm / width if sensor.width_mm is not None else pitch_mm
    if pixel_mm is None or camera.focal_mm is None:
        return
    focal_mm = K.fx * pixel_mm
    if abs(focal_mm / camera.focal_mm - 1.0) > SENSOR_AGREEMENT:
        message = (
            f"fx = {K.fx:.1f} px on this sensor is {focal_mm:.2f} mm, {focal_mm / camera.focal_mm - 1.0:+.0%} from "
            f"the key's {camera.focal_mm:g} mm: a wrong sensor size, or a K of another lens"
        )
        yield finding_of(path, "sensor", message, Severity.WARNING)


def _uncertainty(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    quality, lens = entry.calibration.quality, entry.calibration.distortion
    if quality is None:
        return
    known = {*PARAMETERS, *(lens.names() if lens is not None else ())}
    covariance = quality.covariance
    named = [*quality.std, *(covariance.names if covariance is not None else ())]
    if unknown := sorted({name for name in named if name not in known}):
        message = f"an uncertainty of {', '.join(unknown)}, which are not parameters of this calibration"
        yield finding_of(path, "uncertainty", message)
    if covariance is None:
        return
    matrix = covariance.matrix
    spread = np.sqrt(np.diag(matrix))
    if (fault := _not_positive(matrix, spread)) is not None:
        yield finding_of(path, "uncertainty", fault)
    for name, std in zip(covariance.names, spread.tolist(), strict=True):
        stated = quality.std.get(name)
        if stated is not None and abs(stated - std) > STD_AGREEMENT * max(stated, std):
            message = f"std of {name} is {stated:g}, and the covariance gives {std:g}"
            yield finding_of(path, "uncertainty", message)


def _not_positive(matrix: FloatArray, spread: FloatArray) -> str | None:
    """Return why a matrix is not a covariance (a negative variance in some direction); None if it is one."""
    scale = np.where(spread > 0, spread, 1.0)
    smallest = float(np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0])
    if smallest >= SMALLEST_EIGENVALUE:
        return None
    return (
        f"the covariance is invalid: its correlations have the eigenvalue {smallest:.3g}, expected 0 or above"
    )


def _spelling(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    """Find mixed scripts: a Cyrillic letter in a Latin name looks the same but makes another name."""
    camera = entry.calibration.camera
    for name, text in (("make", camera.make), ("model", camera.model)):
        if text and not text.isascii() and len(found := scripts(text)) > 1:
            message = f"the {name} {text!r} mixes {' and '.join(sorted(found)).title()} letters"
            yield finding_of(path, "spelling", message, Severity.WARNING)


def _board(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    """Check the verdict stated by a calibration from a board."""
    block = entry.extensions.get(BOARD_BLOCK)
    verdict = block.get("verdict") if isinstance(block, dict) else None
    if verdict is None or verdict == "pass" or not entry.is_usable:
        return
    reasons = block.get("reasons") if isinstance(block, dict) else None
    why = f" ({', '.join(map(str, reasons))})" if isinstance(reasons, list) and reasons else ""
    yield finding_of(
        path,
        "board",
        f"its calibration ended {str(verdict).upper()}{why}, and only PASS may be used: photograph what the reasons "
        "ask for and calibrate again, or keep it a draft",
    )


RULES: Final[tuple[Callable[[str, Entry, Policy], Iterator[Finding]], ...]] = (
    _path,
    _provenance,
    _plausible,
    _sensor,
    _uncertainty,
    _spelling,
    _board,
)
