"""Estimates of a camera's K from every source, how they agree, and what speaks against one.

The one that is proposed becomes a registry entry: with the hash of every source, for one unit or its model.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from enum import StrEnum
from itertools import zip_longest
from pathlib import Path
from typing import Final

from calibrary.arguments import Stated
from calibrary.calib.detection import Detections
from calibrary.calib.result import CalibrationResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance, SourceFile
from calibrary.errors import CalibraryError, InputError
from calibrary.jobs.calibrate.report import Asked, report_of
from calibrary.jobs.diff.comparison import compare
from calibrary.jobs.extract.judging import validation_context
from calibrary.jobs.onboard.payload import FRAME, PayloadCamera, sha256_of
from calibrary.jobs.onboard.report import Agreement, Estimate, ImageSolve, Kind, RelatedEntry, UsedFile
from calibrary.jobs.weigh import (
    EXIF,
    MEASURED,
    Contradiction,
    Source,
    Weighed,
    known_tolerance,
    limit_between,
    of_tags,
    weigh,
)
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.paths import folder_of, id_of
from calibrary.registry.resolution import Resolution
from calibrary.registry.snapshot import Snapshot
from calibrary.strictyaml import YamlValue
from calibrary.validation import Expected, NamedFocal, Report, ValidationContext, Verdict, validate

JUDGED: Final = MEASURED | {Grade.DESIGN}
"""Grades of K that are precise enough for a difference between two of them to be relevant."""
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
        *_of_board(board),
        *_of_flight(flight),
        *_of_files(camera, policy),
        *_of_tags(camera, policy),
        *_of_registry(current, policy),
        *_of_catalogue(camera, policy),
    ]
    return tuple(sorted(heard, key=lambda one: (one.rank is None, one.rank or ())))


def _stated(kind: Kind, source: Source, rank: tuple[int, ...] | None = None) -> Estimate:
    K = source.calibration
    return Estimate(
        kind=kind,
        name=source.name,
        grade=K.grade,
        intrinsics=K.intrinsics,
        measured_centre=source.is_measured,
        calibration=K,
        rank=rank,
        source=source,
    )


def _of_board(solve: ImageSolve | None) -> Iterator[Estimate]:
    board = solve.result if solve is not None else None
    if board is None or board.verdict is BoardVerdict.REFUSE:
        return
    passed = board.verdict is BoardVerdict.PASS
    name = f"{len(board.rms_by_view)} frames of {board.observations.board}"
    # A provisional solve ranks last among the measurements of this unit.
    rank = (board.calibration.grade.rank, 0 if passed else 3)
    yield _stated(Kind.BOARD, Source.measured(name, board.calibration), rank)


def _of_flight(solve: ImageSolve | None) -> Iterator[Estimate]:
    flight = solve.result if solve is not None else None
    if flight is None or flight.verdict is BoardVerdict.REFUSE:
        return
    calibration, passed = flight.calibration, flight.verdict is BoardVerdict.PASS
    std = calibration.quality.std.get("fx", 0.0) if calibration.quality is not None else 0.0
    source = Source.measured(f"{len(flight.rms_by_view)} images of a flight", calibration)
    source = replace(source, rounding=SIGMAS * std / calibration.intrinsics.fx)
    # Within a grade, a calibration file and the camera's own calibration come first.
    yield _stated(Kind.FLIGHT, source, (calibration.grade.rank, 3 if passed else 4))


def _of_files(camera: PayloadCamera, policy: Policy) -> Iterator[Estimate]:
    stated = of_tags(camera.judged.evidence, camera.key, policy) if camera.judged is not None else ()
    nominal = [tag for tag in stated if not tag.is_measured]
    for file in camera.files:
        source = Source.measured(file.name, file.calibration)
        if not source.is_measured:
            source = replace(source, tolerance=policy.source_agreement, why="it was not measured")
        grade, is_computed = file.calibration.grade, any(source.is_copy_of(tag) for tag in nominal)
        yield _stated(Kind.FILE, source, (grade.rank, 1) if grade.is_metric and not is_computed else None)


def _of_tags(camera: PayloadCamera, policy: Policy) -> Iterator[Estimate]:
    if camera.judged is None:
        return
    chosen, made = camera.judged.evidence.chosen, camera.judged.calibration
    for source in of_tags(camera.judged.evidence, camera.key, policy):
        grade = source.calibration.grade
        is_chosen = chosen is not None and source.name == chosen.tag and made is not None
        estimate = _stated(Kind.TAGS, source, (grade.rank, 2) if is_chosen else None)
        yield replace(estimate, calibration=made if is_chosen else None)


def _of_registry(current: Resolution | None, policy: Policy) -> Iterator[Estimate]:
    if current is not None:
        yield _stated(Kind.REGISTRY, Source.of_entry(current, policy))


def _of_catalogue(camera: PayloadCamera, policy: Policy) -> Iterator[Estimate]:
    expected = _expected(camera)
    if expected is None:
        return
    width, height = camera.size
    K = Intrinsics(fx=expected.fx, fy=expected.fx, cx=width / 2, cy=height / 2, image_size=camera.size)
    known = camera.judged.states[0].known.camera if camera.judged is not None else None
    name = known.title if known is not None else "catalogue"
    made = Calibration(
        camera=camera.key,
        intrinsics=K,
        grade=Grade.DERIVED,
        provenance=Provenance(kind="catalogue", tag=name),
    )
    source = Source(
        name=name,
        calibration=made,
        tolerance=max(known_tolerance(policy), expected.spread or 0.0),
        why="the catalogue's focal length",
        rests_on=frozenset({"catalogue"}),
        # A focal length that EXIF states is in it as well, if the catalogue knows only the pixels.
        voice=EXIF if expected.by_exif_focal else "catalogue",
    )
    yield replace(_stated(Kind.CATALOGUE, source), grade=None, calibration=None)


def chosen_of(found: Sequence[Estimate]) -> Estimate | None:
    """The estimate whose K is proposed, or would be without a dispute; None if none gives a K."""
    return next((one for one in found if one.chosen), None)


def compare_estimates(
    found: tuple[Estimate, ...], camera: CameraKey, policy: Policy, trusted: Kind | None = None
) -> tuple[tuple[Estimate, ...], str | None]:
    """Choose an estimate: the best that nothing contradicts which is believed; and compare the others with it.

    A firmware that writes the focal length of another lens is not believed against a measurement and the catalogue;
    one source against one is a dispute, which another source or ``trusted`` resolves.

    Args:
        found: the one to propose first.
        camera: key of the camera.
        policy: limits above which a difference between two measurements matters.
        trusted: kind of source that the user trusts.

    Returns:
        The estimates with the result of the comparison; and the dispute, if there is one.
    """
    able = [one for one in found if one.rank is not None and one.calibration is not None]
    believed = [one for one in able if one.kind is trusted]
    if not able:
        return found, None
    ranked = [
        *believed,
        *sorted((one for one in able if one not in believed), key=lambda one: one.rank or ()),
    ]
    weighed = {id(one): _weighed(one, found, camera, policy) for one in ranked}
    # A lesser K is proposed only where the best one is shown wrong; otherwise the two are in dispute.
    disproving = (
        one
        for one in ranked[1:]
        if not _against(weighed[id(one)], policy)
        and any(other.source is ranked[0].source for other in weighed[id(one)].disbelieved)
    )
    is_open = not believed and bool(_against(weighed[id(ranked[0])], policy))
    first = next(disproving, ranked[0]) if is_open else ranked[0]
    against = _against(weighed[id(first)], policy)
    is_decided = bool(believed) or not against
    marked = tuple(
        replace(one, chosen=True, disputed=not is_decided)
        if one is first
        else _compared(first, one, weighed[id(first)], policy, is_decided=is_decided)
        for one in found
    )
    return marked, None if is_decided else _dispute(first, against, weighed[id(first)])


def _weighed(one: Estimate, found: Sequence[Estimate], camera: CameraKey, policy: Policy) -> Weighed:
    sources = [
        other.source
        for other in found
        if other is not one and other.source is not None and not _is_start(other)
    ]
    assert one.source is not None  # noqa: S101  all estimates are made from sources
    return weigh(one.source, sources, camera, policy)


def _against(weighed: Weighed, policy: Policy) -> list[Contradiction]:
    """What is believed against an estimate; a calibration of the same camera that moved is no dispute, but told."""
    return [one for one in weighed.believed_against if not _is_near(one.source, weighed.source, policy)]


def _is_near(one: Source, other: Source, policy: Policy) -> bool:
    """Whether two measured calibrations may be of one camera that moved, or of two units of its model."""
    if not (one.is_measured and other.is_measured):
        return False
    return abs(_gap(one, other)) <= max(known_tolerance(policy), one.rounding, other.rounding)


def _compared(
    first: Estimate, one: Estimate, weighed: Weighed, policy: Policy, *, is_decided: bool
) -> Estimate:
    assert first.source is not None  # noqa: S101  all estimates are made from sources
    assert one.source is not None  # noqa: S101  as above
    if _is_start(one):
        return replace(one, difference=_gap(first.source, one.source))
    against = next((other for other in weighed.contradicted_by if other.source is one.source), None)
    agreement = Agreement.AGREES
    if against is not None:
        agreement = Agreement.DIFFERS if _is_near(one.source, first.source, policy) else Agreement.DISAGREES
    elif _matters(first, one, policy):
        agreement = Agreement.DIFFERS
    return replace(
        one,
        difference=_gap(first.source, one.source),
        limit=limit_between(first.source, one.source) or known_tolerance(policy),
        agreement=agreement,
        agrees=agreement is Agreement.AGREES,
        overruled=is_decided and agreement is Agreement.DISAGREES,
    )


def _is_start(one: Estimate) -> bool:
    """Whether it is a file for a start only, such as the profile of a kind of lens, which is no witness."""
    return one.kind is Kind.FILE and one.grade is not None and not one.grade.is_metric


def _gap(chosen: Source, other: Source) -> float:
    """Largest relative difference other − chosen of fx and fy, and of cx and cy ÷ width if both measured them."""
    a, b = chosen.calibration.intrinsics, other.calibration.intrinsics
    apart = [b.fx / a.fx - 1.0, b.fy / a.fy - 1.0]
    if chosen.is_measured and other.is_measured:
        apart += [(b.cx - a.cx) / a.image_size[0], (b.cy - a.cy) / a.image_size[0]]
    return max(apart, key=abs)


def _matters(chosen: Estimate, other: Estimate, policy: Policy) -> bool:
    """Whether a maker's design value differs from a measured K by more than a map allows, by ``calibrary diff``."""
    one, two = chosen.calibration, other.calibration
    if (
        one is None
        or two is None
        or not {one.grade, two.grade} <= JUDGED
        or {one.grade, two.grade} <= MEASURED
    ):
        return False
    try:
        return compare(two, one, policy).alarm
    except CalibraryError:
        return True


