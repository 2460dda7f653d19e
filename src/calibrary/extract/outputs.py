"""Which files a run writes: one K per camera, the report, and what the solver needs."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibrary.calibration import Calibration
from calibrary.calibration_json import Json
from calibrary.errors import InputError
from calibrary.extract.hand_off import HandedOver, Solver, hand_off
from calibrary.extract.outcome import Outcome
from calibrary.extract.report import encode, report_json
from calibrary.validation import Verdict

__all__ = ["Outputs", "plan"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outputs:
    """What is to be written.

    Attributes:
        files: content by path.
        matrices: the K file's name by camera slug.
        document: the report, also in ``files``.
        stale: K files of an earlier run that this one does not replace.
        not_handed_over: cameras whose K the solver must not get, by slug.
    """

    files: dict[Path, bytes]
    matrices: dict[str, str]
    document: dict[str, Json]
    stale: tuple[Path, ...] = ()
    not_handed_over: tuple[str, ...] = ()


def plan(outcome: Outcome, matrix_path: Path, solver: Solver) -> Outputs:
    """Decide on every file before any is written.

    One camera writes ``matrix_path`` itself; several write ``<stem>.<camera>.npy`` beside it. A start for
    self-calibration is ``<stem>_seed.<camera>.npy``, so that nothing that looks for K picks it up. Only a valid
    K is handed to a solver.

    Raises:
        InputError: ``matrix_path`` is no .npy, or the solver has no model for a camera.
    """
    if matrix_path.suffix != ".npy":
        raise InputError("wanted a name that ends in .npy", source=str(matrix_path), place="--output-matrix")
    alone, stem = len(outcome.cameras) == 1, matrix_path.stem
    files: dict[Path, bytes] = {}
    matrices: dict[str, str] = {}
    handed: list[HandedOver] = []
    stale: list[Path] = []
    for camera in outcome.cameras:
        path = matrix_path if alone else matrix_path.with_suffix(f".{camera.slug}.npy")
        if camera.calibration is not None:
            files[path] = _npy(camera.calibration)
            matrices[camera.slug] = path.name
            if camera.verdict is Verdict.VALID:
                handed.append(
                    HandedOver(
                        slug=camera.slug,
                        calibration=camera.calibration,
                        metadata=camera.camera.evidence.scene.metadata,
                        names=camera.camera.names,
                    )
                )
        elif path.exists():
            stale.append(path)
        if camera.fallback is not None and camera.fallback.seed is not None:
            files[path.with_name(path.name.replace(stem, f"{stem}_seed", 1))] = _npy(camera.fallback.seed)
    if not alone and matrix_path.exists():
        stale.append(matrix_path)
    for name, content in hand_off(solver, handed).items():
        files[matrix_path.with_name(name)] = content
    document = report_json(outcome, matrices)
    files[matrix_path.with_suffix(".json")] = encode(document)
    handed_over = {camera.slug for camera in handed}
    return Outputs(
        files=files,
        matrices=matrices,
        document=document,
        stale=tuple(stale),
        not_handed_over=tuple(c.slug for c in outcome.cameras if c.slug not in handed_over),
    )


def _npy(calibration: Calibration) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, calibration.intrinsics.matrix, allow_pickle=False)
    return buffer.getvalue()
