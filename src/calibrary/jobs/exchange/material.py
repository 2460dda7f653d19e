"""Findings on changes of an approved K that would affect a map.

The registry check detects a focal length that contradicts the approved one. This module detects smaller
changes: a principal point or distortion that moves projections by more than the policy's limits.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from calibrary.errors import CalibraryError, InputError, RegistryError
from calibrary.jobs.diff.wording import length, pixels
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.entry_checks import Checked, CheckReport
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.history import changed
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import CAMERAS, PROPOSALS, in_use_path
from calibrary.registry.snapshot import Snapshot
from calibrary.validation import Finding, Severity

if TYPE_CHECKING:
    from calibrary.registry.proposals import Proposals

__all__ = ["require_reason", "with_material_changes", "with_material_changes_of_range"]

MATERIAL: Final = "material-change"
ALTITUDE_M: Final = 100.0
Change = tuple[str, Entry, Entry]
"""Path of an entry, the entry in use before, and the new one."""


def with_material_changes(proposals: Proposals, policy: Policy) -> Proposals:
    """Add a finding to each proposal that changes an approved K by more than the policy's limits."""
    due = [(one.path, one.current, one.entry) for one in proposals.due if one.current is not None]
    found = tuple(_material(due, policy))
    return replace(proposals, findings=(*proposals.findings, *found)) if found else proposals


def require_reason(proposals: Proposals, reason: str | None) -> None:
    """Require a reason for a change of an approved K by more than the policy's limits.

    Raises:
        RegistryError: no reason is given.
    """
    used = {one.path: one.entry.reason for one in proposals.due if one.entry.is_usable}
    for finding in proposals.findings:
        if finding.rule == MATERIAL and not (reason or used.get(finding.place or "", "proposed")):
            raise RegistryError(
                f"nothing was written: {finding.place} {finding.message}; say why with --reason TEXT"
            )


def with_material_changes_of_range(done: Checked, snapshot: Snapshot, policy: Policy) -> Checked:
    """Add such findings for the changes between two commits."""
    if done.before is None or done.commit is None or snapshot.repo is None:
        return done
    found = tuple(_material(_of_range(snapshot.repo, done.before, done.commit), policy))
    report = CheckReport(entries=done.report.entries, findings=(*done.report.findings, *found))
    return replace(done, report=report) if found else done


def _material(changes: Iterable[Change], policy: Policy) -> Iterator[Finding]:
    # Loading takes 0.1 s, and most changes do not affect a K.
    from calibrary.jobs.diff.comparison import compare  # noqa: PLC0415  the reason above

    for path, before, after in changes:
        one, other = before.calibration, after.calibration
        same = (one.intrinsics, one.distortion) == (other.intrinsics, other.distortion)
        if same or not before.is_usable or one.camera.image_size != other.camera.image_size:
            continue
        with suppress(CalibraryError):
            found = compare(one, other, policy, altitude_m=ALTITUDE_M)
            if found.numbers is None or not found.numbers.matters:
                continue
            seen, ground = found.numbers.projection, found.numbers.ground
            yield Finding(
                rule=MATERIAL,
                severity=Severity.WARNING,
                place=path,
                measured=seen.max_px,
                limit=policy.drift_max_px,
                message=f"differs from the K that is {before.status.value} by {pixels(seen.rms_px)} rms and "
                f"{pixels(seen.max_px)} at most over the frame, from {ALTITUDE_M:g} m "
                f"{length(ground.max_cm / 100)} on the ground ({found.verdict.value})",
                remedy="approve it with --reason TEXT if the camera has changed, or was measured better",
            )


def _of_range(repo: Repository, start: str, end: str) -> Iterator[Change]:
    for folder in (CAMERAS, PROPOSALS):
        for file in changed(repo, start, end, folder):
            base = repo.read(start, in_use_path(file.path))
            if file.after is None or base is None:
                continue
            with suppress(InputError):
                before = parse_entry(base.data, in_use_path(file.path))
                yield file.path, before, parse_entry(repo.blob(file.after), file.path)
