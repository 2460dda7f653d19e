"""Approvals of an entry, read from the commits that record them, and compared with the registry's rules.

A commit that approves an entry states the approved content in a trailer: git's id of the entry's file as it was
proposed, which does not depend on the status and its reason. The approval counts for the commit's author; if the
registry lists keys, for the owner of the key that signed it. None of this is in the entry's file, which anyone could
edit.
"""

from __future__ import annotations

import base64
import hashlib
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from calibrary.records import replace
from calibrary.registry.configuration import KEY, ApprovalRule
from calibrary.registry.entry import Entry, Status
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.history import Revision, signatures
from calibrary.registry.git.history import history as git_history
from calibrary.registry.git.objects import blob_id
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import Person
from calibrary.registry.history import Approval, of_path, origin
from calibrary.registry.stored import StoredEntry
from calibrary.registry.writing import APPROVED_DIGEST

__all__ = [
    "approvals_of",
    "approving_commits_by_digest",
    "digest_as_proposed",
    "first_usable",
    "missing_approvals",
    "missing_approvals_with",
    "unsigned_here",
]


def digest_as_proposed(entry: Entry) -> str:
    """Return the id of an entry's file as it was proposed, without the fields that an approval does not cover.

    Label, tags and notes are not covered, since they may change without a review of K. Everything that decides which K
    is used for which image is covered: the calibration, its camera, days, firmware, tolerance and aliases.
    """
    plain = replace(entry.calibration, notes=())
    return blob_id(
        entry_yaml(replace(entry, calibration=plain, status=Status.DRAFT, reason=None, label=None, tags=()))
    )


def approvals_of(repo: Repository, stored: StoredEntry) -> tuple[Approval, ...]:
    """Return the approvals of a usable entry, oldest first; for older entries, the commit that made it usable.

    Raises:
        RegistryError: the history cannot be read.
    """
    if stored.commit is None or not stored.entry.is_usable:
        return ()
    approving = _approving_commits(repo, stored.entry, stored.commit)
    if approving:
        return tuple(map(_approval, approving))
    first = first_usable(repo, stored)
    return (_approval(first),) if first is not None and first.commit not in repo.shallow_commits else ()


def missing_approvals(
    repo: Repository, stored: StoredEntry, rule: ApprovalRule, approving: Sequence[Revision] | None = None
) -> str | None:
    """Return which required approvals a usable entry lacks; None if it has all of them.

    ``approving`` are the commits that approve it, if already known from :func:`approving_commits_by_digest`.
    """
    if stored.commit is None:
        return None
    approving = _approving_commits(repo, stored.entry, stored.commit) if approving is None else approving
    lacking = _lacking(rule, _counted(repo, stored, rule, approving))
    return f"{lacking}{repo.unshallow_hint}" if lacking is not None else None


def missing_approvals_with(
    repo: Repository, stored: StoredEntry, rule: ApprovalRule, person: Person
) -> str | None:
    """Return the same for a proposal, assuming that ``person`` also approves it."""
    if stored.commit is None:
        return None
    counted = _counted(repo, stored, rule, _approving_commits(repo, stored.entry, stored.commit))
    if refused := _refused(repo, stored, rule, person):
        return refused
    return _lacking(rule, counted | {person.email.lower()})


def _approving_commits(repo: Repository, entry: Entry, at: str) -> list[Revision]:
    """Return the commits that approve an entry, oldest first, one per person."""
    trailer = f"{APPROVED_DIGEST}: {digest_as_proposed(entry)}"
    found: dict[str, Revision] = {}
    for revision in reversed(git_history(repo, None, at, saying=trailer)):
        if tuple(trailer.split(": ")) in revision.trailers:
            found.setdefault(revision.author.email.lower(), revision)
    return [*found.values()]


def approving_commits_by_digest(repo: Repository, at: str) -> Mapping[str, list[Revision]]:
    """Return all commits with approvals, by the approved digest, as :func:`missing_approvals` takes them."""
    found: dict[str, dict[str, Revision]] = {}
    for revision in reversed(git_history(repo, None, at, saying=f"{APPROVED_DIGEST}: ")):
        for name, digest in revision.trailers:
            if name == APPROVED_DIGEST:
                found.setdefault(digest, {}).setdefault(revision.author.email.lower(), revision)
    return {digest: [*people.values()] for digest, people in found.items()}


