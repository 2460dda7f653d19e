"""Checks for usable entries without the required approvals, and for commits without a listed signature."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from calibrary.records import replace
from calibrary.registry.approvals import all_said, came_to_use, digest_as_proposed, unmet
from calibrary.registry.checks.files import readable_entries
from calibrary.registry.checks.findings import finding_of
from calibrary.registry.configuration import Configuration, configuration_at
from calibrary.registry.entry import Entry
from calibrary.registry.git.history import commit_at, history, parse_rev
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.signatures import signatures
from calibrary.registry.paths import is_proposal
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.stored import StoredEntry
from calibrary.validation import Finding

__all__ = ["check_signatures", "never_approved", "unapproved"]


def never_approved(snapshot: Snapshot, repo: Repository, commit: str) -> Iterator[Finding]:
    """Find usable entries without the approvals that were required when they became usable."""
    rule = snapshot.configuration.approvals
    if rule is None:
        return
    said = all_said(repo, commit)
    for stored in snapshot.entries(unreadable=lambda _: None):
        digest = digest_as_proposed(stored.entry)
        if not stored.entry.is_usable or unmet(repo, stored, rule, said.get(digest, ())) is None:
            continue
        first = came_to_use(repo, stored)
        base = first.parents[0] if first is not None and first.parents else None
        then = configuration_at(repo, base).approvals if base is not None else rule
        lacking = unmet(repo, stored, then, said.get(digest, ())) if then is not None else None
        if lacking is not None:
            yield _lacking_approvals(stored.path, stored.entry, lacking)


def _lacking_approvals(path: str, entry: Entry, lacking: str) -> Finding:
    return replace(
        finding_of(path, "approval", f"is {entry.status.value} with {lacking}"),
        remedy="'calibrary registry approve KEY' records an approval; a status written by hand does not",
    )


def unapproved(
    repo: Repository,
    end: str,
    listed: Mapping[str, str],
    own: Collection[str],
    former: Mapping[str, Entry],
    rules: Configuration,
) -> Iterator[Finding]:
    """Find entries that became usable without the required approvals."""
    if rules.approvals is None:
        return
    paths = sorted(path for path in own if not is_proposal(path))
    for path, entry in readable_entries(repo, listed, paths):
        was = former.get(path)
        if not entry.is_usable or (
            was is not None and was.is_usable and digest_as_proposed(was) == digest_as_proposed(entry)
        ):
            continue
        lacking = unmet(
            repo, StoredEntry(entry=entry, path=path, oid=listed[path], commit=end), rules.approvals
        )
        if lacking is not None:
            yield _lacking_approvals(path, entry, lacking)


def check_signatures(
    snapshot: Snapshot, signers: Path | None, *, before: str | None = None, after: str | None = None
) -> tuple[str, ...]:
    """Return the commits without a signature of a listed person, each with the reason.

    Args:
        snapshot: state of the registry.
        signers: an "ALLOWED SIGNERS" file of ssh-keygen(1); without it only OpenPGP keys can be verified.
        before: revision after which commits are checked; by default all.
        after: last revision; by default that of the snapshot.

    Raises:
        RegistryError: the registry is a plain folder, or git cannot verify a signature.
    """
    repo, newest = snapshot.require_git("has no commits to be signed")
    end = commit_at(repo, parse_rev(after)) if after is not None else newest
    span = f"{commit_at(repo, parse_rev(before))}..{end}" if before is not None else end
    commits = [revision.commit for revision in history(repo, None, span)]
    return tuple(str(found) for found in signatures(repo, commits, signers) if not found.is_good)
