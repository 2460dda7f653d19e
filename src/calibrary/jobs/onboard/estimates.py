"""Estimates of a camera's K from every source, how they agree, and what speaks against one.

The one that is proposed becomes a registry entry: with the hash of every source, for one unit or its model.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from enum import StrEnum
from itertools import zip_longest
from pathlib import Path
from typing import Final

from calibrary.arguments import Stated
from calibrary.calib.detection import Detections
from calibrary.calib.result import CalibrationResult
from calibrary.calibration import Calibration, CameraKey, Grade, SourceFile
from calibrary.errors import CalibraryError, RegistryError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.calibrate.report import Asked, CalibrateReport
from calibrary.jobs.diff.comparison import compare
from calibrary.jobs.onboard.payload import FRAME, PayloadCamera
from calibrary.jobs.onboard.report import Agreement, Estimate, ImageSolve, Kind, RelatedEntry, UsedFile
from calibrary.jobs.survey import Against, Claim, Survey, Weighed, Who, of_entry, of_file, of_images
from calibrary.jobs.survey.limits import EXIF, known_tolerance
from calibrary.jobs.survey.placing import Placed, Settled
from calibrary.jobs.survey.relating import gap, is_by_whole, limit_between
from calibrary.jobs.survey.words import CONTRADICTED, edited
from calibrary.parsers.files import sha256_of
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.paths import folder_of, id_of
from calibrary.registry.resolution import Resolution
from calibrary.registry.snapshot import Snapshot
from calibrary.strictyaml import YamlValue
from calibrary.validation import Finding, Severity, Use

SIGMAS: Final = 3.0
MOST_RELATIVES: Final = 12
MOST_READ: Final = 400


def estimates(
    camera: PayloadCamera,
    board: ImageSolve | None,
    flight: ImageSolve | None,
    current: Resolution | None,
    policy: Policy,
) -> tuple[Survey, tuple[Estimate, ...]]:
    """Weigh all that states a K for a camera: the survey, and what is of its images' size, the one to propose first.

    Args:
        camera: the camera.
        board: solve of its frames of a board; a refused one is not used.
        flight: solve of the images of a flight.
        current: the registry's entry for it.
        policy: with the tolerances.
    """
    judged = camera.judged
    claims: dict[Kind, tuple[Claim, ...]] = {
        Kind.BOARD: _of_solve(board, Who.BOARD),
        Kind.FLIGHT: _of_solve(flight, Who.FLIGHT),
        Kind.FILE: tuple(
            of_file(file.name, file.calibration, policy.source_agreement) for file in camera.files
        ),
        Kind.TAGS: tuple(of_images(judged.evidence, camera.key, policy)) if judged is not None else (),
        Kind.REGISTRY: (of_entry(current, policy),) if current is not None else (),
    }
    metadata = judged.states[0].metadata if judged is not None else ImageMetadata(size=camera.size)
    # A file for a start only, such as the profile of a kind of lens, is no witness.
    witnesses = [one for kind in claims.values() for one in kind if not _is_start(one)]
    survey = Survey(metadata, witnesses, policy)
    starts = Survey(metadata, [one for one in claims[Kind.FILE] if _is_start(one)], policy)
    kinds = {id(one): kind for kind, own in claims.items() for one in own}
    heard = [_estimate(kinds[id(one.claim)], one, camera, survey) for one in (*survey.placed, *starts.placed)]
    return survey, tuple(sorted(heard, key=lambda one: (one.rank is None, one.rank or ())))


def _estimate(kind: Kind, one: Placed, camera: PayloadCamera, survey: Survey) -> Estimate:
    calibration, claim, judged = one.calibration, one.claim, camera.judged
    rank: tuple[int, ...] | None = (calibration.grade.rank, [*Kind].index(kind))
    made: Calibration | None = calibration
    if kind is Kind.TAGS:
        chosen = judged.evidence.chosen if judged is not None else None
        made = judged.calibration if judged and chosen and claim.name == chosen.tag else None
    elif kind is Kind.FILE and (_is_start(claim) or _is_computed(survey.weigh(claim))):
        made = None
    elif kind in {Kind.BOARD, Kind.FLIGHT} and calibration.shortfall is not None:
        # A start comes last among the measurements of this unit.
        rank = (calibration.grade.rank, len(Kind))
    if kind is Kind.REGISTRY or made is None or one.settled is Settled.AMBIGUOUS:
        rank = None
    is_catalogue = claim.who is Who.CATALOGUE
    return Estimate(
        kind=Kind.CATALOGUE if is_catalogue else kind,
        name=claim.name,
        grade=None if is_catalogue else calibration.grade,
        intrinsics=calibration.intrinsics,
        measured_centre=claim.is_measured,
        placed=one,
        calibration=made,
        rank=rank,
    )


def _of_solve(solve: ImageSolve | None, who: Who) -> tuple[Claim, ...]:
    result = solve.result if solve is not None else None
    if result is None or result.verdict is Use.NONE:
        return ()
    K, count = result.calibration, len(result.rms_by_view)
    std = K.quality.std.get("fx", 0.0) if K.quality is not None and who is Who.FLIGHT else 0.0
    name = (
        f"{count} images of a flight"
        if who is Who.FLIGHT
        else f"{count} frames of {result.observations.board}"
    )
    return (
        Claim(
            who=who,
            name=name,
            calibration=K,
            rounding=SIGMAS * std / K.intrinsics.fx,
            is_framed=True,
            is_measured=True,
            rests_on=frozenset({name}),
            voice=name,
        ),
    )


def _placed(one: Estimate) -> Placed:
    assert one.placed is not None  # noqa: S101  only a report that was read from JSON has none
    return one.placed


def _claim(one: Estimate) -> Claim:
    return _placed(one).claim


def _is_start(claim: Claim) -> bool:
    return claim.who is Who.FILE and not claim.calibration.grade.is_metric


def _is_computed(weighed: Weighed) -> bool:
    """Whether a file has the numbers of a tag, which is then proposed itself."""
    return any(not one.claim.is_measured for one in weighed.copies)


def chosen_of(found: Sequence[Estimate]) -> Estimate | None:
    """The estimate whose K is proposed, or would be without a dispute; None if none gives a K."""
    return next((one for one in found if one.chosen), None)


def compare_estimates(
    survey: Survey, found: tuple[Estimate, ...], trusted: Kind | None = None
) -> tuple[tuple[Estimate, ...], str | None]:
    """Choose an estimate: the best that nothing contradicts which is believed; and compare the others with it.

    A firmware that writes the focal length of another lens is not believed against a measurement and the catalogue;
    one source against one is a dispute, which another source or ``trusted`` resolves.

    Args:
        survey: of all that is heard.
        found: the one to propose first.
        trusted: kind of source that the user trusts.

    Returns:
        The estimates with the result of the comparison; and the dispute, if there is one.
    """
    able = sorted((one for one in found if one.rank is not None), key=lambda one: one.kind is not trusted)
    if not able:
        return found, None
    weighed = {id(one): survey.weigh(_claim(one)) for one in able}
    first = able[0]
    is_decided = first.kind is trusted or not against(weighed[id(first)])
    if not is_decided:
        # A lesser K is proposed only where the best one is shown wrong; otherwise the two are in dispute.
        for one in able[1:]:
            shown_wrong = [other.one for other in weighed[id(one)].disbelieved]
            if able[0].placed in shown_wrong and not against(weighed[id(one)]):
                first, is_decided = one, True
                break
    told = weighed[id(first)]
    marked = tuple(
        replace(one, chosen=True, disputed=not is_decided)
        if one is first
        else _compared(first, one, told, survey.policy, is_decided=is_decided)
        for one in found
    )
    return marked, None if is_decided else _dispute(first, told)


def against(weighed: Weighed) -> list[Against]:
    """What is believed against an estimate; a calibration of the same camera that moved is no dispute, but told."""
    return [one for one in weighed.believed if one.is_far]


def _compared(
    first: Estimate, one: Estimate, weighed: Weighed, policy: Policy, *, is_decided: bool
) -> Estimate:
    K, other = _placed(first), _placed(one)
    if _is_start(other.claim):
        return replace(one, difference=gap(other, K), is_by_whole=is_by_whole(other, K))
    agreement = Agreement.AGREES
    said = next((said for said in weighed.against if said.one is other), None)
    if said is not None:
        agreement = Agreement.DISAGREES if said.is_far else Agreement.DIFFERS
    elif one.kind is Kind.CATALOGUE and all(other is not near for near in weighed.confirmed_by):
        # It may be right as far as a lens of the type may be off, and a map shows such a difference.
        agreement = Agreement.DIFFERS
    return replace(
        one,
        difference=gap(other, K),
        is_by_whole=is_by_whole(other, K),
        limit=limit_between(K.claim, other.claim) or known_tolerance(policy),
        agreement=agreement,
        agrees=agreement is Agreement.AGREES,
        overruled=is_decided and agreement is Agreement.DISAGREES,
        is_copy=any(one.placed is copy for copy in weighed.copies),
    )


def _dispute(chosen: Estimate, weighed: Weighed) -> str:
    disagreeing = "; ".join(one.message for one in against(weighed)[:4])
    confirmed = ", ".join(one.claim.name for one in weighed.confirmed_by[:2])
    alone = f"only {confirmed} confirms it" if confirmed else "nothing confirms it"
    stated = f"{chosen.name} ({chosen.kind.value}) states fx = {chosen.intrinsics.fx:.1f} px"
    return f"{stated}; {disagreeing}; {alone}"


def held_against(survey: Survey, chosen: Estimate, camera: PayloadCamera) -> tuple[Finding, ...]:
    """What speaks against the chosen K, the gravest first, without what is overruled."""
    weighed, judged = survey.weigh(_claim(chosen)), camera.judged
    found = [one for one in weighed.findings if one.rule != CONTRADICTED]
    if judged is not None and chosen.kind is Kind.TAGS and judged.report is not None:
        others = [one for one in weighed.confirmed_by if one.claim.who not in {Who.TAG, Who.CATALOGUE}]
        found = found if others else [*judged.report.findings]
    elif judged is not None and chosen.kind is Kind.BOARD:
        moved = judged.states[0].original.moved
        found += [edited(f"the image was {done}", survey.policy) for done in moved]
    elif judged is not None and chosen.kind is Kind.FILE:
        doubt = judged.doubt(_claim(chosen).calibration)
        found += [edited(doubt, survey.policy)] if doubt is not None else []
    return tuple(sorted(found, key=lambda one: -[*Severity].index(one.severity)))


def refused_by(findings: Sequence[Finding]) -> str | None:
    """Reason why K is rejected or left unproven; None if it is valid."""
    grave = next((one for one in findings if one.severity in {Severity.ERROR, Severity.UNPROVEN}), None)
    if grave is None:
        return None
    return f"{grave.message}{f'; {grave.remedy}' if grave.remedy else ''}"


def relatives(snapshot: Snapshot, entry: Entry, policy: Policy) -> tuple[RelatedEntry, ...]:
    """The entries of the same model: its own first, then those with the same image size."""
    camera = entry.calibration.camera
    folder = folder_of(camera.make or "", camera.model or "")
    paths = sorted(path for path in snapshot.cameras if path.startswith(folder))
    found: list[tuple[tuple[bool, bool, str], str, Entry]] = []
    for path in paths[:MOST_READ]:
        try:
            stored = snapshot.at(path)
        except RegistryError:
            # `registry check` reports entries that cannot be read.
            continue
        if stored is not None:
            other = stored.entry
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
        return replace(related, reason=error.why)
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
        entry = CalibrateReport.of(replace(solved, calibration=named), seen, Asked()).entry
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
    """Whether two entries are of the same cameras and have the same K; what it was read from may differ."""
    return (
        one.path == other.path
        and one.calibration.grade is other.calibration.grade
        and type(one.calibration.distortion) is type(other.calibration.distortion)
        and all(
            math.isclose(a, b, rel_tol=SAME_NUMBER, abs_tol=SAME_NUMBER)
            for a, b in zip_longest(_numbers(one), _numbers(other), fillvalue=math.inf)
        )
    )


def _numbers(entry: Entry) -> list[float]:
    K, lens = entry.calibration.intrinsics, entry.calibration.distortion
    return [K.fx, K.fy, K.cx, K.cy, K.skew, *(lens.coefficients.values() if lens is not None else ())]


def _key(camera: PayloadCamera, found: Sequence[Estimate], serves: Serves) -> CameraKey:
    key = replace(camera.key, firmware=None)
    of_exif = [one for one in found[1:] if _claim(one).voice == EXIF]
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
