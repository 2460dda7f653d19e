"""All estimates of a camera's focal length: from tags, files, board, flight, catalogue and registry."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from typing import Final

from msgspec import Struct

from calibrary.calib.result import CalibrationResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration, Grade, Intrinsics
from calibrary.evidence.estimate import Source, SourceEstimate
from calibrary.jobs.extract.judging import circumstances
from calibrary.jobs.onboard.cameras import PayloadCamera
from calibrary.policy import Policy
from calibrary.registry.resolution import Resolution
from calibrary.validation import Expected

__all__ = ["EXIF", "MEASURED", "Estimate", "Kind", "estimates", "expected_of", "gap"]

MEASURED: Final = frozenset({Grade.CALIBRATED, Grade.ADJUSTED})
EXIF: Final = "EXIF"
"""Origin of all estimates that are based on EXIF's focal lengths."""
TOLERANCE: Final = 0.03
"""Relative tolerance between two measurements, or a measurement and a known camera, if the policy states none."""

SIGMAS: Final = 3.0


class Kind(StrEnum):
    """Kind of source; the value is the text shown to the user."""

    BOARD = "board"
    FLIGHT = "flight"
    FILE = "file"
    TAGS = "tags"
    CATALOGUE = "catalogue"
    REGISTRY = "registry"


class Estimate(Struct, frozen=True, kw_only=True, eq=False):
    """Estimate of K from one source.

    Attributes:
        kind: of the source.
        name: of the tag, file or entry.
        origin: estimates of the same origin count once, because they share an input: two tags of one EXIF
            header that agree do not confirm each other.
        intrinsics: at the size of the camera's images.
        grade: origin of the intrinsics; None if it is only an expectation.
        calibration: with distortion and quality, if the source is a complete calibration.
        limit: largest allowed difference from the chosen estimate, as a fraction of fx.
        measured_centre: whether the source states cx and cy.
        rank: sort key, best first, of estimates that may become the entry; None for those that must not.
    """

    kind: Kind
    name: str
    origin: str
    intrinsics: Intrinsics
    grade: Grade | None = None
    calibration: Calibration | None = None
    limit: float
    measured_centre: bool = False
    rank: tuple[int, ...] | None = None


def estimates(
    camera: PayloadCamera,
    board: CalibrationResult | None,
    flight: CalibrationResult | None,
    current: Resolution | None,
    policy: Policy,
) -> tuple[Estimate, ...]:
    """Collect all estimates, the one to propose first.

    Args:
        camera: the camera.
        board: calibration from its frames of a board; a refused one is not used.
        flight: calibration from the images of a flight.
        current: the registry's entry for it.
        policy: with the tolerances.
    """
    heard = [
        *_of_board(board, policy),
        *_of_flight(flight, policy),
        *_of_files(camera, policy),
        *_of_tags(camera, policy),
        *_of_registry(current, policy),
        *_of_catalogue(camera, policy),
    ]
    able = [estimate for estimate in heard if estimate.rank is not None]
    if not able:
        return tuple(heard)
    chosen = min(able, key=lambda estimate: estimate.rank or ())
    return (chosen, *(estimate for estimate in heard if estimate is not chosen))


def gap(chosen: Estimate, other: Estimate) -> float:
    """Largest relative difference other − chosen of fx and fy, and of cx and cy ÷ width if both measured them."""
    a, b, width = chosen.intrinsics, other.intrinsics, chosen.intrinsics.image_size[0]
    apart = [b.fx / a.fx - 1.0, b.fy / a.fy - 1.0]
    if chosen.measured_centre and other.measured_centre:
        apart += [(b.cx - a.cx) / width, (b.cy - a.cy) / width]
    return max(apart, key=abs)


def expected_of(camera: PayloadCamera) -> Expected | None:
    """Expected fx from the catalogue."""
    if camera.judged is None:
        return None
    state = camera.judged.states[0]
    return circumstances(camera.judged.evidence, state.known).expected


