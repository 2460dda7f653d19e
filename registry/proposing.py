"""Proposing of entries: comparison with the current ones, and checks; nothing is written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from msgspec import Struct

from calibrary.calibration import Provenance
from calibrary.errors import InputError
from calibrary.records import replace
from calibrary.registry.checks.entries import check
from calibrary.registry.contradictions import CONTRADICTIONS
from calibrary.registry.entry import Entry, Status
from calibrary.registry.entry_form import digest
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from calibrary.registry.fields import differences
from calibrary.registry.paths import ROOT, SUFFIX, folder_of, match_key, proposal_path
from calibrary.registry.proposals import Proposal, Proposals, proposal_of, require_not_held
from calibrary.registry.snapshot import Snapshot
from calibrary.validation import Finding, Severity

__all__ = ["CurrentFiles", "checked", "propose"]

BY_HAND: Final = "numbers changed by hand"
MOST_UNITS: Final = 8
"""Number of units whose K is compared with a new one if there is no entry for the model."""
BY_FLAGS: Final = ("tool", "date", "operator", "firmware", "focus")
"""Fields of the provenance that a command-line option can state if the file does not."""


def propose(
    snapshot: Snapshot,
    entries: Sequence[Entry],
    *,
    approve: bool = False,
    reason: str | None = None,
    override_held: bool = False,
    edited: bool = False,
    force: str | None = None,
) -> Proposals:
    """Propose entries, with their changes and findings; nothing is written.

    Args:
        snapshot: newest state of the registry.
        entries: entries as stated by their source and the user; their status is set here.
        approve: approve them at once; otherwise they are drafts.
        reason: reason for the approval.
        override_held: replace entries that are held.
        edited: whether they are current entries edited by a person.
        force: reason for accepting a K that contradicts known facts about its camera.

    Raises:
        InputError: two of the entries have the same path.
        RegistryError: a current entry is held and ``override_held`` is false.
    """
    seen: set[str] = set()
    items = []
    for entry in entries:
        if entry.path in seen:
            raise InputError(
                f"several of the cameras would all be {entry.id}; distinguish them by sub-camera, lens or serial"
            )
        seen.add(entry.path)
        items.append(_proposal(snapshot, entry, approve, reason, override_held=override_held, edited=edited))
    return checked(snapshot, items, force=force)


def checked(
    snapshot: Snapshot,
    items: Sequence[Proposal],
    verb: str | None = None,
    *,
    force: str | None = None,
    only_new: bool = False,
) -> Proposals:
    """Add to proposals the findings of :func:`calibrary.registry.checks.entries.check` on everything to be written.

    Only entries that they can affect are read: those of their models and aliases, and those they supersede. Earlier
    errors of other entries are left to ``calibrary registry check``; with ``only_new``, earlier errors of these
    entries as well: an error in K does not prevent setting a label.
    """
    due = [one for one in items if one.changes]
    if not due:
        return Proposals(items=tuple(items), verb=verb)
    policy = snapshot.configuration.policy
    concerned = {*_concerned(snapshot.paths, [one.entry for one in due]), *_called_alike(snapshot, due)}
    before = {path: snapshot.read(path) for path in concerned}
    if only_new:
        before |= {one.path: snapshot.read(one.path) for one in due if one.base is not None}
    own = {one.path: one.data for one in due if one.data is not None}
    gone = {path for one in due for path, _ in one.replaced}
    former = {one.entry.path: one.current for one in due if one.current is not None}
    known = set(check(before, policy).findings) if before else set()
    left = {path: data for path, data in before.items() if path not in gone}
    found = check({**left, **own}, policy, former).findings
    findings = tuple(
        finding for finding in found if finding not in known or (finding.place in own and not only_new)
    )
    if force is not None and (contradicted := _contradicted(findings)):
        forced = [_forced(one, force) if one.path in contradicted else one for one in items]
        return checked(snapshot, forced, verb)
    return Proposals(items=tuple(items), findings=findings, verb=verb)


def _called_alike(snapshot: Snapshot, due: Sequence[Proposal]) -> Iterator[str]:
    """Yield the usable entries of any camera with the same label as one to be written."""
    labels = {match_key(one.entry.label) for one in due if one.entry.label is not None}
    if labels:
        labelled = snapshot.labels.items()
        yield from (path for path, label in labelled if match_key(label) in labels and path in snapshot.paths)


def _contradicted(findings: Sequence[Finding]) -> set[str | None]:
    return {
        finding.place
        for finding in findings
        if finding.severity is Severity.ERROR and finding.rule in CONTRADICTIONS
    }


def _forced(one: Proposal, why: str) -> Proposal:
    entry = replace(one.entry, override=why)
    return replace(one, entry=entry, data=entry_yaml(entry), changes=differences(one.current, entry))


def _concerned(paths: Iterable[str], entries: Sequence[Entry]) -> Iterator[str]:
    whole, folders = set(), set()
    for entry in entries:
        camera = entry.calibration.camera
        folders.add(folder_of(camera.make or "", camera.model or ""))
        # The folder of a unit, without those of thousands of other units, which it cannot affect.
        folders.add(entry.path.rpartition("/")[0] + "/")
        folders.update(folder_of(alias.make, alias.model) for alias in entry.aliases)
        if entry.supersedes is not None:
            whole.add(f"{ROOT}{entry.supersedes}{SUFFIX}")
    units: list[str] = []
    has_relative = False
    own = {entry.path for entry in entries}
    for path in paths:
        if path in whole or path.rpartition("/")[0] + "/" in folders:
            has_relative = has_relative or path not in own
            yield path
        elif len(units) < MOST_UNITS and path.rpartition("/sn-")[0] + "/" in folders:
            units.append(path)
    if not has_relative:
        yield from units


def _proposal(
    snapshot: Snapshot,
    entry: Entry,
    approve: bool,  # noqa: FBT001  passed through from propose()
    reason: str | None,
    *,
    override_held: bool,
    edited: bool,
) -> Proposal:
    here = CurrentFiles.of(snapshot, entry.path)
    current, warnings = here.current, [*here.warnings]
    if not override_held:
        require_not_held(current, ". --override-held replaces it")
    for known in (here.proposed, current):
        if known is not None:
            entry = _with_current(entry, known, edited=edited)
    entry = replace(entry, label=entry.label or snapshot.label_of(entry.unit))
    for known, path, oid in ((current, entry.path, here.oid), (here.proposed, here.path, here.proposed_oid)):
        if known is None:
            continue
        unchanged = replace(entry, status=known.status, reason=known.reason)
        if not differences(known, unchanged) and (not approve or known.is_usable):
            return proposal_of(known, known, oid, warnings, path=path)
    if approve:
        return _approved_at_once(entry, here, reason, warnings)
    before = current if current is not None else here.proposed
    if current is not None and current.is_usable:
        warnings.append(f"what is {current.status.value} now stays in use until this is approved")
    if here.proposed is not None:
        warnings.append("it takes the place of an earlier proposal")
    draft = replace(entry, status=Status.DRAFT, reason=None)
    is_draft = current is not None and current.status is Status.DRAFT
    gone = ((entry.path, here.oid),) if is_draft and here.oid is not None else ()
    return proposal_of(draft, before, here.proposed_oid, warnings, path=here.path, replaced=gone)


def _approved_at_once(entry: Entry, here: CurrentFiles, reason: str | None, warnings: list[str]) -> Proposal:
    approved = replace(entry, status=Status.APPROVED, reason=reason)
    before = here.current if here.current is not None else here.proposed
    gone: tuple[tuple[str, str], ...] = ()
    if here.proposed is not None and here.proposed_oid is not None:
        if differences(here.proposed, replace(entry, status=Status.DRAFT, reason=None)):
            warnings.append(f"another K is proposed for it and goes on waiting: {here.path}")
        else:
            gone = ((here.path, here.proposed_oid),)
    return proposal_of(approved, before, here.oid, warnings, replaced=gone)


class CurrentFiles(Struct, frozen=True, kw_only=True):
    """The current entry of one camera, and the proposal for it.

    Attributes:
        path: path of the proposal, whether or not it exists.
        current, oid: entry and file id in ``cameras/``; None if there is none (the entry also if it cannot be read).
        proposed, proposed_oid: the same in ``proposals/``.
        warnings: errors of entries that cannot be read.
    """

    path: str
    current: Entry | None
    oid: str | None
    proposed: Entry | None
    proposed_oid: str | None
    warnings: tuple[str, ...]

    @classmethod
    def of(cls, snapshot: Snapshot, path: str) -> CurrentFiles:
        """Read the current files of an entry, given its path in ``cameras/``."""
        beside = proposal_path(path)
        oids = snapshot.paths.get(path), snapshot.proposed.get(beside)
        read: list[Entry | None] = []
        warnings = []
        for oid, place, what in ((oids[0], path, "entry"), (oids[1], beside, "proposal")):
            try:
                read.append(parse_entry(snapshot.read(place), place) if oid is not None else None)
            except InputError as error:
                read.append(None)
                warnings.append(f"the current {what} cannot be read and is replaced: {error}")
        return cls(
            path=beside,
            current=read[0],
            oid=oids[0],
            proposed=read[1],
            proposed_oid=oids[1],
            warnings=tuple(warnings),
        )


def _with_current(entry: Entry, current: Entry, *, edited: bool) -> Entry:
    """Add what the registry knows about the camera and a calibration file does not state."""
    extensions = {
        name: value
        for name, value in current.extensions.items()
        if name.startswith(("x-", "camera/")) or (name.startswith("sensor/") and entry.sensor is None)
    }
    made = _provenance(entry, current, edited=edited)
    return replace(
        entry,
        calibration=replace(entry.calibration, provenance=made),
        aliases=entry.aliases or current.aliases,
        sensor=entry.sensor or current.sensor,
        tolerance=entry.tolerance if entry.tolerance is not None else current.tolerance,
        supersedes=entry.supersedes or current.supersedes,
        label=entry.label or current.label,
        tags=entry.tags or current.tags,
        extensions={**extensions, **entry.extensions},
    )


def _provenance(entry: Entry, current: Entry, *, edited: bool) -> Provenance:
    made, before = entry.calibration.provenance, current.calibration.provenance
    if edited and _source(made) == _source(before):
        if digest(entry.calibration, entry.sensor, entry.rig) == digest(
            current.calibration, current.sensor, current.rig
        ):
            return made
        by_hand = (*(text for text in made.assumptions if text != BY_HAND), BY_HAND)
        return replace(made, assumptions=by_hand)
    if made.sha256 is not None and made.sha256 == before.sha256:
        # The same file again: what an option stated earlier still applies.
        return replace(made, **{name: getattr(made, name) or getattr(before, name) for name in BY_FLAGS})
    return made


def _source(made: Provenance) -> tuple[object, ...]:
    return made.kind, made.source, made.sha256, made.sources
