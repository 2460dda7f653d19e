"""Comparison of a whole fleet: all entries that changed since a revision, or between two firmware versions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

from msgspec import Struct

from calibrary.arguments import PolicyLike
from calibrary.calibration import CameraKey
from calibrary.errors import CalibraryError, InputError
from calibrary.jobs.diff.comparison import ChangeVerdict, Comparison, compare
from calibrary.policy import FLEET, Policy
from calibrary.policy_file import policy_of
from calibrary.progress import Progress, labelled
from calibrary.records import Json, to_json
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.firmware import compare as compare_versions
from calibrary.registry.paths import id_of
from calibrary.registry.registry import Registry

__all__ = ["Change", "FleetChanges", "by_firmware", "fleet_by_firmware", "fleet_since", "since"]

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


class Change(Struct, frozen=True, kw_only=True):
    """Change of one entry of the fleet.

    Attributes:
        id: of the entry.
        before, after: the calibrations; None if the entry did not exist or no longer exists.
        comparison: of the two; None if one is missing or they cannot be compared.
        reason: why there is no comparison, in words.
    """

    id: str
    before: Entry | None
    after: Entry | None
    comparison: Comparison | None = None
    reason: str | None = None

    @property
    def alarm(self) -> bool:
        """Whether the change needs attention."""
        if self.comparison is not None:
            return self.comparison.alarm
        return self.before is not None and self.after is not None


def since(
    registry: Registry, rev: str, policy: Policy = FLEET, progress: Counted | None = None
) -> tuple[Change, ...]:
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
) -> tuple[Change, ...]:
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


def _change(id_: str, before: Entry | str | None, after: Entry | str | None, policy: Policy) -> Change:
    if isinstance(before, str) or isinstance(after, str):
        why = next(text for text in (before, after) if isinstance(text, str))
        return Change(
            id=id_,
            before=None if isinstance(before, str) else before,
            after=None if isinstance(after, str) else after,
            reason=why,
        )
    if before is None or after is None:
        return Change(id=id_, before=before, after=after, reason="new" if before is None else "removed")
    try:
        comparison = compare(before.calibration, after.calibration, policy)
    except CalibraryError as error:
        return Change(id=id_, before=before, after=after, reason=str(error))
    return Change(id=id_, before=before, after=after, comparison=comparison)


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


def _worst_first(changes: list[Change]) -> tuple[Change, ...]:
    return tuple(sorted(changes, key=_badness))


def _badness(change: Change) -> tuple[bool, int, float, str]:
    comparison = change.comparison
    if comparison is None:
        return not change.alarm, 0 if change.alarm else len(WORST_FIRST), 0.0, change.id
    size = abs(comparison.numbers.focal_change) if comparison.numbers is not None else 1.0
    return not change.alarm, WORST_FIRST.index(comparison.verdict), -size, change.id


class FleetChanges(Struct, frozen=True, eq=False):
    """Changes between two states of a registry.

    Attributes:
        changes: change of each entry that differs, worst first.
        title: description of the two states.
    """

    changes: tuple[Change, ...]
    title: str

    @property
    def alarm(self) -> bool:
        """Whether any change needs attention."""
        return any(change.alarm for change in self.changes)

    def to_html(self, *, altitude_m: float = 100.0) -> str:
        """Return the changes as a page; for ``altitude_m`` see :meth:`CompareResult.to_dict`."""
        from calibrary.jobs.diff.page import fleet_page  # noqa: PLC0415  only who wants a page
        from calibrary.pages import render_page  # noqa: PLC0415  as above

        return render_page(fleet_page(self.changes, self.title, altitude_m))

    def to_dict(self) -> dict[str, Json]:
        """Return the changes as plain data for JSON (schemas/fleet-diff-1.schema.json)."""
        from calibrary.jobs.diff.report import fleet_diff_report  # noqa: PLC0415  it imports this module

        return to_json(fleet_diff_report(self.changes))


def fleet_since(registry: Registry, rev: str, policy: PolicyLike, progress: Progress | None) -> FleetChanges:
    """Do the work of :meth:`calibrary.Fleet.changes_since`."""
    changes = since(registry, rev, policy_of(policy), labelled(progress, "entries"))
    return FleetChanges(changes, f"The fleet since {rev}")


def fleet_by_firmware(
    registry: Registry, old: str, new: str, policy: PolicyLike, progress: Progress | None
) -> FleetChanges:
    """Do the work of :meth:`calibrary.Fleet.changes_of_firmware`."""
    changes = by_firmware(registry, old, new, policy_of(policy), labelled(progress, "entries"))
    return FleetChanges(changes, f"The fleet from firmware {old} to {new}")