def first_usable(repo: Repository, stored: StoredEntry) -> Revision | None:
    """Return the commit that made the current content of an entry usable."""
    digest, found = digest_as_proposed(stored.entry), None
    for one in of_path(repo, stored.commit or "", stored.path):
        if one.entry is None or not one.entry.is_usable or digest_as_proposed(one.entry) != digest:
            break
        found = one.revision
    return found


def unsigned_here(repo: Repository, rule: ApprovalRule) -> str | None:
    """Return why a commit made here would not be signed with an accepted key; None if it would."""
    if not rule.is_signed:
        return None
    wanted = "registry.yaml counts approvals only in commits that are signed with a key it lists"
    if (repo.setting("commit.gpgsign") or "").lower() not in {"true", "yes", "on", "1"}:
        return (
            f"{wanted}, and git signs none here: git config --global commit.gpgsign true, with gpg.format ssh and "
            "user.signingkey FILE"
        )
    if (repo.setting("gpg.format") or "openpgp").lower() != "ssh":
        return (
            None if rule.fingerprints else f"{wanted}, which are ssh keys: git config --global gpg.format ssh"
        )
    public = _public_key((repo.setting("user.signingkey") or "").strip())
    if public is not None and public not in {" ".join(key.split()[:2]) for key in rule.keys}:
        return f"{wanted}, and user.signingkey is another one"
    return None


def _public_key(setting: str) -> str | None:
    """Return the ssh key that git's user.signingkey gives as text or as a file; None if it cannot be determined."""
    text = setting.removeprefix("key::")
    if not KEY.match(text):
        file = Path(setting).expanduser()
        file = file if file.suffix == ".pub" else file.with_name(f"{file.name}.pub")
        try:
            text = file.read_text("utf-8", "replace")
        except OSError:
            return None
    return " ".join(text.split()[:2])


def _counted(
    repo: Repository, stored: StoredEntry, rule: ApprovalRule, approving: Sequence[Revision]
) -> frozenset[str]:
    """Return the addresses of the people with a valid approval."""
    signed = _signed(repo, [one.commit for one in approving], rule) if rule.is_signed else None
    return frozenset(
        one.author.email.lower()
        for one in approving
        if (signed is None or one.commit in signed) and _refused(repo, stored, rule, one.author) is None
    )


def _refused(repo: Repository, stored: StoredEntry, rule: ApprovalRule, person: Person) -> str | None:
    """Return why a person's approval does not count; None if it does."""
    if rule.people and not {person.name, person.email.lower()} & {*rule.people, *map(str.lower, rule.people)}:
        return f"{person.name} <{person.email}> is not among those who approve by registry.yaml"
    first = origin(repo, stored)
    if rule.not_author and first is not None and first.author.email.lower() == person.email.lower():
        return f"{person.name} proposed it, and registry.yaml asks for the approval of another person"
    return None


def _lacking(rule: ApprovalRule, people: frozenset[str]) -> str | None:
    if len(people) >= rule.count:
        return None
    of_whom = f" of {', '.join(rule.people)}" if rule.people else ""
    keys = ", signed with a listed key" if rule.is_signed else ""
    another = " who did not propose it" if rule.not_author else ""
    return f"{len(people)} of {rule.count} approvals{of_whom}{another}{keys}"


def _signed(repo: Repository, commits: Sequence[str], rule: ApprovalRule) -> frozenset[str]:
    """Return the commits with a good signature by a listed key; other keys do not count, even if git trusts them."""
    listed = {*map(_fingerprint, rule.keys), *rule.fingerprints}
    with tempfile.TemporaryDirectory() as folder:
        signers = Path(folder) / "signers"
        signers.write_text("".join(f"* {' '.join(key.split()[:2])}\n" for key in rule.keys), encoding="utf-8")
        found = signatures(repo, commits, signers)
    return frozenset(one.commit for one in found if one.is_intact and {one.key, one.primary} & listed)


def _fingerprint(key: str) -> str:
    """Return the fingerprint of an ssh key, as ssh-keygen prints it."""
    try:
        blob = base64.b64decode(key.split()[1])
    except ValueError:
        return ""
    return "SHA256:" + base64.b64encode(hashlib.sha256(blob).digest()).decode().rstrip("=")


def _approval(revision: Revision) -> Approval:
    return Approval(
        by=revision.author.name,
        email=revision.author.email,
        date=revision.authored,
        commit=revision.commit,
        reason=next((value for key, value in revision.trailers if key == "Reason"), None),
    )
