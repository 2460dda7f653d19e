"""Whether the K that is proposed may be: heard against all others, held against the policy, compared with its kin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from calibrary.calibration import Calibration
from calibrary.errors import CalibraryError, InputError
from calibrary.evidence.edits import edits
from calibrary.jobs.diff.comparison import Comparison, compare
from calibrary.jobs.extract.cameras import circumstances
from calibrary.jobs.onboard.claims import Claim, Kind, expected_of, gap
from calibrary.jobs.onboard.subjects import Subject
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.entry import Entry, folder_of
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.keys import id_of
from calibrary.registry.registry import Registry
from calibrary.validation import Circumstances, NamedFocal, Report, Verdict, validate

__all__ = ["Hearing", "Relative", "Voice", "hear", "held_against", "relatives"]

MOST_RELATIVES: Final = 12
MOST_READ: Final = 400


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Voice:
    """One claim against the one that is chosen.

    Attributes:
        claim: what is said.
        share: how far it lies from the chosen, as a share of fx or of the width.
        agrees: whether that is near enough.
    """

    claim: Claim
    share: float
    agrees: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hearing:
    """Everybody heard.

    Attributes:
        chosen: whose K is proposed.
        voices: all others.
        overruled: those that disagree and are outvoted, or that a person does not trust.
        dispute: why nobody can be believed, None where somebody can.
    """

    chosen: Claim
    voices: tuple[Voice, ...]
    overruled: tuple[Voice, ...] = ()
    dispute: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Relative:
    """An entry of the same model and how the proposed K differs from it.

    Attributes:
        id: of the entry.
        entry: what it says.
        comparison: of its K with the proposed one; None where they cannot be compared.
        why_not: why not.
        own: whether it is of the very camera that is taken on board.
    """

    id: str
    entry: Entry
    comparison: Comparison | None
    why_not: str | None
    own: bool


def hear(claims: Sequence[Claim], trusted: Kind | None = None) -> Hearing | None:
    """Hold the first claim against the others; None where nobody claims a K.

    Whoever disagrees is outvoted by two or more hands that agree, where they are more than those that do not: a
    measurement and the catalogue outvote a firmware that writes another lens's focal length. One hand against one
    is a dispute, which a person settles with another witness or by saying whom to trust.

    Args:
        claims: the one to propose first.
        trusted: whom a person said to believe.
    """
    if trusted is not None:
        able = [claim for claim in claims if claim.kind is trusted and claim.rank is not None]
        claims = [*able[:1], *(claim for claim in claims if claim not in able[:1])]
    if not claims or claims[0].rank is None:
        return None
    chosen, *others = claims
    voices = []
    for claim in others:
        share = gap(chosen, claim)
        voices.append(Voice(claim=claim, share=share, agrees=abs(share) <= max(chosen.limit, claim.limit)))
    against = tuple(voice for voice in voices if not voice.agrees)
    for_it = {chosen.voice, *(voice.claim.voice for voice in voices if voice.agrees)}
    hands = {voice.claim.voice for voice in against} - for_it
    believed = trusted is not None and chosen.kind is trusted
    if not against or believed or (len(for_it) >= 2 and len(for_it) > len(hands)):
        return Hearing(chosen=chosen, voices=tuple(voices), overruled=against)
    return Hearing(chosen=chosen, voices=tuple(voices), dispute=_dispute(chosen, against, for_it))


def _dispute(chosen: Claim, against: Sequence[Voice], for_it: set[str]) -> str:
    told = "; ".join(
        f"{voice.claim.name} ({voice.claim.kind.value}) says fx = {voice.claim.intrinsics.fx:.1f} px, "
        f"{voice.share:+.1%}"
        for voice in against[:4]
    )
    alone = "nothing confirms it" if len(for_it) < 2 else "as many speak against it as for it"
    return f"{chosen.name} ({chosen.kind.value}) says fx = {chosen.intrinsics.fx:.1f} px, and {told}; {alone}"


def held_against(calibration: Calibration, subject: Subject, hearing: Hearing, policy: Policy) -> Report:
    """The proposed K against the policy, with what the others say around it; who was outvoted is silent."""
    camera, outvoted = subject.camera, {voice.claim.name for voice in hearing.overruled}
    if hearing.chosen.kind is Kind.TAGS and camera is not None:
        around = circumstances(camera.evidence, camera.states[0].known, spread=camera.spread)
        others = tuple(other for other in around.others if other.name not in outvoted)
        return validate(calibration, policy, replace(around, others=others))
    around = Circumstances(
        expected=expected_of(subject),
        others=tuple(
            NamedFocal(name=voice.claim.name, fx=voice.claim.intrinsics.fx, tolerance=voice.claim.limit)
            for voice in hearing.voices
            if voice.agrees and voice.claim.kind in {Kind.TAGS, Kind.FILE}
        ),
        edits=edits(camera.states[0].metadata)
        if camera is not None and hearing.chosen.kind is Kind.BOARD
        else (),
    )
    return validate(calibration, policy, around)


def refused_by(report: Report) -> str | None:
    """Why the policy does not let it pass, None where it does."""
    if report.verdict is Verdict.VALID:
        return None
    failure = report.failures[0]
    return f"{failure.message}{f'; {failure.remedy}' if failure.remedy else ''}"


def relatives(registry: Registry, entry: Entry, policy: Policy) -> tuple[Relative, ...]:
    """The entries of the same model, its own first, and then those most like it."""
    snapshot, camera = registry.snapshot(), entry.calibration.camera
    folder = folder_of(camera.make or "", camera.model or "")
    paths = sorted(path for path in snapshot.paths if path.startswith(folder))
    found = []
    for path in paths[:MOST_READ]:
        try:
            other = parse_entry(snapshot.read(path), path)
        except InputError:
            # It is for the registry's check to tell of.
            continue
        found.append(_relative(path, other, entry, policy))
    found.sort(key=lambda one: (not one.own, not _is_same_frame(one.entry, entry), one.id))
    return tuple(found[:MOST_RELATIVES])


def _relative(path: str, other: Entry, entry: Entry, policy: Policy) -> Relative:
    comparison, why_not = None, None
    if other.calibration.camera.sub_camera != entry.calibration.camera.sub_camera:
        why_not = "another camera of this model"
    else:
        try:
            comparison = compare(other.calibration, entry.calibration, policy)
        except CalibraryError as error:
            why_not = error.message if isinstance(error, InputError) else str(error)
    return Relative(
        id=id_of(path), entry=other, comparison=comparison, why_not=why_not, own=path == entry.path
    )


def _is_same_frame(one: Entry, other: Entry) -> bool:
    return one.calibration.intrinsics.image_size == other.calibration.intrinsics.image_size
