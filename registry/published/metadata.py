"""Metadata of a publication after The Update Framework: which camera files are current, signed, and until when.

Four roles sign: the root says whose keys the others are, targets list the camera files in bins by the hash of their
paths, the snapshot says which of these lists belong together, and the timestamp, which snapshot is the newest.
python-tuf writes and reads them; https://theupdateframework.github.io/specification/ defines the files.

Without a key, a key that anyone can derive signs. Then readers are as safe as their https:// connection, but still
refuse to go back to an older state. Versions are seconds since 1970, so that a folder that is written anew, as by a
workflow, is newer than the last one; a root's are counted, so its files have to be kept.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final, TypeVar, cast

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import load_pem_private_key, load_ssh_private_key
from msgspec import Struct, field
from securesystemslib.signer import CryptoSigner, Key
from tuf.api.exceptions import RepositoryError
from tuf.api.metadata import (
    Delegations,
    Metadata,
    MetaFile,
    Root,
    Snapshot,
    SuccinctRoles,
    TargetFile,
    Targets,
    Timestamp,
)
from tuf.api.serialization.json import JSONSerializer

from calibrary.errors import RegistryError
from calibrary.records import from_json, to_json
from calibrary.registry.published.layout import METADATA_FOLDER, PublishedState
from calibrary.registry.published.output import Output

TIMESTAMP_FILE: Final = f"{METADATA_FOLDER}/timestamp.json"
"""The file that is replaced last."""
STATE_FIELD: Final = "x-calibrary-published"
"""Field of the snapshot with the :class:`~calibrary.registry.published.layout.PublishedState`."""

USUAL_DAYS: Final = 90
"""Days until readers refuse a publication that was not renewed."""
ROOT_DAYS: Final = 365
"""Least number of days for which a root is valid."""
PUBLIC_ROOT_DAYS: Final = 36_500
"""The same for a root by the public key, which nobody needs to replace."""

BIN: Final = 128
"""Average number of camera files in a bin, where :data:`FEWEST_BITS` and :data:`MOST_BITS` allow it."""
FEWEST_BITS: Final = 5
"""A client refuses a snapshot that lacks a bin of the last one. With 5 to 8 bits, bins are numbered by two digits, so
that more of them only add names; fewer of them never come (:meth:`_Writing.lists`)."""
MOST_BITS: Final = 8
PUBLIC_SEED: Final = b"calibrary: anyone may sign an unsigned publication"

_COMPACT: Final = JSONSerializer(compact=True)
Kind = TypeVar("Kind", Root, Snapshot, Targets, Timestamp)
Listed = Mapping[str, TargetFile]
"""Length and digest of camera files, by path."""


class Signing(Struct, frozen=True, kw_only=True):
    """How a publication is signed.

    Attributes:
        key: ssh or PEM key that signs what changes with every publication; None for one that anyone can derive.
        root_keys: keys that vouch for it, and are listed in the root from then on; by default itself.
        root_only: whether root keys that are not named are removed.
        threshold: number of root keys that have to sign a change of keys; None for the number until now, or 1.
        valid_days: days until readers refuse it, unless it is published again.
    """

    key: Path | None = None
    root_keys: tuple[Path, ...] = ()
    root_only: bool = False
    threshold: int | None = None
    valid_days: int = USUAL_DAYS


class Signers(Struct, frozen=True, kw_only=True):
    """Keys that sign a publication.

    Attributes:
        online: signs everything but the root.
        roots: sign the root, and are listed in the next one; empty to leave its keys as they are.
        root_only: whether only they are listed in it.
        threshold: how many of the listed ones a root needs; None for as many as until now.
        public: signed before there were keys; also signs a root that leads away from it.
        is_public: whether anyone has the key that signs.
    """

    online: CryptoSigner
    public: CryptoSigner
    roots: tuple[CryptoSigner, ...] = ()
    root_only: bool = False
    threshold: int | None = None
    is_public: bool = False


def signers(how: Signing) -> Signers:
    """Read the keys of a publisher.

    Raises:
        RegistryError: a key cannot be read, or needs a passphrase.
    """
    public = CryptoSigner(Ed25519PrivateKey.from_private_bytes(hashlib.sha256(PUBLIC_SEED).digest()))
    if how.key is None:
        if how.root_keys:
            raise RegistryError("root keys vouch for the key that signs: name that one too")
        return Signers(online=public, public=public, is_public=True)
    roots = {one.public_key.keyid: one for one in map(_read, how.root_keys)}
    return Signers(
        online=_read(how.key),
        public=public,
        roots=tuple(roots.values()),
        root_only=how.root_only,
        threshold=how.threshold,
    )


def _read(file: Path) -> CryptoSigner:
    try:
        data = file.read_bytes()
        load = load_ssh_private_key if b"OPENSSH" in data[:64] else load_pem_private_key
        # It refuses with a ValueError what it cannot sign with.
        return CryptoSigner(cast(Any, load(data, None)))
    except OSError as error:
        raise RegistryError(f"{file}: cannot be read: {error.strerror or error}") from None
    except TypeError:
        raise RegistryError(f"{file}: needs a passphrase; expected a key of its own without one") from None
    except (ValueError, UnsupportedAlgorithm):
        raise RegistryError(
            f"{file}: is not a private key that can sign, expected ed25519, ECDSA P-256 or RSA in the form of OpenSSH"
        ) from None


class Former(Struct, frozen=True, kw_only=True):
    """Verified metadata of the publication that is in a folder; empty where there is none, or it is damaged.

    Attributes:
        root: its newest root.
        lists: targets and bins, by role.
        snapshot, timestamp: as their names say.
        stamp: bytes of the timestamp.
    """

    root: Metadata[Root] | None = None
    lists: Mapping[str, Metadata[Targets]] = field(default_factory=dict)
    snapshot: Metadata[Snapshot] | None = None
    timestamp: Metadata[Timestamp] | None = None
    stamp: bytes = b""

    @property
    def files(self) -> Listed:
        """The camera files that it lists."""
        return {path: file for one in self.lists.values() for path, file in one.signed.targets.items()}

    @property
    def state(self) -> PublishedState | None:
        """What it is of."""
        if self.snapshot is None:
            return None
        return from_json(
            PublishedState, self.snapshot.signed.unrecognized_fields.get(STATE_FIELD), source=STATE_FIELD
        )


def former(out: Path) -> Former:
    """Read the metadata in a folder.

    Raises:
        RegistryError: its newest root is damaged; a new first one would be refused by every reader.
    """
    folder = out / METADATA_FOLDER
    root = _newest_root(folder)
    if root is None:
        return Former()
    try:
        stamp = (out / TIMESTAMP_FILE).read_bytes()
        timestamp: Metadata[Timestamp] = Metadata.from_bytes(stamp)
        _verify(root.signed, "timestamp", timestamp)
        snapshot: Metadata[Snapshot] = _part(folder, "snapshot", timestamp.signed.snapshot_meta)
        _verify(root.signed, "snapshot", snapshot)
        targets: Metadata[Targets] = _part(folder, "targets", snapshot.signed.meta["targets.json"])
        _verify(root.signed, "targets", targets)
        lists = {"targets": targets}
        for name in _bins(targets.signed):
            lists[name] = _part(folder, name, snapshot.signed.meta[f"{name}.json"])
            _verify(targets.signed, name, lists[name])
    except (OSError, KeyError, RepositoryError):
        return Former(root=root)
    return Former(root=root, lists=lists, snapshot=snapshot, timestamp=timestamp, stamp=stamp)


def expiry(stamp: bytes) -> datetime:
    """Return when a timestamp expires, given its bytes."""
    return Metadata[Timestamp].from_bytes(stamp).signed.expires


def _newest_root(folder: Path) -> Metadata[Root] | None:
    """Return the newest root; errors as for :func:`former`."""
    versions = [
        int(name) for file in folder.glob("*.root.json") if (name := file.name.partition(".")[0]).isdecimal()
    ]
    if not versions:
        return None
    file = folder / f"{max(versions)}.root.json"
    try:
        found: Metadata[Root] = Metadata.from_file(str(file))
        _verify(found.signed, "root", found)
    except (OSError, RepositoryError) as error:
        raise RegistryError(
            f"{file}: is damaged ({error}); restore it, readers trust what it leads to"
        ) from None
    return found


def _part(folder: Path, role: str, meta: MetaFile) -> Metadata[Kind]:
    return Metadata.from_file(str(folder / f"{meta.version}.{role}.json"))


def _verify(by: Root | Targets, role: str, metadata: Metadata[Kind]) -> None:
    by.verify_delegate(role, metadata.signed_bytes, metadata.signatures)


def _bins(targets: Targets) -> tuple[str, ...]:
    roles = targets.delegations.succinct_roles if targets.delegations is not None else None
    return tuple(roles.get_roles()) if roles is not None else ()


class Signed(Struct, frozen=True, kw_only=True):
    """Metadata that were written but for their timestamp.

    Attributes:
        stamp: bytes of the timestamp, to be written last.
        until: when readers refuse it.
        root: the root in force.
        is_new_root: whether it was written now.
    """

    stamp: bytes
    until: datetime
    root: Root
    is_new_root: bool


def write_metadata(
    files: Listed, state: PublishedState, output: Output, by: Signers, before: Former, *, valid_days: int
) -> Signed:
    """Write the metadata of a publication but for its timestamp, which has to be written last.

    Whatever is unchanged and valid for long enough stays as it is. The former snapshot and its lists stay too, for
    readers to whom a cache on the way still gives the former timestamp.

    Args:
        files: all camera files.
        state: what is published.
        output: folder of the publication.
        by: keys.
        before: what is in the folder.
        valid_days: days until readers refuse it, unless it is published again.

    Raises:
        RegistryError: the folder was signed by other keys, and these may not replace them.
    """
    now = datetime.now(UTC).replace(microsecond=0)
    until = now + timedelta(days=valid_days)
    root, data = _root(before.root, by, output.root, now, until)
    if data is not None:
        output.put(f"{METADATA_FOLDER}/{root.version}.root.json", data, in_place=False)
    older = [one.signed.version for one in (before.snapshot, before.timestamp) if one is not None]
    older += [one.signed.version for one in before.lists.values()]
    writing = _Writing(
        output=output,
        online=by.online,
        now=now,
        until=min(until, root.expires),
        version=max(int(now.timestamp()), *(version + 1 for version in older), 0),
    )
    output.kept.update(_paths(before))
    versions = writing.lists(files, before)
    stamp = writing.snapshot(versions, state, before, root, valid_days)
    return Signed(stamp=stamp, until=expiry(stamp), root=root, is_new_root=data is not None)


def _paths(before: Former) -> Iterator[str]:
    if before.snapshot is not None:
        yield f"{METADATA_FOLDER}/{before.snapshot.signed.version}.snapshot.json"
    for role, one in before.lists.items():
        yield f"{METADATA_FOLDER}/{one.signed.version}.{role}.json"


class _Writing(Struct, frozen=True, kw_only=True):
    """One run; its timestamp expires at ``until``, and all that it writes but roots has its ``version``."""

    output: Output
    online: CryptoSigner
    now: datetime
    until: datetime
    version: int

    def lists(self, files: Listed, before: Former) -> dict[str, int]:
        """Write the lists that differ; return the version of each by its role."""
        key, former_bins = self.online.public_key, len(before.lists) - 1
        bits = max(_bits(len(files)), former_bins.bit_length() - 1)
        roles = SuccinctRoles([key.keyid], 1, bits, "bin")
        below: dict[str, dict[str, TargetFile]] = defaultdict(dict)
        for path, file in files.items():
            below[roles.get_role_for_target(path)][path] = file
        wanted = {"targets": Targets(delegations=Delegations({key.keyid: key}, succinct_roles=roles))}
        wanted |= {name: Targets(targets=below[name]) for name in roles.get_roles()}
        versions = {}
        for name, made in wanted.items():
            kept = before.lists.get(name)
            if (
                kept is not None
                and (kept.signed.targets, kept.signed.delegations) == (made.targets, made.delegations)
                and kept.signed.expires >= self.until
                and key.keyid in kept.signatures
            ):
                versions[name] = kept.signed.version
                continue
            made.version, made.expires = self.version, self.now + 2 * (self.until - self.now)
            self.put(name, made)
            versions[name] = self.version
        return versions

    def snapshot(
        self, versions: Mapping[str, int], state: PublishedState, before: Former, root: Root, valid_days: int
    ) -> bytes:
        """Write a snapshot of lists, unless the former one serves; return the bytes of its timestamp."""
        content = {STATE_FIELD: to_json(state)}
        meta = {f"{name}.json": MetaFile(version) for name, version in versions.items()}
        kept = before.snapshot
        if (
            kept is not None
            and before.timestamp is not None
            and (kept.signed.meta, kept.signed.unrecognized_fields) == (meta, content)
            and all(
                self._lasts(one, root, role, valid_days)
                for role, one in (("snapshot", kept), ("timestamp", before.timestamp))
            )
        ):
            return before.stamp
        self.put(
            "snapshot", Snapshot(self.version, expires=self.until, meta=meta, unrecognized_fields=content)
        )
        return self.signed(Timestamp(self.version, expires=self.until, snapshot_meta=MetaFile(self.version)))

    def put(self, role: str, content: Kind) -> None:
        """Sign and write a file that nothing refers to yet."""
        self.output.put(f"{METADATA_FOLDER}/{content.version}.{role}.json", self.signed(content))

    def signed(self, content: Kind) -> bytes:
        """Return the bytes of signed metadata."""
        metadata: Metadata[Kind] = Metadata(content)
        metadata.sign(self.online)
        return metadata.to_bytes(_COMPACT)

    def _lasts(
        self, metadata: Metadata[Snapshot] | Metadata[Timestamp], root: Root, role: str, valid_days: int
    ) -> bool:
        """Whether existing metadata is of a role's present key, and valid neither too shortly nor too long."""
        own = self.online.public_key.keyid
        left = metadata.signed.expires - self.now
        is_own = [own] == root.roles[role].keyids and own in metadata.signatures
        return (
            is_own
            and min(timedelta(days=valid_days / 2), self.until - self.now) <= left <= self.until - self.now
        )