def _of_board(board: CalibrationResult | None, policy: Policy) -> Iterator[Estimate]:
    if board is None or board.verdict is BoardVerdict.REFUSE:
        return
    passed = board.verdict is BoardVerdict.PASS
    yield Estimate(
        kind=Kind.BOARD,
        name=f"{len(board.rms_by_view)} frames of {board.observations.board}",
        origin="board",
        intrinsics=board.calibration.intrinsics,
        grade=board.calibration.grade,
        calibration=board.calibration,
        limit=_measured_limit(policy),
        measured_centre=True,
        # A provisional solve ranks last among the measurements of this unit.
        rank=(board.calibration.grade.rank, 0 if passed else 3),
    )


def _of_flight(flight: CalibrationResult | None, policy: Policy) -> Iterator[Estimate]:
    if flight is None or flight.verdict is BoardVerdict.REFUSE:
        return
    calibration, passed = flight.calibration, flight.verdict is BoardVerdict.PASS
    std = calibration.quality.std.get("fx", 0.0) if calibration.quality is not None else 0.0
    yield Estimate(
        kind=Kind.FLIGHT,
        name=f"{len(flight.rms_by_view)} images of a flight",
        origin="flight",
        intrinsics=calibration.intrinsics,
        grade=calibration.grade,
        calibration=calibration,
        limit=max(_measured_limit(policy), SIGMAS * std / calibration.intrinsics.fx),
        measured_centre=True,
        # Within a grade, a calibration file and the camera's own calibration come first.
        rank=(calibration.grade.rank, 3 if passed else 4),
    )


def _of_files(camera: PayloadCamera, policy: Policy) -> Iterator[Estimate]:
    for file in camera.files:
        calibration = file.calibration
        yield Estimate(
            kind=Kind.FILE,
            name=file.name,
            origin=f"file {file.sha256}",
            intrinsics=calibration.intrinsics,
            grade=calibration.grade,
            calibration=calibration,
            limit=_measured_limit(policy) if calibration.grade in MEASURED else policy.source_agreement,
            measured_centre=calibration.grade in MEASURED,
            rank=(calibration.grade.rank, 1) if calibration.grade.is_metric else None,
        )


def _of_tags(camera: PayloadCamera, policy: Policy) -> Iterator[Estimate]:
    if camera.judged is None:
        return
    evidence, made = camera.judged.evidence, camera.judged.calibration
    for estimate in evidence.estimates:
        if estimate.source is Source.ASSUMED_SENSOR:
            # An assumed sensor size is not evidence, and its K must not become an entry.
            continue
        chosen = estimate is evidence.chosen and made is not None
        rank = _tag_rank(estimate) if chosen else None
        measured = estimate.grade in MEASURED
        yield Estimate(
            kind=Kind.TAGS,
            name=estimate.tag,
            origin=_hand(estimate.source),
            intrinsics=estimate.intrinsics,
            grade=estimate.grade,
            calibration=made if chosen else None,
            limit=max(_measured_limit(policy) if measured else policy.source_agreement, estimate.tolerance),
            measured_centre=estimate.measured_centre,
            rank=rank,
        )


def _tag_rank(estimate: SourceEstimate) -> tuple[int, ...]:
    return estimate.grade.rank, 2


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
    # Firmware that writes the focal length of another lens also writes the 35 mm equivalent of that lens.
    return named.get(source, EXIF)


def _of_registry(current: Resolution | None, policy: Policy) -> Iterator[Estimate]:
    if current is None:
        return
    calibration = current.calibration
    yield Estimate(
        kind=Kind.REGISTRY,
        name=current.path,
        origin="registry",
        intrinsics=calibration.intrinsics,
        grade=calibration.grade,
        calibration=calibration,
        limit=current.entry.tolerance or _measured_limit(policy),
        measured_centre=calibration.grade in MEASURED,
    )


def _of_catalogue(camera: PayloadCamera, policy: Policy) -> Iterator[Estimate]:
    expected = expected_of(camera)
    if expected is None:
        return
    width, height = camera.size
    K = Intrinsics(fx=expected.fx, fy=expected.fx, cx=width / 2, cy=height / 2, image_size=camera.size)
    known = camera.judged.states[0].known.camera if camera.judged is not None else None
    yield Estimate(
        kind=Kind.CATALOGUE,
        name=known.title if known is not None else "catalogue",
        origin="catalogue",
        intrinsics=K,
        limit=max(_measured_limit(policy), expected.spread or 0.0),
    )


def _measured_limit(policy: Policy) -> float:
    return policy.known_camera_tolerance or TOLERANCE
