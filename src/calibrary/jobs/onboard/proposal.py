"""The registry entry of a camera of a payload: with the hash of every source, for one unit or its model."""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import StrEnum
from typing import Final

from calibrary.arguments import Stated
from calibrary.calib.result import CalibrationResult
from calibrary.calibration import CameraKey, Grade, SourceFile
from calibrary.jobs.calibrate.entry import entry_of
from calibrary.jobs.calibrate.run import SolveRequest
from calibrary.jobs.onboard.cameras import PayloadCamera, sha256_of
from calibrary.jobs.onboard.classify import Payload
from calibrary.jobs.onboard.comparison import EstimateComparison
from calibrary.jobs.onboard.estimates import EXIF, Kind
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.strictyaml import YamlValue

__all__ = ["BLOCK", "FRAME", "Serves", "entry_for", "is_same", "sources_of"]

BLOCK: Final = "x-onboarding"
"""Name of an additional block in the entry's file."""
METRIC: Final = frozenset(grade for grade in Grade if grade.is_metric)
FRAME: Final = "frame of a board"
SAME_NUMBER: Final = 1e-6
"""Relative tolerance: equal frames give equal numbers except for the order of summation on several cores."""


class Serves(StrEnum):
    """Cameras that the entry applies to."""

    UNIT = "unit"
    MODEL = "model"


def entry_for(
    camera: PayloadCamera,
    comparison: EstimateComparison,
    serves: Serves,
    payload: Payload,
    *,
    solved: CalibrationResult | None,
    stated: Stated,
) -> Entry:
    """Make the draft entry.

    Args:
        camera: the camera.
        comparison: the chosen estimate, and the agreement of the others.
        serves: this unit only, or all units of its model.
        payload: the classified files.
        solved: the solve from a board or a flight, if it gives the K.
        stated: provenance that the source does not state.

    Raises:
        InputError: make or model is missing, or K was not measured.
    """
    key = _key(camera, comparison, serves)
    if solved is not None:
        named = replace(solved.calibration, camera=replace(key, firmware=camera.firmware))
        entry = entry_of(replace(solved, calibration=named), SolveRequest(operator=stated.operator))
        calibration = entry.calibration
    else:
        calibration = replace(comparison.calibration, camera=key, extras=())
        entry = Entry.of(calibration)
    made = calibration.provenance
    own = _own_source(camera, comparison, payload)
    made = replace(
        made,
        source=made.source or (own.name if own is not None else None),
        sha256=made.sha256 or (own.sha256 if own is not None else None),
        firmware=made.firmware or camera.firmware,
    )
    made = stated.completing(made)
    notes = (*calibration.notes, *_notes(comparison))
    return replace(
        entry,
        calibration=replace(calibration, provenance=made, notes=tuple(dict.fromkeys(notes))),
        extensions={**entry.extensions, BLOCK: _block(camera, comparison, serves, payload)},
    )


def sources_of(camera: PayloadCamera, payload: Payload) -> tuple[tuple[str, SourceFile], ...]:
    """All files that were used, with their kind; of images with equal metadata one, of frames of a board all."""
    found = [
        ("image", SourceFile(name=name, sha256=sha256_of(payload.folder / name))) for name in camera.examples
    ]
    found += [("calibration file", SourceFile(name=one.name, sha256=one.sha256)) for one in camera.files]
    found += [
        (
            FRAME,
            SourceFile(name=path.relative_to(payload.folder).as_posix(), sha256=sha256_of(path)),
        )
        for path in camera.frames
    ]
    return tuple(dict.fromkeys(found))


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


def _key(camera: PayloadCamera, comparison: EstimateComparison, serves: Serves) -> CameraKey:
    key = replace(camera.key, firmware=None)
    heard = [compared for compared in comparison.others if compared.estimate.origin == EXIF]
    confirmed = any(not compared.disagrees and compared.estimate.grade in METRIC for compared in heard)
    if not confirmed and any(compared in comparison.overruled for compared in heard):
        # A focal length that was overruled must not be part of the camera key.
        key = replace(key, focal_mm=None)
    return key if serves is Serves.UNIT else replace(key, serial=None)


def _own_source(camera: PayloadCamera, comparison: EstimateComparison, payload: Payload) -> SourceFile | None:
    if comparison.chosen.kind is Kind.FILE:
        file = next(one for one in camera.files if one.name == comparison.chosen.name)
        return SourceFile(name=file.name.rpartition("/")[2], sha256=file.sha256)
    if comparison.chosen.kind is Kind.TAGS and camera.judged is not None:
        # The state that gives the K states its first image as the source.
        source = (
            camera.judged.calibration.provenance.source if camera.judged.calibration is not None else None
        )
        name = next((one for one in camera.judged.names if one.rpartition("/")[2] == source), None)
        name = name or camera.judged.names[0]
        return SourceFile(name=name.rpartition("/")[2], sha256=sha256_of(payload.folder / name))
    return None


def _notes(comparison: EstimateComparison) -> Iterator[str]:
    for compared in comparison.overruled:
        yield (
            f"{compared.estimate.name} states fx {compared.difference:+.1%} and is not used: "
            "the other sources disagree with it"
        )


def _block(
    camera: PayloadCamera, comparison: EstimateComparison, serves: Serves, payload: Payload
) -> YamlValue:
    """Block with the sources and their estimates; the same payload gives the same block."""
    heard = [
        comparison.chosen,
        *(compared.estimate for compared in comparison.others if compared.estimate.kind is not Kind.REGISTRY),
    ]
    return {
        "serves": serves.value,
        "sources": [
            {"what": what, "name": source.name, "sha256": source.sha256}
            for what, source in sources_of(camera, payload)
            # The provenance of a solve already lists its frames.
            if not (what == FRAME and comparison.chosen.kind is Kind.BOARD)
        ],
        "heard": [
            {"kind": estimate.kind.value, "name": estimate.name, "fx": round(estimate.intrinsics.fx, 3)}
            for estimate in heard
        ],
    }