def _bits(count: int) -> int:
    """Return the number of bits of a bin's number."""
    return max(FEWEST_BITS, min(MOST_BITS, (count // BIN).bit_length()))


def _root(
    before: Metadata[Root] | None, by: Signers, out: Path, now: datetime, until: datetime
) -> tuple[Root, bytes | None]:
    """Return the root in force, and its bytes if it is a new one: if keys differ, or the former one expires too early.

    A root that the keys at hand cannot renew stays in force until it expires.

    Raises:
        RegistryError: the former root does not accept the keys, or has expired.
    """
    old = before.signed if before is not None else None
    days = PUBLIC_ROOT_DAYS if by.is_public else max(ROOT_DAYS, 4 * (until - now).days)
    made = Root(old.version + 1 if old is not None else 1, expires=now + timedelta(days=days))
    public, online = by.public.public_key.keyid, by.online.public_key
    was_public = old is not None and public in old.roles["root"].keyids
    if old is not None and by.is_public and not was_public:
        raise RegistryError(f"{out}: was signed before, and its readers accept nothing else: name the key")
    kept = {} if old is None or by.root_only or (was_public and not by.is_public) else _root_keys(old)
    named = {one.public_key.keyid: one.public_key for one in by.roots}
    listed_keys = {**kept, **named} or {online.keyid: online}
    for key in listed_keys.values():
        made.add_key(key, "root")
    former_threshold = old.roles["root"].threshold if old is not None and not was_public else 1
    made.roles["root"].threshold = by.threshold or min(former_threshold, len(listed_keys))
    if made.roles["root"].threshold > len(listed_keys):
        raise RegistryError(
            f"a root that needs {made.roles['root'].threshold} keys has only {len(listed_keys)}: name more root keys"
        )
    for role in ("timestamp", "snapshot", "targets"):
        made.add_key(online, role)
    is_same = old is not None and (old.roles, old.keys) == (made.roles, made.keys)
    if old is not None and is_same and old.expires >= until:
        return old, None
    metadata, missing = _signed_root(made, old, by)
    if missing is None:
        return made, metadata.to_bytes(_COMPACT)
    if old is not None and is_same and old.expires > now:
        return old, None
    raise RegistryError(f"{out}: its keys are changed or renewed by {missing}: name them as root keys")


def _root_keys(root: Root) -> dict[str, Key]:
    return {keyid: root.keys[keyid] for keyid in root.roles["root"].keyids}


def _signed_root(made: Root, old: Root | None, by: Signers) -> tuple[Metadata[Root], str | None]:
    """Sign a root as it and the former one ask for; return which keys are missing for that, if any."""
    metadata = Metadata(made)
    asking = (made,) if old is None else (old, made)
    wanted = {keyid for root in asking for keyid in root.roles["root"].keyids}
    for signer in (*by.roots, by.online, by.public):
        if signer.public_key.keyid in wanted:
            metadata.sign(signer, append=True)
    for root in asking:
        result = root.get_verification_result("root", metadata.signed_bytes, metadata.signatures)
        if not result:
            lacking = result.threshold - len(result.signed)
            return metadata, f"{lacking} more of {', '.join(map(_named, result.unsigned.values()))}"
    return metadata, None


def _named(key: Key) -> str:
    return f"{key.keytype} {key.keyval.get('public', key.keyid)[:16]}…"
