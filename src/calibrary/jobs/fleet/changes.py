"""Changes of a registry: proposals before they are written.

Each K is weighed against what is known of its camera, and compared with the one that it replaces: a principal point or
a distortion may move projections by more than the policy's limits.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from msgspec import Struct

from calibrary.arguments import Terms
from calibrary.errors import CalibraryError, ConflictError, InputError, RegistryError
from calibrary.jobs.diff.comparison import DiffReport
from calibrary.jobs.diff.wording import length, pixels
from calibrary.jobs.survey.known import BY_LAST_APPROVED, contradictions
from calibrary.policy import Policy
from calibrary.records import Json, replace, to_json
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.fields import FieldChange, differences
from calibrary.registry.git.errors import FileConflictError
from calibrary.registry.git.history import changed
from calibrary.registry.paths import CAMERAS, EVENTS, is_entry, proposed_name
from calibrary.registry.proposals import FREELY, ChangeReport, Proposals, Saved, change_report, judged, save
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.statements import entry_path
from calibrary.validation import Finding, Severity

if TYPE_CHECKING:
    from calibrary.registry.checks import CheckDocument


MATERIAL: Final = "material-change"
ALTITUDE_M: Final = 100.0
Change = tuple[str, Entry, Entry]
"""Path of an entry, the entry in use before, and the new one."""


class ProposedChange(Struct, eq=False):
    """Proposed entries with their checks; nothing is written before :meth:`write`.

    Attributes:
        registry: registry to write to.
        proposals: each entry with its changes, and the findings of the check.
        terms: why, for the history, and the branch to write to.
        source: file that the entries were read from.
        written: the commit, after writing.
        comparisons: effect of each change of a K, by the path of the entry, where the two can be compared.
    """

    registry: Registry
    proposals: Proposals
    terms: Terms = FREELY
    source: Path | None = None
    written: Saved | None = None
    comparisons: Mapping[str, DiffReport] = MappingProxyType({})

    def __post_init__(self) -> None:
        """Weigh each K, compare it with the one that it replaces, and find what exceeds the policy's limits."""
        snapshot = self.registry.branch(self.terms.branch)
        self.proposals = judged(snapshot, self.proposals, contradictions, self.terms.override)
        self.proposals, self.comparisons = _with_material_changes(self.proposals, snapshot.policy)

    def write(self) -> Saved:
        """Write the change as one commit.

        Raises:
            FileConflictError: an entry was changed since it was proposed; nothing was written.
            RegistryError: a check failed, there is nothing to write, the registry cannot be written, or an approved K
                changes by more than the policy's limits and no reason is given.
        """
        _require_reason(self.proposals, self.terms.reason)
        with (
            nullcontext()
            if self.source is None
            else _in_its_place(self.registry, self.source, self.proposals)
        ):
            self.written = save(self.registry, self.proposals, self.terms)
        return self.written

    @property
    def report(self) -> ChangeReport:
        """What was written, or would be; the form of ``--json``."""
        return change_report(self.registry.repo.path, self.proposals, self.written)

    def to_dict(self) -> dict[str, Json]:
        """Return the report as plain data for JSON (schemas/registry-change-1.schema.json)."""
        return to_json(self.report)


def conflict_changes(error: ConflictError) -> dict[str, tuple[FieldChange, ...]]:
    """Return, by path, the fields in which the entry to write differs from another writer's version."""
    found: dict[str, tuple[FieldChange, ...]] = {}
    if not isinstance(error, FileConflictError):
        return found
    for conflict in error.conflicts:
        if conflict.theirs is None or conflict.ours is None:
            continue
        try:
            theirs, ours = (
                parse_entry(data, conflict.path, require_digest=False)
                for data in (conflict.theirs, conflict.ours)
            )
        except InputError:
            continue
        found[conflict.path] = differences(theirs, ours)
    return found


