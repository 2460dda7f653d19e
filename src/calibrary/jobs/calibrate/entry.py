"""The registry entry of a calibration: K with everything needed to judge it and to repeat the solve."""

from __future__ import annotations

from typing import Final

from calibrary.calib.board import Board
from calibrary.calib.result import CalibrationResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import CameraKey
from calibrary.errors import InputError, UnknownCameraError
from calibrary.jobs.calibrate.run import SolveRequest
from calibrary.records import replace, to_json
from calibrary.registry.entry import Entry
from calibrary.registry.entry_checks import BOARD_BLOCK
from calibrary.registry.registry import Registry
from calibrary.strictyaml import YamlValue

__all__ = ["camera_named", "entry_of", "require_key"]

ON_BOARD: Final = "board"
"""Kind of provenance of calibrations that name their frames."""


def camera_named(registry: Registry, key: str) -> CameraKey:
    """The camera of an existing entry that a calibration is to replace.

    Raises:
        UnknownCameraError: no entry matches the key.
        RegistryError: several entries match the key.
    """
    try:
        return registry.get(key).entry.calibration.camera
    except UnknownCameraError as error:
        raise UnknownCameraError(
            f"{error}; a camera without an entry is named by --make NAME --model NAME"
        ) from None


def require_key(camera: CameraKey) -> None:
    """Check that the camera has the fields by which an entry is found.

    Raises:
        InputError: make or model is unknown.
    """
    flag_of = {"make": "--make", "model": "--model"}
    missing = [name for name in flag_of if not (getattr(camera, name) or "").strip()]
    if missing:
        flags = " ".join(f"{flag_of[name]} NAME" for name in missing)
        raise InputError(
            f"the frames do not say the camera's {' and '.join(missing)}, by which its entry is found; say {flags}, "
            "or --as KEY for a camera that has one"
        )


def entry_of(result: CalibrationResult, request: SolveRequest) -> Entry:
    """Make a draft entry.

    Raises:
        InputError: the calibration was refused, its camera is unknown, or it is not from frames.
    """
    if result.verdict is BoardVerdict.REFUSE:
        raise InputError("a calibration that was refused becomes no entry; its report says what to do")
    require_key(result.calibration.camera)
    made = result.calibration.provenance
    if made.kind == ON_BOARD and not made.sources:
        raise InputError(
            "the corners do not say which frames they were seen in (no sha256), and an entry has to; calibrate from "
            "the frames"
        )
    return replace(Entry.of(result.calibration), extensions={BOARD_BLOCK: _block(result, request)})


def _block(result: CalibrationResult, request: SolveRequest) -> dict[str, YamlValue]:
    """The entry's block on the solve: arguments, results and program versions."""
    evidence, seen = result.evidence, result.evidence.geometry
    block: dict[str, YamlValue] = {
        "verdict": result.verdict.value,
        "reasons": list(result.rules),
        "board": _board(result),
        "asked": {
            "model": request.model,
            "warp": request.warp,
            "guess_fx": request.guess.fx if request.guess is not None else None,
        },
        "model": result.model.value,
        f"warp_{evidence.unit}": list(result.warp.warp_mm) if result.warp and evidence.is_warped else None,
        "noise_px": evidence.noise_px,
        "tilt_spread_deg": seen.tilt_spread_deg,
        "depth_ratio": seen.depth_ratio,
        "reach": seen.coverage.reach,
        "left_out": {view.name: view.without.reason.value for view in result.views_out if view.without},
        "corners_left_out": evidence.corners_out,
        "date_origin": result.date_origin,
        "programs": dict(result.versions),
    }
    return {name: value for name, value in block.items() if value not in (None, {}, [])}


def _board(result: CalibrationResult) -> YamlValue:
    board = result.observations.board
    if not isinstance(board, Board):
        return str(board)
    return {name: value for name, value in to_json(board).items() if value is not None}
