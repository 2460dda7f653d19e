"""Pulling from another copy of a registry, and deciding between two changes of one entry."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Annotated, Final

from msgspec import Struct, field

from calibrary.errors import InputError, RegistryError
from calibrary.records import Meta, Record
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.fields import Field, entry_fields
from calibrary.registry.git import remotes
from calibrary.registry.git.errors import Conflict, FileConflictError
from calibrary.registry.git.names import check_url, without_secret
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.remotes import Pulled, set_remote
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import Change
from calibrary.registry.paths import CAMERAS, PROPOSALS, find_path, id_of
from calibrary.registry.writing import Note, write_changes

__all__ = [
    "DEFAULT",
    "Choice",
    "FieldConflict",
    "SyncReport",
    "field_conflicts",
    "pull",
    "remote_named",
    "sync_report",
]

DEFAULT: Final = "origin"


class Choice(Struct, frozen=True, kw_only=True):
    """Which side is right where both changed an entry.

    Attributes:
        ours: KEYs of entries of which ours is.
        theirs: of those of which theirs is.
    """

    ours: Sequence[str] = ()
    theirs: Sequence[str] = ()


class FieldConflict(Record):
    """One field in which two sides differ; None where a side does not state it.

    Attributes:
        name: dotted, as the file nests it.
        base: what both started from.
        ours, theirs: what each made of it.
    """

    name: str = field(name="field")
    base: Field
    ours: Field
    theirs: Field


class EntryConflict(Record):
    """An entry that both sides changed.

    Attributes:
        path: of the entry.
        fields: in which the sides differ; none where one of them is not an entry.
    """

    path: str
    fields: tuple[FieldConflict, ...]


class SyncReport(Record, tag_field="schema", tag="calibrary/registry-sync-1"):
    """What calibrary registry pull --json and push --json print.

    Attributes:
        remote: its name.
        before: our commit before a pull.
        commit: our commit now; None where a conflict kept it from moving.
        theirs: the remote's.
        replayed: how many commits of ours were made again on top of theirs.
        warnings: what a person should know of it.
        conflicts: the entries that both sides changed, where no side was chosen.
    """

    remote: str
    before: ObjectId | None
    commit: ObjectId | None
    theirs: ObjectId | None
    replayed: Annotated[int, Meta(ge=0)]
    warnings: tuple[str, ...]
    conflicts: tuple[EntryConflict, ...]


def pull(repo: Repository, remote: str = DEFAULT, choice: Choice | None = None) -> Pulled:
    """Pull, and where both sides changed an entry take the side that was chosen.

    Args:
        repo: the registry's repository.
        remote: its name.
        choice: for every entry that both sides changed; without it nothing is changed where there is one.

    Raises:
        FileConflictError: both sides changed an entry and no side was chosen; all of them are reported.
        RegistryError: the remote cannot be reached.
    """
    try:
        return remotes.pull(repo, remote)
    except FileConflictError as error:
        sides = _decided(error, choice or Choice())
    before = repo.tip()
    conflicts = [conflict for conflict, _ in sides]
    # What we say is made what they say first, so that the pull finds both agreed; ours then follows as a change of
    # theirs, which is what it is.
    _settle(repo, conflicts)
    try:
        pulled = remotes.pull(repo, remote)
    except BaseException:
        _write_ours(repo, conflicts, Note(subject="Restore our entries: the pull failed"))
        raise
    kept = [conflict for conflict, is_ours in sides if is_ours]
    try:
        commit = _kept(repo, kept) if kept else pulled.commit
    except RegistryError as error:
        raise RegistryError(
            f"pulled, but our version was not written; it is in commit {before}: {error}"
        ) from None
    return Pulled(
        before=before,
        commit=commit,
        theirs=pulled.theirs,
        replayed=pulled.replayed + bool(kept),
        warnings=pulled.warnings,
    )


def remote_named(repo: Repository, word: str | None) -> tuple[str, str | None]:
    """The remote that a word means: its name, or its address.

    A new address is stored as ``origin`` where there is no such remote yet.

    Returns:
        its name, and the address that was stored, without a password.

    Raises:
        RegistryError: it is neither, or an address beside an ``origin`` that is another.
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