@contextmanager
def _in_its_place(registry: Registry, source: Path, proposals: Proposals) -> Iterator[None]:
    """While the commit is written, replace an entry that was edited in the work tree by the current one.

    The commit then replaces the edit; if it fails, the edit is restored.
    """
    repo, here = registry.repo, source.resolve()
    path = next((one.path for one in proposals.due if here == repo.path / one.path), None)
    tip = repo.tip()
    if path is None or repo.work_tree is None or tip is None:
        yield
        return
    # If the process is killed meanwhile, the edit can be found in the .git folder.
    edited, kept = source.read_bytes(), repo.git_dir / "calibrary-edited.yaml"
    kept.unlink(missing_ok=True)
    with kept.open("xb") as file:
        file.write(edited)
    committed = repo.read(tip, path)
    if committed is not None:
        source.write_bytes(committed.data)
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


def weighed(snapshot: Snapshot, proposals: Proposals, policy: Policy) -> Proposals:
    """Add a finding to each proposal whose K contradicts what is known, or changes what is approved materially."""
    return _with_material_changes(judged(snapshot, proposals, contradictions), policy)[0]


def _with_material_changes(proposals: Proposals, policy: Policy) -> tuple[Proposals, dict[str, DiffReport]]:
    changes = [(one.path, one.before, one.after) for one in proposals.due if one.before is not None]
    compared = _compared(changes, policy)
    said = {
        one.place
        for one in proposals.findings
        if one.rule == BY_LAST_APPROVED and one.severity is Severity.ERROR
    }
    found = _material([one for one in changes if one[0] not in said], compared, policy)
    return replace(proposals, findings=(*proposals.findings, *found)), compared


def _require_reason(proposals: Proposals, reason: str | None) -> None:
    """Require a reason for a change of an approved K by more than the policy's limits.

    Raises:
        RegistryError: no reason is given.
    """
    used = {one.path: one.after.reason for one in proposals.due if one.after.is_usable}
    for finding in proposals.findings:
        if finding.rule == MATERIAL and not (reason or used.get(finding.place or "", "proposed")):
            raise RegistryError(
                f"nothing was written: {finding.place} {finding.message}; say why with --reason TEXT"
            )


def with_material_changes_of_range(done: CheckDocument, snapshot: Snapshot, policy: Policy) -> CheckDocument:
    """Add such findings for the changes between two commits."""
    if done.before is None or done.commit is None or snapshot.repo is None:
        return done
    changes = tuple(_of_range(replace(snapshot, commit=done.before), replace(snapshot, commit=done.commit)))
    found = _material(changes, _compared(changes, policy), policy)
    return replace(done, findings=(*done.findings, *found))


def _compared(changes: Sequence[Change], policy: Policy) -> dict[str, DiffReport]:
    """Compare the calibrations before and after; those that differ in more than notes, and can be compared."""
    # Loading takes 0.1 s, and most changes do not affect a K.
    from calibrary.jobs.diff.comparison import compare  # noqa: PLC0415  the reason above

    found = {}
    for path, before, after in changes:
        one, other = (replace(entry.calibration, notes=()) for entry in (before, after))
        if one != other:
            with suppress(CalibraryError):
                found[path] = compare(one, other, policy, altitude_m=ALTITUDE_M)
    return found


def _material(
    changes: Sequence[Change], compared: Mapping[str, DiffReport], policy: Policy
) -> Iterator[Finding]:
    for path, before, after in changes:
        found, sizes = compared.get(path), {one.calibration.intrinsics.image_size for one in (before, after)}
        if found is None or not before.is_usable or len(sizes) > 1:
            continue
        if found.numbers is not None and found.numbers.matters:
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


def _of_range(start: Snapshot, end: Snapshot) -> Iterator[Change]:
    """Yield what is in force or proposed after a range, beside what was in force before it."""
    repo, commit = end.require_git("has no revisions")
    touched = {file.path for file in changed(repo, start.commit, commit, CAMERAS)}
    for file in changed(repo, start.commit, commit, EVENTS):
        touched.add(entry_path(file.path))
    for path in sorted(touched):
        # What is no entry, or too large to be one, is reported by the check.
        with suppress(RegistryError):
            if is_entry(path) and (before := start.at(path)) is not None and before.entry.is_usable:
                names = (path, proposed_name(path))
                yield from (
                    (path, before.entry, after.entry) for name in names if (after := end.at(name)) is not None
                )
