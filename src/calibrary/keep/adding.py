"""Adding calibrations to a registry: held beside what stands there, checked, and only then written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Final

from calibrary.errors import InputError, RegistryError
from calibrary.keep.admission import objections
from calibrary.keep.candidates import Candidate, Wish, candidates
from calibrary.keep.fields import FieldChange, differences
from calibrary.keep.keeper import Keeper, note_of
from calibrary.keep.operand import Reading
from calibrary.records import replace
from calibrary.registry.digest import digest
from calibrary.registry.entry import UNSTATED, Entry, Status
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.writing import Written, identity
from calibrary.validation import Finding

__all__ = ["Proposal", "Wish", "propose", "write_proposals"]

BY_HAND: Final = "numbers changed by hand"
OF_THE_ADDING: Final = ("tool", "date", "operator")


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """One entry as it would be written.

    Attributes:
        entry: what it would be.
        standing: what stands at its path, None for nothing or for what cannot be read.
        base: the id of the content that stands there; the write holds only while it is still this one.
        changes: field by field; everything of a new entry, nothing where all is there already.
        remarks: what a person should know before agreeing.
    """

    entry: Entry
    standing: Entry | None
    base: str | None
    changes: tuple[FieldChange, ...]
    remarks: tuple[str, ...]


def propose(
    keeper: Keeper, path: Path, reading: Reading, wish: Wish
) -> tuple[tuple[Proposal, ...], tuple[Finding, ...]]:
    """The entries that a file would become, and what the registry's check says of them.

    Args:
        keeper: of the registry.
        path: a calibration file of any format, an image, or an entry's YAML, with or without a digest.
        reading: answers to what the file leaves open, and which camera of several.
        wish: what the user said besides.

    Raises:
        InputError: it cannot be read, its camera is not known, or K is a guess.
        RegistryError: a person pinned the entry that stands there.
    """
    today = datetime.now(UTC).date().isoformat()
    operator = wish.operator or identity(keeper.registry.repo)[0].name
    proposals = [
        _proposal(keeper, found, wish, (operator, today)) for found in candidates(path, reading, wish)
    ]
    _refuse_same_place(proposals, path.name)
    due = [proposal.entry for proposal in proposals if proposal.changes]
    return tuple(proposals), objections(keeper, due) if due else ()


def write_proposals(
    keeper: Keeper, proposals: Sequence[Proposal], wish: Wish, *, source: Path | None = None
) -> Written:
    """Write them as one commit.

    Args:
        keeper: of the registry.
        proposals: as they were shown.
        wish: as it was said.
        source: the file they came from; where that is the entry in the work tree, edited by hand, the commit
            takes its place.

    Raises:
        FileConflictError: somebody has changed one since it was shown; nothing was written.
        RegistryError: they cannot be written.
    """
    due = [proposal for proposal in proposals if proposal.changes]
    entries = [proposal.entry for proposal in due]
    verb = "Add" if all(proposal.base is None for proposal in due) else "Update"
    named = entries[0].id if len(entries) == 1 else f"{len(entries)} cameras"
    ending = ", approved" if wish.approve else ""
    note = note_of(f"{verb} {named}{ending}", entries, wish.reason)
    with _aside(keeper, source, due):
        return keeper.save([(proposal.entry, proposal.base) for proposal in due], note)


def _proposal(keeper: Keeper, found: Candidate, wish: Wish, adding: tuple[str, str]) -> Proposal:
    entry, remarks = found.entry, list(found.remarks)
    base = keeper.registry.snapshot().paths.get(entry.path)
    standing = None
    if base is not None:
        try:
            standing = parse_entry(keeper.registry.repo.blob(base), entry.path)
        except InputError as error:
            remarks.append(f"what stands there cannot be read and is replaced: {error}")
    if standing is not None and standing.status is Status.HELD and not wish.override_held:
        why = f" ({standing.reason})" if standing.reason else ""
        raise RegistryError(
            f"{entry.id} is held{why}: a person pinned it; nothing was written. --override-held takes its place"
        )
    entry = _signed(_kept(entry, standing), standing, adding, edited=found.edited)
    if standing is not None:
        as_it_was = replace(entry, status=standing.status, reason=standing.reason)
        if not differences(standing, as_it_was) and (not wish.approve or standing.is_usable):
            return Proposal(entry=standing, standing=standing, base=base, changes=(), remarks=tuple(remarks))
    status = Status.APPROVED if wish.approve else Status.DRAFT
    entry = replace(entry, status=status, reason=wish.reason if wish.approve else None)
    if standing is not None and standing.is_usable and not wish.approve:
        remarks.append(
            f"it is {standing.status.value} now and becomes a draft, so no K of this camera is used until it is "
            "approved; --approve does that at once"
        )
    return Proposal(
        entry=entry,
        standing=standing,
        base=base,
        changes=differences(standing, entry),
        remarks=tuple(remarks),
    )


def _kept(entry: Entry, standing: Entry | None) -> Entry:
    """With what a registry knows of a camera and no calibration file says."""
    if standing is None:
        return entry
    extensions = {
        name: value
        for name, value in standing.extensions.items()
        if name.startswith(("x-", "camera/")) or (name.startswith("sensor/") and entry.sensor is None)
    }
    return replace(
        entry,
        aliases=entry.aliases or standing.aliases,
        sensor=entry.sensor or standing.sensor,
        tolerance=entry.tolerance if entry.tolerance is not None else standing.tolerance,
        supersedes=entry.supersedes or standing.supersedes,
        extensions={**extensions, **entry.extensions},
    )


def _signed(entry: Entry, standing: Entry | None, adding: tuple[str, str], *, edited: bool) -> Entry:
    """With its provenance complete: what the file does not say of the making is said of the adding."""
    made = entry.calibration.provenance
    operator, today = adding
    if edited and standing is not None and made == standing.calibration.provenance:
        if digest(entry.calibration, entry.sensor) != digest(standing.calibration, standing.sensor):
            by_hand = (*(text for text in made.assumptions if text != BY_HAND), BY_HAND)
            made = replace(made, assumptions=by_hand, date=today, operator=operator)
    elif made == UNSTATED:
        made = replace(made, kind="by-hand")
    if (
        standing is not None
        and made.sha256 is not None
        and made.sha256 == standing.calibration.provenance.sha256
    ):
        # The same file added again: who added it, and when, has not changed by that.
        before = standing.calibration.provenance
        said = {name: getattr(before, name) for name in OF_THE_ADDING if getattr(made, name) is None}
        made = replace(made, **said)
    made = replace(
        made,
        tool=made.tool or f"calibrary {version('calibrary')} registry add",
        date=made.date or today,
        operator=made.operator or operator,
    )
    return replace(entry, calibration=replace(entry.calibration, provenance=made))


def _refuse_same_place(proposals: Sequence[Proposal], source: str) -> None:
    seen: set[str] = set()
    for proposal in proposals:
        if proposal.entry.path in seen:
            raise InputError(
                f"holds several cameras that would all be {proposal.entry.id}; choose one with --camera N and say what "
                "tells it from the others: --sub-camera, --lens or --serial",
                source=source,
            )
        seen.add(proposal.entry.path)


@contextmanager
def _aside(keeper: Keeper, source: Path | None, due: Sequence[Proposal]) -> Iterator[None]:
    """Put the work tree's own file aside while the commit of what was edited in it takes its place."""
    repo = keeper.registry.repo
    own = next(
        (one for one in due if source is not None and source.resolve() == repo.path / one.entry.path), None
    )
    if source is None or own is None or repo.work_tree is None:
        yield
        return
    # Whoever is killed in between finds what was edited in git's own folder.
    edited, kept = source.read_bytes(), repo.git_dir / "calibrary-edited.yaml"
    kept.unlink(missing_ok=True)
    with kept.open("xb") as file:
        file.write(edited)
    if own.base is not None:
        source.write_bytes(repo.blob(own.base))
    else:
        source.unlink()
    try:
        yield
    except BaseException:
        source.write_bytes(edited)
        raise
    finally:
        with suppress(OSError):
            kept.unlink()
