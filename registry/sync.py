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
from calibrary.registry.entry_yaml import combined, parse_entry
from calibrary.registry.fields import Field, entry_fields
from calibrary.registry.git import remotes
from calibrary.registry.git.errors import Conflict, FileConflictError, NoBranchError, RewrittenError
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.program import check_url, without_secret
from calibrary.registry.git.remotes import Pulled, Removed, set_remote
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import Change
from calibrary.registry.paths import (
    CAMERAS,
    PROPOSALS,
    STATEMENTS,
    find_paths,
    id_of,
    in_use_path,
    single_match,
)
from calibrary.registry.proposals import Note, write_changes
from calibrary.registry.registry import open_snapshot
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.statements import content_of, id_in, subject_of
from calibrary.registry.stating import Act, stated

DEFAULT: Final = "origin"


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
    """Pull, and use the chosen side for entries that both sides changed.

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

    def pulled_now() -> Pulled:
        done = remotes.pull(repo, remote, combine=combined, removed=removed)
        _forget(repo, done.before, done.commit)
        return done

    try:
        return SyncReport(remote=remote, **asdict(pulled_now()))
    except RewrittenError as error:
        return _rewritten(remote, error)
    except FileConflictError as error:
        decided = _decided(repo, error.conflicts, sides or Sides())
        if decided is None:
            return SyncReport(remote=remote, conflicts=tuple(map(_entry_conflict, error.conflicts)))
    before = repo.tip()
    conflicts = [conflict for conflict, _ in decided]
    # Set the local entries to the remote's version first, so that the pull finds no conflict; then write the chosen
    # local version as a change of the remote's.
    _take_theirs(repo, conflicts)
    try:
        pulled = SyncReport(remote=remote, **asdict(pulled_now()))
    except BaseException:
        _write_ours(repo, conflicts, Note(subject="Restore our entries: the pull failed"))
        raise
    kept = [conflict for conflict, is_ours in decided if is_ours]
    try:
        commit = _keep_ours(repo, kept) if kept else pulled.commit
    except RegistryError as error:
        raise RegistryError(
            f"pulled, but our version was not written; it is in commit {before}: {error}"
        ) from None
    labelled = _state_choices(repo, conflicts)
    return replace(
        pulled,
        before=before,
        commit=labelled or commit,
        replayed=pulled.replayed + bool(kept) + (labelled is not None),
    )


def _rewritten(remote: str, error: RewrittenError) -> SyncReport:
    gone = (WithdrawnCommit(commit=one.commit, subject=one.subject) for one in error.withdrawn)
    return SyncReport(remote=remote, withdrawn=tuple(gone))


def _forget(repo: Repository, before: str | None, now: str | None) -> None:
    """Forget the statements that were given up: readers refuse an entry of which one was there before and is gone."""
    if before is None or now is None or before == now:
        return
    gone = repo.listing(before, STATEMENTS).keys() - repo.listing(now, STATEMENTS).keys()
    if gone:
        Memory(repo).give_up(now, repo.head_ref or "HEAD", map(id_in, gone))


def _state_choices(repo: Repository, conflicts: Sequence[Conflict]) -> str | None:
    """Put in force what the chosen version of each entry says; the commit, None if all is."""
    snapshot = open_snapshot(repo.path)
    if not snapshot.is_stated:
        return None
    here = [one.path for one in conflicts if snapshot.paths.get(one.path) is not None]
    chosen = [one for path in here if (one := _entry(snapshot.committed(path), path)) is not None]
    why = "both sides had changed it"
    acts = [Act(action="approve" if _is_torn(snapshot, one) else "label", entry=one) for one in chosen]
    try:
        made = stated(snapshot, acts, why).changes
    except RegistryError:
        # Who may not approve leaves it to those who may: until then the entry is refused, and says so.
        made = stated(snapshot, [Act(action="label", entry=one) for one in chosen], why).changes
    if not made:
        return None
    cameras = [one.id for one in chosen]
    return write_changes(repo, made, Note(subject="State what was chosen", cameras=cameras)).commit


def _is_torn(snapshot: Snapshot, entry: Entry) -> bool:
    """Whether an entry is one of several contents that were approved at the same time."""
    heads = snapshot.book.in_force(subject_of(entry.path)).heads()
    return len(heads) > 1 and content_of(entry) in {one.says for one in heads}


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


def _decided(
    repo: Repository, conflicts: Sequence[Conflict], sides: Sides
) -> list[tuple[Conflict, bool]] | None:
    """Return each conflict, and whether the local side is chosen; None if one is undecided.

    Raises:
        RegistryError: an entry was named for both sides, or has no conflict.
    """
    paths = [conflict.path for conflict in conflicts]
    ours, theirs = (_chosen(repo, paths, keys) for keys in (sides.ours, sides.theirs))
    if both := ours & theirs:
        raise RegistryError(f"{id_of(min(both))} is named for both --ours and --theirs; choose one")
    if ours | theirs != set(paths):
        return None
    return [(conflict, conflict.path in ours) for conflict in conflicts]


def _chosen(repo: Repository, paths: Collection[str], keys: Sequence[str]) -> set[str]:
    """Return the paths that KEYs name, also by the label or serial number of a unit.

    Raises:
        RegistryError: a KEY names none of them, or several.
    """
    used = {in_use_path(path): path for path in paths}
    found = {*paths} if "all" in keys else set[str]()
    for key in keys:
        if key == "all":
            continue
        named = find_paths(paths, key)
        named = named or [used[path] for path in open_snapshot(repo.path).of_unit(used, key)]
        found.add(single_match(named, paths, key))
    return found


def _take_theirs(repo: Repository, conflicts: Collection[Conflict]) -> None:
    """Commit the remote's version locally; nothing of this commit is left after the replay."""
    tip = repo.tip()
    current = repo.listing(tip, CAMERAS, PROPOSALS) if tip is not None else {}
    changes = [
        Change(path=one.path, data=one.theirs, base=current.get(one.path))
        for one in conflicts
        if one.path in current or one.theirs is not None
    ]
    cameras = [id_of(one.path) for one in conflicts]
    write_changes(repo, changes, Note(subject="Take their entries before pulling", cameras=cameras))


def _keep_ours(repo: Repository, conflicts: Sequence[Conflict]) -> str:
    cameras = [id_of(one.path) for one in conflicts]
    whose = cameras[0] if len(cameras) == 1 else f"{len(cameras)} cameras"
    note = Note(
        subject=f"Keep ours of {whose}", reason="both sides had changed it; ours was chosen", cameras=cameras
    )
    return _write_ours(repo, conflicts, note)


def _write_ours(repo: Repository, conflicts: Sequence[Conflict], note: Note) -> str:
    """Write the local version of entries as a change of the remote's."""
    changes = [
        Change(path=one.path, data=one.ours, base=one.theirs_oid)
        for one in conflicts
        if one.ours is not None or one.theirs is not None
    ]
    return write_changes(repo, changes, note).commit


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
