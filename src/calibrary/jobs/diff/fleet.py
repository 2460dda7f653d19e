"""Comparison of a whole fleet: all entries that changed since a revision, or between two firmware versions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Annotated, Final

from calibrary.calibration import CameraKey
from calibrary.errors import CalibraryError, InputError
from calibrary.jobs.diff.comparison import ChangeVerdict, DiffReport, compare
from calibrary.jobs.diff.verdicts import Kind
from calibrary.policy import FLEET, Policy
from calibrary.records import Meta, Record
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.firmware import compare as compare_versions
from calibrary.registry.paths import id_of
from calibrary.registry.registry import Registry

__all__ = ["EntryChange", "FleetDiffReport", "by_firmware", "entry_change", "since"]

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
    """

    changes: tuple[EntryChange, ...]

    @property
    def alarm(self) -> bool:
        """Whether any change needs attention."""
        return any(change.alarm for change in self.changes)


def since(
    registry: Registry, rev: str, policy: Policy = FLEET, progress: Counted | None = None
) -> FleetDiffReport:
    """All entries that differ from their state at a revision, worst first.

    Raises:
        RegistryError: the revision does not exist.
    """
    files = registry.changed(rev)
    blob = registry.repo.blob
    changes = []
    for done, file in enumerate(files, start=1):
        before = _parsed(file.path, partial(blob, file.before)) if file.before is not None else None
        after = _parsed(file.path, partial(blob, file.after)) if file.after is not None else None
        changes.append(_change(id_of(file.path), before, after, policy))
        if progress is not None:
            progress(done, len(files))
    return _worst_first(changes)


def by_firmware(
    registry: Registry, old: str, new: str, policy: Policy = FLEET, progress: Counted | None = None
) -> FleetDiffReport:
    """All cameras with calibrations for both firmware versions, in history or as two entries, worst first.

    Raises:
        InputError: a firmware is not a version number.
        RegistryError: the registry cannot be read.
    """
    compare_versions(old, new)
    cameras: dict[CameraKey, list[str]] = {}
    for stored in registry.snapshot().entries():
        cameras.setdefault(stored.entry.calibration.camera, []).append(stored.path)
    changes = []
    for done, paths in enumerate(cameras.values(), start=1):
        entries = [one.entry for path in paths for one in registry.revisions(path) if one.entry is not None]
        before = next((entry for entry in entries if _is_of(entry, old)), None)
        after = next((entry for entry in entries if _is_of(entry, new)), None)
        if before is not None and after is not None:
            changes.append(_change(id_of(paths[0]), before, after, policy))
        if progress is not None:
            progress(done, len(cameras))
    return _worst_first(changes)


def _change(id_: str, before: Entry | str | None, after: Entry | str | None, policy: Policy) -> EntryChange:
    reason, comparison = "new" if before is None else "removed", None
    if isinstance(before, str) or isinstance(after, str):
        reason = next(text for text in (before, after) if isinstance(text, str))
    elif before is not None and after is not None:
        labels = (f"{id_} before", f"{id_} after")
        try:
            comparison = compare(before.calibration, after.calibration, policy, labels=labels)
        except CalibraryError as error:
            reason = str(error)
    # What could not be compared needs attention; what is new or gone does not.
    alarm = isinstance(before, Entry) and isinstance(after, Entry)
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


def _parsed(path: str, load: Callable[[], bytes]) -> Entry | str:
    """The entry, or the reason why it cannot be read."""
    try:
        return parse_entry(load(), path)
    except InputError as error:
        return str(error)


def _is_of(entry: Entry, firmware: str) -> bool:
    made_with = entry.calibration.provenance.firmware
    try:
        if made_with is not None:
            return compare_versions(made_with, firmware) == 0
        return entry.firmware is not None and entry.firmware.holds(firmware)
    except InputError:
        return False


def _worst_first(changes: list[EntryChange]) -> FleetDiffReport:
    return FleetDiffReport(changes=tuple(sorted(changes, key=_badness)))


def _badness(change: EntryChange) -> tuple[bool, int, float, str]:
    if change.verdict is None:
        return not change.alarm, 0 if change.alarm else len(WORST_FIRST), 0.0, change.id
    size = abs(change.focal_change) if change.focal_change is not None else 1.0
    return not change.alarm, WORST_FIRST.index(change.verdict), -size, change.id
