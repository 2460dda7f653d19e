"""Exchange commits with another copy of a registry, and decisions between two changes of one entry."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Annotated, Final, Literal

from msgspec import field
from msgspec.structs import asdict

from calibrary.arguments import Sides
from calibrary.errors import InputError, RegistryError
from calibrary.records import Meta, Record, replace
from calibrary.registry.cache import Memory
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.fields import Field, entry_fields
from calibrary.registry.git import remotes
from calibrary.registry.git.errors import Conflict, FileConflictError, NoBranchError, RewrittenError
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.program import check_url, without_secret
from calibrary.registry.git.remotes import Removed, set_remote
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import (
    EVENTS,
    find_paths,
    id_of,
    single_match,
)
from calibrary.registry.proposals import message_of, write_changes
from calibrary.registry.registry import open_snapshot
from calibrary.registry.statements import content_of, id_in, subject_of
from calibrary.registry.stating import Action, Change, stated

DEFAULT: Final = "origin"
CHOSEN: Final = "both sides had changed it"


class FieldConflict(Record):
    """A field in which two sides differ; None if a side does not state it.

    Attributes:
        name: dotted name, as nested in the file.
        base: common starting value.
        ours, theirs: value on each side.
    """

    name: str = field(name="field")
    base: Field
    ours: Field
    theirs: Field


class EntryConflict(Record):
    """An entry that both sides changed.

    Attributes:
        path: path of the entry.
        id: its longest KEY.
        removed: the side that removed it, ours or theirs; None if both changed it.
        fields: fields that differ; empty if one side is not an entry.
    """

    path: str
    id: str
    removed: Literal["ours", "theirs"] | None
    fields: tuple[FieldConflict, ...]


class WithdrawnCommit(Record):
    """A commit that a remote had and no longer has.

    Attributes:
        commit: its id.
        subject: first line of its message.
    """

    commit: ObjectId
    subject: str


class SyncReport(Record, tag_field="schema", tag="calibrary/registry-sync-1"):
    """Output of ``calibrary registry sync --json``.

    Attributes:
        remote: name of the remote.
        before: local commit before a pull.
        commit: local commit now; None if a conflict prevented the pull.
        theirs: commit of the remote.
        replayed: number of local commits repeated on top of the remote's.
        warnings: warnings for the user.
        conflicts: entries that both sides changed, if no side was chosen.
        unpushed: why the local commits were not sent, although they were pulled onto the remote's.
        withdrawn: commits that the remote had and no longer has, if it was not said what becomes of them, newest first.
        branch: the remote's branch with the proposed commits.
        address: where that branch is opened for review; None if it is not known.
    """

    remote: str
    before: ObjectId | None = None
    commit: ObjectId | None = None
    theirs: ObjectId | None = None
    replayed: Annotated[int, Meta(ge=0)] = 0
    warnings: tuple[str, ...] = ()
    conflicts: tuple[EntryConflict, ...] = ()
    unpushed: str | None = None
    withdrawn: tuple[WithdrawnCommit, ...] = ()
    branch: str | None = None
    address: str | None = None

    @property
    def is_good(self) -> bool:
        """Whether all was done that was asked for."""
        return not (self.conflicts or self.withdrawn) and self.unpushed is None


def pull(
    repo: Repository, remote: str = DEFAULT, sides: Sides | None = None, removed: Removed | None = None
) -> SyncReport:
    """Pull; of an entry whose file both sides changed, the chosen version stays. No statement is in conflict.

    Args:
        repo: repository of the registry.
        remote: name of the remote.
        sides: which version counts of every entry that both sides changed; if one is missing, nothing is changed, and
            the result has all conflicts.
        removed: what becomes of commits that the remote had and no longer has; if nothing is said, nothing is changed,
            and the result has them.

    Raises:
        RegistryError: the remote cannot be reached.
    """
    chosen: dict[str, Literal["ours", "theirs"]] = {}
    while True:
        try:
            done = remotes.pull(repo, remote, chosen=chosen, removed=removed)
        except RewrittenError as error:
            return _rewritten(remote, error)
        except FileConflictError as error:
            known, chosen = chosen, chosen | _chosen(repo, error.conflicts, sides or Sides())
            if chosen == known or any(one.path not in chosen for one in error.conflicts):
                return SyncReport(remote=remote, conflicts=tuple(map(_entry_conflict, error.conflicts)))
        else:
            _forget(repo, done.before, done.commit)
            commit = _state_choices(repo, [*chosen]) or done.commit
            return SyncReport(remote=remote, **asdict(replace(done, commit=commit)))


def _state_choices(repo: Repository, paths: Sequence[str]) -> str | None:
    """Put in force what the chosen files say, where both sides stated something; the commit, None if all is."""
    snapshot, changes = open_snapshot(repo.path), list[Change]()
    for path in paths:
        if (entry := snapshot.file(path)) is not None:
            heads = snapshot.book.in_force(subject_of(path), entry).heads()
            is_torn = len(heads) > 1 and content_of(entry) in {one.says for one in heads}
            what: Action = "approve" if is_torn else "set"
            changes.append(Change(action=what, before=None, after=entry, why=CHOSEN, fields=()))
    try:
        made = stated(snapshot, changes).changes
    except RegistryError:
        # Who may not approve leaves it to those who may: until then the entry is refused, and says so.
        made = stated(snapshot, [one for one in changes if one.action == "set"]).changes
    entries = [one.after for one in changes]
    return write_changes(repo, made, message_of("State what was chosen", entries)).commit if made else None


def _rewritten(remote: str, error: RewrittenError) -> SyncReport:
    gone = (WithdrawnCommit(commit=one.commit, subject=one.subject) for one in error.withdrawn)
    return SyncReport(remote=remote, withdrawn=tuple(gone))


def _forget(repo: Repository, before: str | None, now: str | None) -> None:
    """Forget the statements that were given up: readers refuse an entry of which one was there before and is gone."""
    if before is None or now is None or before == now:
        return
    gone = repo.listing(before, EVENTS).keys() - repo.listing(now, EVENTS).keys()
    if gone:
        Memory(repo).give_up(now, repo.head_ref or "HEAD", map(id_in, gone))


def propose(repo: Repository, remote: str = DEFAULT) -> SyncReport:
    """Move the local commits to a branch of the remote for review.

    Raises:
        RegistryError: there are none, or the remote cannot be reached, or rejects the branch.
    """
    try:
        done = remotes.propose(repo, remote)
    except RewrittenError as error:
        return _rewritten(remote, error)
    _forget(repo, done.before, done.theirs)
    return SyncReport(remote=remote, **asdict(done))


def sync(
    repo: Repository, remote: str = DEFAULT, sides: Sides | None = None, removed: Removed | None = None
) -> SyncReport:
    """Pull, then send what the remote does not have; a refusal is in the result, because the pull stays.

    Raises:
        RegistryError: as for :func:`pull`, or a new remote refuses the first commits; nothing was changed.
    """
    try:
        done = pull(repo, remote, sides, removed)
    except NoBranchError:
        commit = remotes.push(repo, remote)
        return SyncReport(remote=remote, before=commit, commit=commit, theirs=commit)
    if not done.is_good:
        what = (
            "the commits that the remote no longer has"
            if done.withdrawn
            else "the entries that both sides changed"
        )
        return replace(done, unpushed=f"nothing is sent before it is decided about {what}")
    if done.commit == done.theirs:
        return done
    try:
        return replace(done, theirs=remotes.push(repo, remote))
    except RegistryError as error:
        return replace(done, unpushed=str(error))


def remote_named(repo: Repository, word: str | None) -> tuple[str, str | None]:
    """Return the remote that a word names, by its name or address.

    A new address is stored as ``origin`` if there is no such remote yet.

    Returns:
        Its name, and the address that was stored, without a password.

    Raises:
        RegistryError: it is neither, or ``origin`` already has another address.
    """
    if word is None:
        return DEFAULT, None
    if not _is_address(word):
        return word, None
    address = check_url(word)
    known = _remotes(repo)
    for name, url in known.items():
        if url in {word, address}:
            return name, None
    if DEFAULT in known:
        raise RegistryError(
            f"{without_secret(address)}: no remote of that address, and origin is {without_secret(known[DEFAULT])}; "
            f"name it first: git -C {repo.path} remote add NAME URL"
        )
    set_remote(repo, DEFAULT, address)
    return DEFAULT, without_secret(address)


def _is_address(word: str) -> bool:
    return any(sign in word for sign in "/:\\")


def _remotes(repo: Repository) -> dict[str, str]:
    settings = {setting.key: setting.value for setting in repo.settings}
    return {
        key.removeprefix("remote.").removesuffix(".url"): value or ""
        for key, value in settings.items()
        if key.startswith("remote.") and key.endswith(".url")
    }


def _entry_conflict(conflict: Conflict) -> EntryConflict:
    base, ours, theirs = (
        _fields(data, conflict.path) for data in (conflict.base, conflict.ours, conflict.theirs)
    )
    names = dict.fromkeys([*(ours or {}), *(theirs or {})])
    removed: Literal["ours", "theirs"] | None = None
    if conflict.ours is None or conflict.theirs is None:
        removed = "ours" if conflict.ours is None else "theirs"
    fields = tuple(
        FieldConflict(
            name=name,
            base=(base or {}).get(name),
            ours=(ours or {}).get(name),
            theirs=(theirs or {}).get(name),
        )
        for name in names
        if (ours or {}).get(name) != (theirs or {}).get(name)
    )
    return EntryConflict(path=conflict.path, id=id_of(conflict.path), removed=removed, fields=fields)


def _chosen(
    repo: Repository, conflicts: Sequence[Conflict], sides: Sides
) -> dict[str, Literal["ours", "theirs"]]:
    """Return which side counts of the files in conflict, as far as that is decided.

    Raises:
        RegistryError: an entry was named for both sides, or has no conflict.
    """
    paths = [conflict.path for conflict in conflicts]
    ours, theirs = (_named(repo, paths, keys) for keys in (sides.ours, sides.theirs))
    if both := ours & theirs:
        raise RegistryError(f"{id_of(min(both))} is named for both --ours and --theirs; choose one")
    return {**dict.fromkeys(ours, "ours"), **dict.fromkeys(theirs, "theirs")}


def _named(repo: Repository, paths: Collection[str], keys: Sequence[str]) -> set[str]:
    """Return the paths that KEYs name, also by the label or serial number of a unit.

    Raises:
        RegistryError: a KEY names none of them, or several.
    """
    found = {*paths} if "all" in keys else set[str]()
    for key in keys:
        if key != "all":
            named = find_paths(paths, key) or open_snapshot(repo.path).of_unit(paths, key)
            found.add(single_match(named, paths, key))
    return found


def _fields(data: bytes | None, path: str) -> dict[str, Field] | None:
    entry = _entry(data, path)
    return entry_fields(entry) if entry is not None else None


def _entry(data: bytes | None, path: str) -> Entry | None:
    if data is None:
        return None
    try:
        return parse_entry(data, path, require_digest=False)
    except InputError:
        return None
