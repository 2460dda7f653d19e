"""A calibration from corners, signed: by whom, when, from which corners, and what a person should know of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime

from calibrary.calib.board import Board
from calibrary.calib.calibrate import calibrate
from calibrary.calib.result import CalibrationResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Intrinsics, Provenance
from calibrary.jobs.calibrate_board.sights import Sights
from calibrary.records import replace
from calibrary.validation import Severity

__all__ = ["Wanted", "solved"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """How to solve, and who does.

    Attributes:
        model: of the lens, or "auto".
        warp: whether the board may turn out to be bent.
        guess: a K to start from.
        operator: who answers for it; None where nobody was named.
        corners_name: of the corners.json that holds what this was made from, where there is one.
    """

    model: str = "auto"
    warp: bool = True
    guess: Intrinsics | None = None
    operator: str | None = None
    corners_name: str | None = None


def solved(sights: Sights, wanted: Wanted) -> CalibrationResult:
    """Solve, with a provenance that leads back to every frame.

    Raises:
        InputError: the corners contradict themselves.
        CalibrationError: they do not determine a camera.
    """
    result = calibrate(sights.observations, wanted.model, guess=wanted.guess, warp=wanted.warp)
    made = result.calibration
    calibration = replace(
        made,
        provenance=_signed(made.provenance, sights, wanted),
        notes=(*made.notes, *_notes(result)),
    )
    return replace(result, calibration=calibration)


def _signed(provenance: Provenance, sights: Sights, wanted: Wanted) -> Provenance:
    board = sights.observations.board
    on_board = f"{board} of {board.square_mm:g} mm" if isinstance(board, Board) else str(board)
    return replace(
        provenance,
        source=wanted.corners_name or provenance.source,
        tag=on_board,
        # Of everything that was seen, as corners.json holds it; the solve may have left out views.
        sha256=sights.sha256,
        date=datetime.now(UTC).date().isoformat(),
        operator=wanted.operator,
    )


def _notes(result: CalibrationResult) -> Iterator[str]:
    """What a user of the K should know, in the words of the verdict."""
    outcome = result.verdict
    if outcome is not BoardVerdict.PASS:
        yield f"{outcome.value}: not good enough to be approved"
    for finding in result.findings:
        if finding.severity is not Severity.NOTE:
            yield str(finding)