def field_conflicts(conflict: Conflict) -> tuple[FieldConflict, ...]:
    """The fields of an entry in which two sides differ; nothing where one of them is not an entry."""
    base, ours, theirs = (
        _fields(data, conflict.path) for data in (conflict.base, conflict.ours, conflict.theirs)
    )
    names = dict.fromkeys([*(ours or {}), *(theirs or {})])
    return tuple(
        FieldConflict(
            name=name,
            base=(base or {}).get(name),
            ours=(ours or {}).get(name),
            theirs=(theirs or {}).get(name),
        )
        for name in names
        if (ours or {}).get(name) != (theirs or {}).get(name)
    )


def sync_report(
    remote: str, pulled: Pulled | None, pushed: str | None, conflicts: Sequence[Conflict] = ()
) -> SyncReport:
    """A pull or push as ``--json`` prints it."""
    return SyncReport(
        remote=remote,
        before=pulled.before if pulled is not None else None,
        commit=pulled.commit if pulled is not None else pushed,
        theirs=pulled.theirs if pulled is not None else pushed,
        replayed=pulled.replayed if pulled is not None else 0,
        warnings=tuple(pulled.warnings) if pulled is not None else (),
        conflicts=tuple(EntryConflict(path=one.path, fields=field_conflicts(one)) for one in conflicts),
    )


def _is_address(word: str) -> bool:
    return any(sign in word for sign in "/:\\")


def _remotes(repo: Repository) -> dict[str, str]:
    settings = {setting.key: setting.value for setting in repo.settings}
    return {
        key.removeprefix("remote.").removesuffix(".url"): value or ""
        for key, value in settings.items()
        if key.startswith("remote.") and key.endswith(".url")
    }


def _decided(error: FileConflictError, choice: Choice) -> list[tuple[Conflict, bool]]:
    """Each conflict, and whether ours is right.

    Raises:
        FileConflictError: the one that was given, where a conflict is left undecided.
        RegistryError: an entry was named for both sides, or is in no conflict.
    """
    paths = [conflict.path for conflict in error.conflicts]
    ours = _chosen(paths, choice.ours)
    theirs = _chosen(paths, choice.theirs)
    if both := ours & theirs:
        raise RegistryError(f"{id_of(min(both))} is named for both --ours and --theirs; choose one")
    if ours | theirs != set(paths):
        raise error
    return [(conflict, conflict.path in ours) for conflict in error.conflicts]


def _chosen(paths: Collection[str], keys: Sequence[str]) -> set[str]:
    return {path for key in keys for path in ([*paths] if key == "all" else [find_path(paths, key)])}


def _settle(repo: Repository, conflicts: Collection[Conflict]) -> None:
    """Make ours say what theirs does; of this commit nothing is left once it is replayed."""
    tip = repo.tip()
    current = repo.listing(tip, CAMERAS, PROPOSALS) if tip is not None else {}
    changes = [
        Change(path=one.path, data=one.theirs, base=current.get(one.path))
        for one in conflicts
        if one.path in current or one.theirs is not None
    ]
    cameras = [id_of(one.path) for one in conflicts]
    write_changes(repo, changes, Note(subject="Take their entries before pulling", cameras=cameras))


def _kept(repo: Repository, conflicts: Sequence[Conflict]) -> str:
    cameras = [id_of(one.path) for one in conflicts]
    whose = cameras[0] if len(cameras) == 1 else f"{len(cameras)} cameras"
    note = Note(
        subject=f"Keep ours of {whose}",
        reason="both sides had changed it; ours was chosen",
        cameras=cameras,
    )
    return _write_ours(repo, conflicts, note)


def _write_ours(repo: Repository, conflicts: Sequence[Conflict], note: Note) -> str:
    """Our side of entries, written as a change of theirs."""
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
