"""Estimates of a camera's K from every source, how they agree, and what speaks against the one that is proposed."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Final

from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration, Grade, Intrinsics
from calibrary.errors import CalibraryError, InputError
from calibrary.evidence.estimate import Source, SourceEstimate
from calibrary.jobs.diff.comparison import ChangeVerdict, compare
from calibrary.jobs.extract.judging import validation_context
from calibrary.jobs.onboard.payload import PayloadCamera
from calibrary.jobs.onboard.report import Agreement, Estimate, ImageSolve, Kind, RelatedEntry
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.paths import folder_of, id_of
from calibrary.registry.resolution import Resolution
from calibrary.registry.snapshot import Snapshot
from calibrary.validation import Expected, NamedFocal, Report, ValidationContext, Verdict, validate

__all__ = [
    "EXIF",
    "MEASURED",
    "chosen_of",
    "compare_estimates",
    "estimates",
    "held_against",
    "refused_by",
    "relatives",
]

MEASURED: Final = frozenset({Grade.CALIBRATED, Grade.ADJUSTED})
JUDGED: Final = MEASURED | {Grade.DESIGN}
"""Grades of K that are precise enough for a difference between two of them to be relevant."""
ALIKE: Final = frozenset({ChangeVerdict.IDENTICAL, ChangeVerdict.NOISE, ChangeVerdict.NEGLIGIBLE})
EXIF: Final = "EXIF"
"""Origin of all estimates that are based on EXIF's focal lengths."""
TOLERANCE: Final = 0.03
"""Relative tolerance between two measurements, or a measurement and a known camera, if the policy states none."""
SIGMAS: Final = 3.0
MOST_RELATIVES: Final = 12
MOST_READ: Final = 400


