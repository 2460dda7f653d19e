"""Comparison of a whole fleet: all entries that changed since a revision, or between two firmware versions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Final

from calibrary.calibration import CameraKey
from calibrary.errors import CalibraryError, RegistryError
from calibrary.jobs.diff.comparison import ChangeVerdict, DiffReport, compare
from calibrary.jobs.diff.verdicts import Kind
from calibrary.pages.notebook import in_notebook
from calibrary.policy import FLEET, Policy
from calibrary.records import Meta, Record, replace
from calibrary.registry.entry import Entry
from calibrary.registry.firmware import compare as compare_versions
from calibrary.registry.git.history import changed
from calibrary.registry.paths import (
    CAMERAS,
    EVENTS,
    PROPOSED,
    file_path,
    id_of,
    is_entry,
    is_proposal,
    proposed_name,
)
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.statements import RULES, entry_path, subject_in

Counted = Callable[[int, int], None]
"""Called with the number done and the total."""

WORST_FIRST: Final = (
    ChangeVerdict.STRUCTURAL,
    ChangeVerdict.DRIFT,
    ChangeVerdict.UNRESOLVED,
    ChangeVerdict.NEGLIGIBLE,
    ChangeVerdict.NOISE,
    ChangeVerdict.IDENTICAL,
)


class EntryChange(Record, dict=True):
    """Change of one entry.

    Attributes:
        id: of the entry.
        verdict: null if there is nothing to compare with, or the two cannot be compared.
        alarm: whether the change needs attention.
        reasons: for the verdict, in sentences.
        advice: what to do; null if they were not compared.
        structural: structural changes.
        focal_change: relative change of fx or fy, whichever is larger.
        rms_px, max_px: RMS and maximum of the difference of the projections.
    """

    id: str
    verdict: ChangeVerdict | None
    alarm: bool
    reasons: Annotated[tuple[str, ...], Meta(min_length=1)]
    advice: str | None
    structural: tuple[Kind, ...]
    focal_change: float | None
    rms_px: Annotated[float, Meta(ge=0)] | None
    max_px: Annotated[float, Meta(ge=0)] | None

    @property
    def comparison(self) -> DiffReport | None:
        """The comparison in full, for the page; no part of the document."""
        found: DiffReport | None = self.__dict__.get("comparison")
        return found


class FleetDiffReport(Record, tag_field="schema", tag="calibrary/fleet-diff-1"):
    """Output of ``calibrary diff --since`` and ``--firmware`` with ``--json``.

    Attributes:
        changes: worst first.
        unmatched: why there was nothing to compare, with what there is; null if there was something.
    """

    changes: tuple[EntryChange, ...]
    unmatched: str | None = None

    @property
    def alarm(self) -> bool:
        """Whether any change needs attention, or there was nothing to compare."""
        return self.unmatched is not None or any(change.alarm for change in self.changes)

    def _repr_html_(self) -> str:
        """Return the changed entries, worst first, as HTML, for notebooks."""
        return in_notebook(self)


def since(
    registry: Registry, rev: str, policy: Policy = FLEET, progress: Counted | None = None
) -> FleetDiffReport:
    """All entries that differ from their state at a revision, worst first.

    A proposal that was added or changed since then is compared with the entry in use that it would replace.

    Raises:
        RegistryError: the revision does not exist.
    """
    now, then = registry.snapshot(), registry.snapshot(rev)
    names = _touched(now, then)
    changes = []
    for done, name in enumerate(names, start=1):
        before, after = (_known(snapshot, name) for snapshot in (then, now))
        if is_proposal(name):
            # One that is gone was withdrawn, or is an entry now, which is another change.
            if after is None or after == before:
                continue
            before = _known(now, file_path(name))
        if before != after:
            shown = f"{id_of(name)}{PROPOSED}" if is_proposal(name) else id_of(name)
            changes.append(_change(shown, before, after, policy))
        if progress is not None:
            progress(done, len(names))
    return _worst_first(changes)


def _touched(now: Snapshot, then: Snapshot) -> list[str]:
    """Return the names of what may differ between two states."""
    repo, commit = now.require_git("has no revisions")
    paths = {file.path for file in changed(repo, then.commit, commit, CAMERAS)}
    events = [file.path for file in changed(repo, then.commit, commit, EVENTS)]
    is_ruled = any(subject_in(path) == RULES for path in events)
    paths |= {*now.cameras, *then.cameras} if is_ruled else {*map(entry_path, events)}
    return sorted(name for path in paths if is_entry(path) for name in (path, proposed_name(path)))


def _known(snapshot: Snapshot, name: str) -> Entry | str | None:
    """Return an entry; None if there is none, or why it cannot be read."""
    try:
        stored = snapshot.at(name)
    except RegistryError as error:
        return str(error)
    return stored.entry if stored is not None else None


def by_firmware(
    registry: Registry, old: str, new: str, policy: Policy = FLEET, progress: Counted | None = None
) -> FleetDiffReport:
    """All cameras with calibrations for both firmware versions, in history or as two entries, worst first.

    A camera with a calibration for one of the two only is not compared; one with neither is left out.

    Args:
        registry: the registry, with its proposals.
        old: a version, or the beginning of its number.
        new: the same.
        policy: with the limits.
        progress: called with the number done and the total.

    Raises:
        InputError: a firmware is not a version number.
        RegistryError: the registry cannot be read.
    """
    compare_versions(old, new)
    now = registry.snapshot()
    cameras: dict[CameraKey, dict[str, None]] = {}
    proposed = {stored.path: stored for stored in now.proposals()}
    for stored in (*proposed.values(), *now.entries()):
        cameras.setdefault(stored.entry.calibration.camera, {})[stored.path] = None
    changes, there = [], set[str]()
    for done, paths in enumerate(cameras.values(), start=1):
        revisions = [(path, one.entry) for path in paths for one in registry.revisions(path)]
        entries = [(path, entry) for path, entry in revisions if entry is not None]
        of_it = list(dict.fromkeys(entry.made_for for _, entry in entries if entry.made_for is not None))
        there |= {*of_it}
        before = next((one for one in entries if one[1].is_of_firmware(old)), None)
        after = next((one for one in entries if one[1].is_of_firmware(new)), None)
        if before is not None and after is not None:
            waits = after[0] in proposed and proposed[after[0]].entry == after[1]
            shown = f"{id_of(after[0])}{PROPOSED if waits else ''}"
            changes.append(_change(shown, before[1], after[1], policy))
        elif before is not None or after is not None:
            lacking = new if after is None else old
            reason = f"it has no calibration of firmware {lacking}: there is {', '.join(of_it)}"
            changes.append(entry_change(id_of([*paths][-1]), None, reason=reason, alarm=True))
        if progress is not None:
            progress(done, len(cameras))
    known = f"there is {', '.join(sorted(there))}" if there else "no entry states a firmware"
    unmatched = f"no entry was made with firmware {old} or {new}: {known}" if not changes else None
    return replace(_worst_first(changes), unmatched=unmatched)


def _change(id_: str, before: Entry | str | None, after: Entry | str | None, policy: Policy) -> EntryChange:
    comparison, alarm = None, False
    if isinstance(before, str) or isinstance(after, str):
        # What could not be compared needs attention; what is new or gone does not.
        reason, alarm = next(text for text in (after, before) if isinstance(text, str)), True
    elif before is None or after is None:
        reason = "new" if before is None else "removed"
    else:
        labels = (f"{id_} before", f"{id_} after")
        try:
            comparison, reason = compare(before.calibration, after.calibration, policy, labels=labels), ""
        except CalibraryError as error:
            reason, alarm = str(error), True
    return entry_change(id_, comparison, reason=reason, alarm=alarm)


def entry_change(
    id_: str, comparison: DiffReport | None, *, reason: str = "", alarm: bool = False
) -> EntryChange:
    """Make the change of an entry; ``reason`` and ``alarm`` are for those that were not compared."""
    numbers = comparison.numbers if comparison is not None else None
    change = EntryChange(
        id=id_,
        verdict=comparison.verdict if comparison is not None else None,
        alarm=comparison.alarm if comparison is not None else alarm,
        reasons=comparison.reasons if comparison is not None else (reason,),
        advice=comparison.advice if comparison is not None else None,
        structural=tuple(one.kind for one in comparison.structural) if comparison is not None else (),
        focal_change=numbers.focal_change if numbers is not None else None,
        rms_px=numbers.projection.rms_px if numbers is not None else None,
        max_px=numbers.projection.max_px if numbers is not None else None,
    )
    change.__dict__["comparison"] = comparison
    return change


def _worst_first(changes: list[EntryChange]) -> FleetDiffReport:
    return FleetDiffReport(changes=tuple(sorted(changes, key=_badness)))


def _badness(change: EntryChange) -> tuple[bool, int, float, str]:
    if change.verdict is None:
        return not change.alarm, 0 if change.alarm else len(WORST_FIRST), 0.0, change.id
    size = abs(change.focal_change) if change.focal_change is not None else 1.0
    return not change.alarm, WORST_FIRST.index(change.verdict), -size, change.id
