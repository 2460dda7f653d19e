"""Errors of a write: conflicting changes of one file with all three versions, and explained failures of git."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from calibrary.errors import ConflictError, RegistryError, first_of


class Conflict(Struct, frozen=True, kw_only=True):
    """A file that two writers changed.

    Attributes:
        base: common starting content; ``None`` if there was none, or it is not known here.
        base_oid: git's id of it; ``None`` if the file was to be new.
        ours: content to write; ``None`` to remove the file.
        theirs: current content; ``None`` if it was removed.
        theirs_oid: git's id of it, the base for another attempt.
    """

    path: str
    base_oid: str | None
    base: bytes | None
    ours: bytes | None
    theirs: bytes | None
    theirs_oid: str | None

    def __str__(self) -> str:
        if self.base_oid is None:
            return f"{self.path} was added by another writer"
        return f"{self.path} was {'removed' if self.theirs is None else 'changed'} by another writer"


class Withdrawn(Struct, frozen=True, kw_only=True):
    """A commit that a remote had and no longer has.

    Attributes:
        commit: its id.
        subject: first line of its message.
    """

    commit: str
    subject: str


class NoBranchError(RegistryError):
    """A remote does not have the branch yet."""


class RewrittenError(ConflictError):
    """The history of a remote was rewritten: it lacks commits that it had, which would come back.

    Attributes:
        withdrawn: those commits, newest first.
    """

    def __init__(self, remote: str, withdrawn: Sequence[Withdrawn]) -> None:
        self.remote, self.withdrawn = remote, tuple(withdrawn)
        listed = first_of((f"{one.commit[:12]} {one.subject}" for one in self.withdrawn), separator="; ")
        super().__init__(f"{remote} was rewritten and no longer has {listed}; nothing was pulled")

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.remote, self.withdrawn)


class TooLargeError(RegistryError):
    """A file that is larger than any in a registry."""


class FileConflictError(ConflictError):
    """Entries were changed since they were read; nothing was written.

    Attributes:
        conflicts: all conflicts, with all versions.
    """

    def __init__(self, conflicts: Sequence[Conflict], remedy: str) -> None:
        self.conflicts = tuple(conflicts)
        self.remedy = remedy
        shown = first_of(map(str, self.conflicts), separator="; ")
        super().__init__(f"{shown}; nothing was written: {remedy}")

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.conflicts, self.remedy)


DAMAGED = (
    "the repository is damaged: 'git fsck --full' lists what is missing or broken; what is pushed is whole in a new "
    "clone: calibrary registry init FOLDER --remote URL"
)
BROKEN = (
    "bad object",
    "bad tree object",
    "unable to read tree",
    "unable to parse commit",
    "could not parse commit",
    "failed to read object",
    "missing blob object",
    "is corrupt",
    "invalid sha1 pointer",
    "unexpected line in",
    "cannot open pack",
)
FULL = "the disk is full; nothing was changed"
EXPLAINED = (
    ("No space left on device", FULL),
    # After this message fast-import guesses "disk corruption?".
    ("Out of diskspace", FULL),
    ("File too large", "a file may not grow that large here; nothing was changed"),
    ("Read-only file system", "the disk is read-only"),
    ("Permission denied", "access denied; expected write access to the repository"),
    ("insufficient permission", "access denied; expected write access to the repository"),
    *((sign, DAMAGED) for sign in BROKEN),
)


def explain(output: str) -> str:
    """Return git's message, preceded by an explanation if there is one."""
    words = " ".join(line.strip() for line in output.splitlines() if line.strip()) or "no reason given"
    ours = [text for sign, text in EXPLAINED if sign.lower() in output.lower()]
    return f"{ours[0]} ({words})" if ours else words
