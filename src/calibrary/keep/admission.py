"""What stands against entries that are about to be written: the registry's check, of them and what they touch."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from calibrary.keep.keeper import Keeper
from calibrary.registry.check import check
from calibrary.registry.entry import ROOT, SUFFIX, Entry, folder_of
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.validation import Finding, Severity

__all__ = ["objections", "stands_against"]


def objections(keeper: Keeper, entries: Sequence[Entry]) -> tuple[Finding, ...]:
    """What :func:`calibrary.registry.check.check` says of some entries once they are written.

    Only what they can meet is looked at: the entries of their models, of the names they claim, and those they
    supersede; what was wrong with others before is left to ``calibrary registry check``.
    """
    snapshot = keeper.registry.snapshot()
    repo = keeper.registry.repo
    before = {path: repo.blob(snapshot.paths[path]) for path in _concerned(snapshot.paths, entries)}
    after: Mapping[str, bytes] = {**before, **{entry.path: entry_yaml(entry) for entry in entries}}
    own = {entry.path for entry in entries}
    known = set(check(before, keeper.charter.policy).findings)
    found = check(after, keeper.charter.policy).findings
    return tuple(finding for finding in found if finding.place in own or finding not in known)


def stands_against(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Those that keep an entry from being written."""
    return tuple(finding for finding in findings if finding.severity is Severity.ERROR)


def _concerned(paths: Iterable[str], entries: Sequence[Entry]) -> Iterator[str]:
    whole, folders = set(), set()
    for entry in entries:
        camera = entry.calibration.camera
        folders.add(folder_of(camera.make or "", camera.model or ""))
        # Beside a unit's own folder stand those of thousands of others, which it never meets.
        folders.add(entry.path.rpartition("/")[0] + "/")
        folders.update(folder_of(alias.make, alias.model) for alias in entry.aliases)
        if entry.supersedes is not None:
            whole.add(f"{ROOT}{entry.supersedes}{SUFFIX}")
    for path in paths:
        if path in whole or path.rpartition("/")[0] + "/" in folders:
            yield path
