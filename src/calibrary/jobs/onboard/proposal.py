"""The registry entry of a camera of a payload: with the hash of every source, for one unit or its model."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Final

from calibrary.arguments import Stated
from calibrary.calib.detection import Detections
from calibrary.calib.result import CalibrationResult
from calibrary.calibration import Calibration, CameraKey, Grade, SourceFile
from calibrary.jobs.calibrate.report import Asked, report_of
from calibrary.jobs.onboard.payload import FRAME, PayloadCamera, sha256_of
from calibrary.jobs.onboard.report import Agreement, Estimate, Kind, UsedFile
from calibrary.jobs.weigh import EXIF
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.strictyaml import YamlValue

__all__ = ["Serves", "entry_for", "is_same"]

BLOCK: Final = "x-onboarding"
"""Name of an additional block in the entry's file."""
METRIC: Final = frozenset(grade for grade in Grade if grade.is_metric)
SAME_NUMBER: Final = 1e-6
"""Relative tolerance: equal frames give equal numbers except for the order of summation on several cores."""


class Serves(StrEnum):
    """Cameras that the entry applies to."""

    UNIT = "unit"
    MODEL = "model"


def entry_for(
    camera: PayloadCamera,
    found: Sequence[Estimate],
    K: Calibration,
    serves: Serves,
    used: Sequence[UsedFile],
    folder: Path,
    *,
    solved: CalibrationResult | None,
    stated: Stated,
) -> Entry:
    """Make the draft entry.

    Args:
        camera: the camera.
        found: its estimates, the one that gives ``K`` first.
        K: the proposed K.
        serves: this unit only, or all units of its model.
        used: all files that were used.
        folder: of the payload.
        solved: the solve from a board or a flight, if it gives the K.
        stated: provenance that the source does not state.

    Raises:
        InputError: make or model is missing, or K was not measured.
    """
    key = _key(camera, found, serves)
    if solved is not None:
        named = replace(solved.calibration, camera=replace(key, firmware=camera.firmware))
        seen = Detections(observations=solved.observations)
        entry = report_of(replace(solved, calibration=named), seen, Asked()).entry
        calibration = entry.calibration
    else:
        calibration = replace(K, camera=key, extras=())
        entry = Entry.of(calibration)
    made = calibration.provenance
    own = _own_source(camera, found[0], folder)
    made = replace(
        made,
        source=made.source or (own.name if own is not None else None),
        sha256=made.sha256 or (own.sha256 if own is not None else None),
        firmware=made.firmware or camera.firmware,
    )
    notes = (*calibration.notes, *_notes(found))
    return replace(
        entry,
        calibration=replace(
            calibration, provenance=stated.completing(made), notes=tuple(dict.fromkeys(notes))
        ),
        extensions={**entry.extensions, BLOCK: _block(found, serves, used)},
    )


def is_same(one: Entry, other: Entry) -> bool:
    """Whether two entries have the same sources and numbers; operator and date are ignored."""
    return (
        one.path == other.path
        and _made_of(one) == _made_of(other)
        and type(one.calibration.distortion) is type(other.calibration.distortion)
        and all(
            math.isclose(a, b, rel_tol=SAME_NUMBER, abs_tol=SAME_NUMBER)
            for a, b in zip(_numbers(one), _numbers(other), strict=True)
        )
    )


def _made_of(entry: Entry) -> tuple[object, ...]:
    block = entry.extensions.get(BLOCK)
    made_from = (block.get("serves"), block.get("sources")) if isinstance(block, dict) else ()
    made = entry.calibration.provenance
    return (*made_from, entry.calibration.grade, made.kind, made.sources)


def _numbers(entry: Entry) -> list[float]:
    K, lens = entry.calibration.intrinsics, entry.calibration.distortion
    return [K.fx, K.fy, K.cx, K.cy, K.skew, *(lens.coefficients.values() if lens is not None else ())]


def _key(camera: PayloadCamera, found: Sequence[Estimate], serves: Serves) -> CameraKey:
    key = replace(camera.key, firmware=None)
    of_exif = [one for one in found[1:] if one.source is not None and one.source.voice == EXIF]
    confirmed = any(one.agreement is not Agreement.DISAGREES and one.grade in METRIC for one in of_exif)
    if not confirmed and any(one.overruled for one in of_exif):
        # A focal length that was overruled must not be part of the camera key.
        key = replace(key, focal_mm=None)
    return key if serves is Serves.UNIT else replace(key, serial=None)


def _own_source(camera: PayloadCamera, chosen: Estimate, folder: Path) -> SourceFile | None:
    if chosen.kind is Kind.FILE:
        file = next(one for one in camera.files if one.name == chosen.name)
        return SourceFile(name=file.name.rpartition("/")[2], sha256=file.sha256)
    if chosen.kind is Kind.TAGS and camera.judged is not None:
        # The state that gives the K states its first image as the source.
        made = camera.judged.calibration
        source = made.provenance.source if made is not None else None
        name = next((one for one in camera.judged.names if one.rpartition("/")[2] == source), None)
        name = name or camera.judged.names[0]
        return SourceFile(name=name.rpartition("/")[2], sha256=sha256_of(folder / name))
    return None


def _notes(found: Sequence[Estimate]) -> Iterator[str]:
    for one in found:
        if one.overruled:
            yield (
                f"{one.name} states fx {one.difference or 0.0:+.1%} and is not used: "
                "the other sources disagree with it"
            )


def _block(found: Sequence[Estimate], serves: Serves, used: Sequence[UsedFile]) -> YamlValue:
    """Block with the sources and their estimates; the same payload gives the same block."""
    return {
        "serves": serves.value,
        "sources": [
            {"what": one.what, "name": one.name, "sha256": one.sha256}
            for one in used
            # The provenance of a solve already lists its frames.
            if not (one.what == FRAME and found[0].kind is Kind.BOARD)
        ],
        "heard": [
            {"kind": one.kind.value, "name": one.name, "fx": round(one.intrinsics.fx, 3)}
            for one in found
            if one is found[0] or one.kind is not Kind.REGISTRY
        ],
    }
