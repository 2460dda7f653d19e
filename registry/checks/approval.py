"""Entries in use without the approvals that the registry asks for, and commits without a listed signature."""

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
    """Entries in use without the approvals that were asked for when they came to use."""
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
    """Entries that came to use without the approvals that the registry asks for."""
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
    """The commits that no person on the list signed, each with the reason; of all history, or after a revision.

    Args:
        snapshot: of the registry.
        signers: a file as of ssh-keygen(1), "ALLOWED SIGNERS"; without one only OpenPGP keys are known.
        before: the revision after which commits count; all of them when left out.
        after: the last revision; the snapshot's own when left out.

    Raises:
        RegistryError: the registry is a plain folder, or git cannot verify a signature.
    """
    repo, newest = snapshot.require_git("has no commits to be signed")
    end = commit_at(repo, parse_rev(after)) if after is not None else newest
    span = f"{commit_at(repo, parse_rev(before))}..{end}" if before is not None else end
    commits = [revision.commit for revision in history(repo, None, span)]
    return tuple(str(found) for found in signatures(repo, commits, signers) if not found.is_good)
