"""A fleet's registry in git: reading, and changes with a reason."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from calibrary.errors import RegistryError
from calibrary.records import replace
from calibrary.registry import decisions, proposing, sync
from calibrary.registry.approvals import digest_as_proposed, unmet_with, unsigned_here
from calibrary.registry.entry import Entry, Status, Validity
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git import maintenance
from calibrary.registry.git.commits import Person
from calibrary.registry.git.names import check_branch
from calibrary.registry.git.remotes import Pulled, clone, push
from calibrary.registry.git.writing import Change, Written, identity
from calibrary.registry.paths import check_path
from calibrary.registry.proposals import Proposal, Proposals, differs_in_status_only, needs_no_approval
from calibrary.registry.reader import RegistryReader
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.stored import StoredEntry
from calibrary.registry.sync import Choice
from calibrary.registry.writing import Note, note_of, write_changes

__all__ = ["Registry"]


class Registry(RegistryReader):
    """A fleet's registry in git. Changes are proposed, checked, and written as one commit."""

    @classmethod
    def clone(cls, url: str, place: Path, *, bare: bool = False, durable: bool = True) -> Registry:
        """Clone another registry, checked out unless it is bare.

        Raises:
            RegistryError: the address is not valid, cannot be reached, or the folder is not empty.
        """
        repo = clone(url, place, bare=bare, durable=durable, check_path=check_path)
        maintenance.index_paths(repo)
        return cls(repo)

    def propose(
        self,
        entries: Sequence[Entry],
        *,
        approve: bool = False,
        reason: str | None = None,
        override_held: bool = False,
        edited: bool = False,
        force: str | None = None,
        branch: str | None = None,
    ) -> Proposals:
        """Propose entries on a branch; nothing is written. See :func:`proposing.propose`.

        Raises:
            RegistryError: a current entry is held and ``override_held`` is false.
        """
        return proposing.propose(
            self.branch(branch),
            entries,
            approve=approve,
            reason=reason,
            override_held=override_held,
            edited=edited,
            force=force,
        )

    def branch(self, name: str | None) -> Snapshot:
        """Return the state of a branch; if there is no such branch yet, that of the current one."""
        is_there = name is not None and self.repo.tip(f"refs/heads/{check_branch(name)}") is not None
        return self.snapshot(f"refs/heads/{name}" if is_there else None)

    def save(
        self,
        proposals: Proposals,
        *,
        branch: str | None = None,
        subject: str | None = None,
        reason: str | None = None,
        note: Note | None = None,
        author: Person | None = None,
    ) -> Written:
        """Write proposals as one commit.

        Args:
            proposals: proposals that were shown.
            branch: target branch; None for the one that is checked out.
            subject: subject of the commit; by default from the changes.
            reason: reason, for the history.
            note: complete content of the commit message, instead of one derived from the entries.
            author: author of the commit; by default git's user.

        Raises:
            FileConflictError: an entry was changed since it was proposed; nothing was written.
            RegistryError: a check failed, there is nothing to write, or the registry cannot be written.
        """
        due = proposals.due
        if proposals.errors:
            raise RegistryError(f"nothing was written: {proposals.errors[0]}")
        changes = [change for one in due for change in one.file_changes]
        # Connect the history of an entry across its approval.
        moved = [(old, one.path) for one in due for old, _ in one.replaced if one.base is None]
        note = note or note_of(subject or proposals.subject, [one.entry for one in due], reason)
        approved = [
            one
            for one in due
            if one.entry.status is Status.APPROVED and one.data is not None and not needs_no_approval(one)
        ]
        note = replace(note, approved=[digest_as_proposed(one.entry) for one in approved])
        if missing := self._missing(approved, author):
            return self._recorded(approved, missing, note, author=author, branch=branch)
        return write_changes(
            self.repo, changes, replace(note, moved=moved), author=author, branch=branch, is_checked=True
        )

    def _missing(self, approved: Sequence[Proposal], author: Person | None) -> dict[str, str]:
        """Return, by id, the approvals that are still missing with this person's, if the registry requires any.

        Raises:
            RegistryError: this person's approval does not count.
        """
        rule = self.configuration.approvals
        if rule is None:
            return {}
        if approved and (unsigned := unsigned_here(self.repo, rule)) is not None:
            raise RegistryError(f"nothing was written: {unsigned}")
        person, tip, missing = author or identity(self.repo)[0], self.commit(), {}
        for one in approved:
            if one.current is not None and one.current.is_usable and differs_in_status_only(one):
                continue
            path = one.replaced[0][0] if one.replaced else one.path
            stored = StoredEntry(entry=one.entry, path=path, oid=one.approves, commit=tip)
            if one.approves is None and (rule.not_author or rule.count > 1):
                missing[one.entry.id] = (
                    "the approval of another person; add it without --approve, as a proposal"
                )
            elif lacking := unmet_with(self.repo, stored, rule, person):
                missing[one.entry.id] = lacking
        return missing

    def _recorded(
        self,
        approved: Sequence[Proposal],
        missing: Mapping[str, str],
        note: Note,
        *,
        author: Person | None,
        branch: str | None,
    ) -> Written:
        """Record an approval in a commit without files, if further approvals are required.

        Raises:
            RegistryError: the approval has no effect.
        """
        refused = [f"{id_}: {why}" for id_, why in missing.items() if " approvals" not in why]
        if refused:
            raise RegistryError(f"nothing was written: {refused[0]}")
        named = approved[0].entry.id if len(approved) == 1 else f"{len(approved)} cameras"
        unused = tuple(f"{id_} is not used yet: it has {why}" for id_, why in missing.items())
        # The approval refers to the proposed content; the last approver moves the entry into use.
        note = replace(note, subject=f"Approve {named}, with others to follow", moved=())
        written = write_changes(self.repo, [], note, author=author, branch=branch)
        return replace(written, warnings=(*written.warnings, *unused))

    def write(
        self,
        entries: Sequence[tuple[Entry, str | None]],
        note: Note,
        *,
        author: Person | None = None,
        branch: str | None = None,
    ) -> Written:
        """Write entries as one commit, without checking them against others.

        Args:
            entries: each with the blob id of the content it started from, None for a new one.
            note: content of the commit message.
            author: author; None for git's user.
            branch: target branch; None for the one that is checked out.

        Raises:
            FileConflictError: an entry was changed since; nothing was written.
            RegistryError: an entry cannot be written.
        """
        changes = [Change(path=entry.path, data=entry_yaml(entry), base=base) for entry, base in entries]
        return write_changes(self.repo, changes, note, author=author, branch=branch)

    def propose_status(
        self,
        keys: Sequence[str],
        status: Status,
        reason: str | None = None,
        *,
        branch: str | None = None,
        successor: str | None = None,
        validity: Validity | None = None,
        force: str | None = None,
    ) -> Proposals:
        """Propose to approve, hold or retire entries; nothing is written. See :mod:`calibrary.registry.proposals`.

        Args:
            keys: keys of the entries, without a revision.
            status: new status.
            reason: reason for the change.
            branch: branch with the proposals; None for the current one.
            successor: KEY of the entry that replaces a retired one, and will state so.
            validity: days on which an approved entry may be used; None keeps those it states.
            force: reason for approving a K that contradicts known facts about its camera.

        Raises:
            UnknownCameraError: an entry does not exist.
            RegistryError: a key is ambiguous or contains a revision, the current entry is held, or the successor
                already supersedes another.
        """
        if status is Status.APPROVED:
            source = self.snapshot(branch) if branch is not None else self.snapshot()
            return decisions.approving(self.snapshot(), source, keys, reason, validity=validity, force=force)
        return decisions.of_current(self.snapshot(), keys, status, reason, successor)

    def pull(self, remote: str = sync.DEFAULT, choice: Choice | None = None) -> Pulled:
        """Pull, repeating local commits on top of the remote's. See :func:`calibrary.registry.sync.pull`.

        Raises:
            FileConflictError: both sides changed an entry and no side was chosen.
            RegistryError: the remote cannot be reached.
        """
        return sync.pull(self.repo, remote, choice)

    def push(self, remote: str = sync.DEFAULT) -> str:
        """Push; return the commit that both sides now have.

        Raises:
            ConflictError: the remote has new commits; pull first.
            RegistryError: the remote cannot be reached, or rejects the push.
        """
        return push(self.repo, remote)