def _dispute(chosen: Estimate, against: Sequence[Contradiction], weighed: Weighed) -> str:
    disagreeing = "; ".join(
        f"{one.source.name} states fx = {one.source.fx:.1f} px, {one.difference:+.1%}" for one in against[:4]
    )
    confirmed = ", ".join(one.name for one in weighed.confirmed_by[:2])
    alone = f"only {confirmed} confirms it" if confirmed else "nothing confirms it"
    stated = f"{chosen.name} ({chosen.kind.value}) states fx = {chosen.intrinsics.fx:.1f} px"
    return f"{stated}; {disagreeing}; {alone}"


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
    edits: tuple[str, ...] = ()
    if judged is not None and chosen.kind is Kind.BOARD:
        edits = tuple(f"the image was {done}" for done in judged.states[0].original.moved)
    elif chosen.kind is Kind.FILE:
        edits = tuple(one.doubt for one in camera.files if one.name == chosen.name and one.doubt is not None)
    around = ValidationContext(
        expected=_expected(camera),
        others=_agreeing(found, {Kind.TAGS, Kind.FILE, Kind.FLIGHT}),
        edits=edits,
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
            for a, b in zip_longest(_numbers(one), _numbers(other), fillvalue=math.inf)
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
        made = camera.judged.calibration
        [name, *_] = next(one.state.names for one in camera.judged.judged if one.calibration == made)
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