def estimates(
    camera: PayloadCamera,
    board: ImageSolve | None,
    flight: ImageSolve | None,
    current: Resolution | None,
    policy: Policy,
) -> tuple[Estimate, ...]:
    """Collect all estimates, the one to propose first.

    Args:
        camera: the camera.
        board: solve of its frames of a board; a refused one is not used.
        flight: solve of the images of a flight.
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


def _of_board(solve: ImageSolve | None, policy: Policy) -> Iterator[Estimate]:
    board = solve.result if solve is not None else None
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


def _of_flight(solve: ImageSolve | None, policy: Policy) -> Iterator[Estimate]:
    flight = solve.result if solve is not None else None
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
    expected = _expected(camera)
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


def chosen_of(found: Sequence[Estimate]) -> Estimate | None:
    """The estimate whose K is proposed, or would be without a dispute; None if none gives a K."""
    return next((one for one in found if one.chosen), None)


def compare_estimates(
    found: tuple[Estimate, ...], policy: Policy, trusted: Kind | None = None
) -> tuple[tuple[Estimate, ...], str | None]:
    """Choose an estimate, and compare the others with it.

    A disagreeing estimate is overruled if at least two independent origins agree with the chosen one and
    they outnumber the origins that disagree: a measurement and the catalogue overrule a firmware that writes
    the focal length of another lens. One origin against one is a dispute, which another source or ``trusted``
    resolves.

    Args:
        found: the one to propose first.
        policy: limits above which a difference between two measurements matters.
        trusted: kind of source that the user trusts.

    Returns:
        The estimates with the result of the comparison; and the dispute, if there is one.
    """
    able = [one for one in found if one.kind is trusted and one.rank is not None]
    first = next(iter((*able, *found)), None)
    if first is None or first.rank is None or first.calibration is None:
        return found, None
    compared = [one if one is first else _compared(first, one, policy) for one in found]
    against = [one for one in compared if one.agreement is Agreement.DISAGREES]
    for_it = {one.origin for one in compared if one.agreement is not Agreement.DISAGREES}
    against_it = {one.origin for one in against} - for_it
    is_decided = (
        not against
        or (trusted is not None and first.kind is trusted)
        or (len(for_it) >= 2 and len(for_it) > len(against_it))
    )
    marked = (
        replace(one, chosen=True, disputed=not is_decided)
        if one is first
        else replace(one, overruled=is_decided and one.agreement is Agreement.DISAGREES)
        for one in compared
    )
    return tuple(marked), None if is_decided else _dispute(first, against, for_it)


def _compared(chosen: Estimate, other: Estimate, policy: Policy) -> Estimate:
    difference, agreement = _gap(chosen, other), Agreement.AGREES
    if abs(difference) > max(chosen.limit, other.limit):
        agreement = Agreement.DISAGREES
    elif _matters(chosen, other, policy):
        agreement = Agreement.DIFFERS
    return replace(other, difference=difference, agreement=agreement, agrees=agreement is Agreement.AGREES)


def _gap(chosen: Estimate, other: Estimate) -> float:
    """Largest relative difference other − chosen of fx and fy, and of cx and cy ÷ width if both measured them."""
    a, b, width = chosen.intrinsics, other.intrinsics, chosen.intrinsics.image_size[0]
    apart = [b.fx / a.fx - 1.0, b.fy / a.fy - 1.0]
    if chosen.measured_centre and other.measured_centre:
        apart += [(b.cx - a.cx) / width, (b.cy - a.cy) / width]
    return max(apart, key=abs)


def _matters(chosen: Estimate, other: Estimate, policy: Policy) -> bool:
    """Whether two measured K differ by more than noise and a map allow, by the rules of ``calibrary diff``."""
    one, two = chosen.calibration, other.calibration
    if one is None or two is None or not {one.grade, two.grade} <= JUDGED:
        return False
    try:
        found = compare(two, one, policy)
    except CalibraryError:
        return True
    return found.alarm or found.verdict not in {*ALIKE, ChangeVerdict.STRUCTURAL}


def _dispute(chosen: Estimate, against: Sequence[Estimate], for_it: set[str]) -> str:
    disagreeing = "; ".join(f"{_states_fx(one)}, {one.difference:+.1%}" for one in against[:4])
    alone = "nothing confirms it" if len(for_it) < 2 else "no majority of independent sources agrees with it"
    return f"{_states_fx(chosen)}; {disagreeing}; {alone}"


def _states_fx(estimate: Estimate) -> str:
    return f"{estimate.name} ({estimate.kind.value}) states fx = {estimate.intrinsics.fx:.1f} px"


def held_against(
    found: Sequence[Estimate], chosen: Estimate, K: Calibration, camera: PayloadCamera, policy: Policy
) -> Report:
    """Validate the chosen K against the policy and the other estimates, without the overruled ones."""
    judged = camera.judged
    if chosen.kind is Kind.TAGS and judged is not None:
        around = validation_context(
            judged.evidence, judged.states[0].known, judged.states[0].original, spread=judged.spread
        )
        outvoted = {one.name for one in found if one.overruled}
        others = tuple(other for other in around.others if other.name not in outvoted)
        flights = _agreeing(found, {Kind.FLIGHT})
        return validate(K, policy, replace(around, others=(*others, *flights)))
    around = ValidationContext(
        expected=_expected(camera),
        others=_agreeing(found, {Kind.TAGS, Kind.FILE, Kind.FLIGHT}),
        edits=tuple(f"the image was {done}" for done in judged.states[0].original.moved)
        if judged is not None and chosen.kind is Kind.BOARD
        else (),
    )
    return validate(K, policy, around)


def _agreeing(found: Sequence[Estimate], kinds: Collection[Kind]) -> tuple[NamedFocal, ...]:
    """The other estimates of these kinds that do not disagree."""
    return tuple(
        NamedFocal(name=one.name, fx=one.intrinsics.fx, tolerance=one.limit)
        for one in found
        if not one.chosen and one.agreement is not Agreement.DISAGREES and one.kind in kinds
    )


def _expected(camera: PayloadCamera) -> Expected | None:
    """Expected fx from the catalogue."""
    if camera.judged is None:
        return None
    state = camera.judged.states[0]
    return validation_context(camera.judged.evidence, state.known).expected


def refused_by(report: Report) -> str | None:
    """Reason why the policy rejects K or leaves it unproven; None if it is valid."""
    if report.verdict is Verdict.VALID:
        return None
    failure = report.failures[0]
    return f"{failure.message}{f'; {failure.remedy}' if failure.remedy else ''}"


def relatives(snapshot: Snapshot, entry: Entry, policy: Policy) -> tuple[RelatedEntry, ...]:
    """The entries of the same model: its own first, then those with the same image size."""
    camera = entry.calibration.camera
    folder = folder_of(camera.make or "", camera.model or "")
    paths = sorted(path for path in snapshot.paths if path.startswith(folder))
    found: list[tuple[tuple[bool, bool, str], str, Entry]] = []
    for path in paths[:MOST_READ]:
        try:
            other = parse_entry(snapshot.read(path), path)
        except InputError:
            # `registry check` reports entries that cannot be read.
            continue
        found.append(((path != entry.path, not _is_same_frame(other, entry), id_of(path)), path, other))
    found.sort(key=lambda one: one[0])
    return tuple(_related(path, other, entry, policy) for _, path, other in found[:MOST_RELATIVES])


def _related(path: str, other: Entry, entry: Entry, policy: Policy) -> RelatedEntry:
    related = RelatedEntry(id=id_of(path), own=path == entry.path, status=other.status)
    if other.calibration.camera.sub_camera != entry.calibration.camera.sub_camera:
        return replace(related, reason="another camera of this model")
    try:
        found = compare(other.calibration, entry.calibration, policy)
    except CalibraryError as error:
        return replace(related, reason=error.message if isinstance(error, InputError) else str(error))
    numbers = found.numbers
    return replace(
        related,
        verdict=found.verdict,
        kinds=tuple(one.kind.value for one in found.structural),
        alarm=found.alarm,
        focal_change=numbers.focal_change if numbers is not None else None,
        max_px=numbers.projection.max_px if numbers is not None else None,
    )


def _is_same_frame(one: Entry, other: Entry) -> bool:
    return one.calibration.intrinsics.image_size == other.calibration.intrinsics.image_size
