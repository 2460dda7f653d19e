"""Everybody who says what a camera's focal length is, side by side: tags, files, the board, catalogue, registry."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from calibrary.calib.result import CalibrationResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration, Grade, Intrinsics
from calibrary.evidence.witness import Source, Witness
from calibrary.jobs.extract.cameras import circumstances
from calibrary.jobs.onboard.subjects import Subject
from calibrary.policy import Policy
from calibrary.registry.resolution import Resolution
from calibrary.validation import Expected

__all__ = ["EXIF", "MEASURED", "Claim", "Kind", "claims", "expected_of", "gap"]

MEASURED: Final = frozenset({Grade.CALIBRATED, Grade.ADJUSTED})
EXIF: Final = "EXIF"
"""The voice of whatever rests on EXIF's focal lengths."""
TOLERANCE: Final = 0.03
"""Between two measurements, or one and a known camera, where the policy names none."""


class Kind(StrEnum):
    """Who says it; the value is what people read."""

    BOARD = "board"
    FILE = "file"
    TAGS = "tags"
    CATALOGUE = "catalogue"
    REGISTRY = "registry"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Claim:
    """What one source says.

    Attributes:
        kind: who.
        name: the tag, the file, the entry.
        voice: what was written by one hand: two tags of one EXIF head are one voice, however often they agree.
        intrinsics: at the size of the camera's images.
        grade: None where it is only an expectation.
        calibration: with distortion and quality, where it is a whole one that might become the entry.
        limit: how far it may lie from the one that is chosen, as a share of fx.
        measured_centre: whether cx and cy are its own.
        rank: sorts those that might become the entry, best first; None for those that must not.
    """

    kind: Kind
    name: str
    voice: str
    intrinsics: Intrinsics
    grade: Grade | None = None
    calibration: Calibration | None = None
    limit: float
    measured_centre: bool = False
    rank: tuple[int, ...] | None = None


def claims(
    subject: Subject, board: CalibrationResult | None, current: Resolution | None, policy: Policy
) -> tuple[Claim, ...]:
    """Everybody heard, the one whose K is proposed first.

    Args:
        subject: the camera.
        board: what its frames of a board were solved to; of a refused one nothing is heard.
        current: the registry's entry for it.
        policy: how near they must lie.
    """
    heard = [
        *_of_board(board, policy),
        *_of_files(subject, policy),
        *_of_tags(subject, policy),
        *_of_registry(current, policy),
        *_of_catalogue(subject, policy),
    ]
    able = [claim for claim in heard if claim.rank is not None]
    if not able:
        return tuple(heard)
    chosen = min(able, key=lambda claim: claim.rank or ())
    return (chosen, *(claim for claim in heard if claim is not chosen))


def gap(chosen: Claim, other: Claim) -> float:
    """(other − chosen) / chosen of fx or fy, or of cx and cy over the width where both measured them."""
    a, b, width = chosen.intrinsics, other.intrinsics, chosen.intrinsics.image_size[0]
    apart = [b.fx / a.fx - 1.0, b.fy / a.fy - 1.0]
    if chosen.measured_centre and other.measured_centre:
        apart += [(b.cx - a.cx) / width, (b.cy - a.cy) / width]
    return max(apart, key=abs)


def expected_of(subject: Subject) -> Expected | None:
    """What the catalogue expects of the camera."""
    if subject.camera is None:
        return None
    state = subject.camera.states[0]
    return circumstances(subject.camera.evidence, state.known).expected


def _of_board(board: CalibrationResult | None, policy: Policy) -> Iterator[Claim]:
    if board is None or board.verdict is BoardVerdict.REFUSE:
        return
    passed = board.verdict is BoardVerdict.PASS
    yield Claim(
        kind=Kind.BOARD,
        name=f"{len(board.rms_by_view)} frames of {board.observations.board}",
        voice="board",
        intrinsics=board.calibration.intrinsics,
        grade=board.calibration.grade,
        calibration=board.calibration,
        limit=_measured_limit(policy),
        measured_centre=True,
        # A provisional solve is the last among what was measured on this unit.
        rank=(board.calibration.grade.rank, 0 if passed else 3),
    )


def _of_files(subject: Subject, policy: Policy) -> Iterator[Claim]:
    for file in subject.files:
        calibration = file.calibration
        yield Claim(
            kind=Kind.FILE,
            name=file.name,
            voice=f"file {file.sha256}",
            intrinsics=calibration.intrinsics,
            grade=calibration.grade,
            calibration=calibration,
            limit=_measured_limit(policy) if calibration.grade in MEASURED else policy.witness_agreement,
            measured_centre=calibration.grade in MEASURED,
            rank=(calibration.grade.rank, 1) if calibration.grade.is_metric else None,
        )


def _of_tags(subject: Subject, policy: Policy) -> Iterator[Claim]:
    if subject.camera is None:
        return
    evidence, made = subject.camera.evidence, subject.camera.calibration
    for witness in evidence.witnesses:
        if witness.source is Source.ASSUMED_SENSOR:
            # A sensor that nobody stated is no witness, and no K of it becomes an entry.
            continue
        chosen = witness is evidence.chosen and made is not None
        rank = _tag_rank(witness) if chosen else None
        measured = witness.grade in MEASURED
        yield Claim(
            kind=Kind.TAGS,
            name=witness.tag,
            voice=_hand(witness.source),
            intrinsics=witness.intrinsics,
            grade=witness.grade,
            calibration=made if chosen else None,
            limit=max(_measured_limit(policy) if measured else policy.witness_agreement, witness.tolerance),
            measured_centre=witness.measured_centre,
            rank=rank,
        )


def _tag_rank(witness: Witness) -> tuple[int, ...]:
    return witness.grade.rank, 2


def _hand(source: Source) -> str:
    if source in {Source.DJI_DEWARP, Source.DJI_DEWARP_K6}:
        return "DJI's calibration"
    if source in {Source.CAMERA_PERSPECTIVE, Source.CAMERA_FISHEYE}:
        return "the Camera namespace"
    named = {
        Source.DJI_DESIGN: "DJI's design value",
        Source.SKYDIO_CALIBRATED: "Skydio's calibration",
        Source.FIELD_OF_VIEW: "the field of view",
    }
    # Firmware that writes another lens's focal length writes its 35 mm equivalent beside it.
    return named.get(source, EXIF)


def _of_registry(current: Resolution | None, policy: Policy) -> Iterator[Claim]:
    if current is None:
        return
    calibration = current.calibration
    yield Claim(
        kind=Kind.REGISTRY,
        name=current.path,
        voice="registry",
        intrinsics=calibration.intrinsics,
        grade=calibration.grade,
        limit=current.entry.tolerance or _measured_limit(policy),
        measured_centre=calibration.grade in MEASURED,
    )


def _of_catalogue(subject: Subject, policy: Policy) -> Iterator[Claim]:
    expected = expected_of(subject)
    if expected is None:
        return
    width, height = subject.size
    K = Intrinsics(fx=expected.fx, fy=expected.fx, cx=width / 2, cy=height / 2, image_size=subject.size)
    camera = subject.camera.states[0].known.camera if subject.camera is not None else None
    yield Claim(
        kind=Kind.CATALOGUE,
        name=camera.title if camera is not None else "catalogue",
        voice="catalogue",
        intrinsics=K,
        limit=max(_measured_limit(policy), expected.spread or 0.0),
    )


def _measured_limit(policy: Policy) -> float:
    return policy.known_camera_tolerance or TOLERANCE
