"""Metadata of a publication after The Update Framework: which camera files are current, signed, and until when.

Four roles sign: the root says whose keys the others are, targets list the camera files (above :data:`FLAT` of them, in
bins by the hash of their paths), the snapshot says which of these lists belong together, and the timestamp, which
snapshot is the newest. python-tuf writes and reads them; https://theupdateframework.github.io/specification/ defines
the files.

Without a key, a key that anyone can derive signs. Then readers are as safe as their https:// connection, but still
refuse to go back to an older state. Versions are seconds since 1970, so that a folder that is written anew, as by a
workflow, is newer than the last one; a root's are counted, so its files have to be kept.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Mapping
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

__all__ = [
    "STATE_FIELD",
    "TIMESTAMP_FILE",
    "USUAL_DAYS",
    "Former",
    "Listed",
    "Signers",
    "expiry",
    "former",
    "signers",
    "write_metadata",
]

TIMESTAMP_FILE: Final = f"{METADATA_FOLDER}/timestamp.json"
"""The file that is replaced last."""
STATE_FIELD: Final = "x-calibrary-published"
"""Field of the snapshot with the :class:`~calibrary.registry.published.layout.PublishedState`."""

FLAT: Final = 256
"""Number of camera files up to which the targets list them without bins."""
BIN: Final = 128
"""Average number of camera files in a bin, unless there are more than :data:`MOST_BITS` allow."""
MOST_BITS: Final = 10
USUAL_DAYS: Final = 90
"""Days until readers refuse a publication that was not renewed."""
ROOT_DAYS: Final = 365
"""Least number of days for which a root is valid."""

_COMPACT: Final = JSONSerializer(compact=True)
Kind = TypeVar("Kind", Root, Snapshot, Targets, Timestamp)
Listed = Mapping[str, TargetFile]
"""Length and digest of camera files, by path."""


class Signing(Struct, frozen=True, kw_only=True):
    """How a publication is signed.

    Attributes:
        key: ssh or PEM key that signs what changes with every publication; None for one that anyone can derive.
        root_keys: keys that vouch for it; by default itself.
        threshold: number of root keys that have to sign a change of keys.
        valid_days: days until readers refuse it, unless it is published again.
    """

    key: Path | None = None
    root_keys: tuple[Path, ...] = ()
    threshold: int = 1
    valid_days: int = USUAL_DAYS


class Signers(Struct, frozen=True, kw_only=True):
    """Keys that sign a publication.

    Attributes:
        online: signs everything but the root.
        roots: sign the root; those that the next one lists.
        threshold: how many of them a root needs.
        former: also sign a new root, but are not listed in it.
        is_public: whether anyone has these keys.
    """

    online: CryptoSigner
    roots: tuple[CryptoSigner, ...]
    threshold: int
    former: tuple[CryptoSigner, ...] = ()
    is_public: bool = False


def signers(how: Signing, identity: str) -> Signers:
    """Read the keys of a publisher.

    Args:
        how: which.
        identity: id of the registry, of which the public key is made.

    Raises:
        RegistryError: a key cannot be read, needs a passphrase, or the threshold cannot be reached.
    """
    public = CryptoSigner(
        Ed25519PrivateKey.from_private_bytes(
            hashlib.sha256(f"calibrary published, unsigned: {identity}".encode()).digest()
        )
    )
    if how.key is None:
        if how.root_keys:
            raise RegistryError("root keys vouch for the key that signs: name that one too")
        return Signers(online=public, roots=(public,), threshold=1, is_public=True)
    online = _read(how.key)
    roots = {one.public_key.keyid: one for one in map(_read, how.root_keys)}
    roots = roots or {online.public_key.keyid: online}
    if how.threshold > len(roots):
        raise RegistryError(
            f"a root that needs {how.threshold} keys has only {len(roots)}: name more root keys"
        )
    # A publication that was not signed before gets a root that leads from the public key to these.
    return Signers(online=online, roots=tuple(roots.values()), threshold=how.threshold, former=(public,))


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


def write_metadata(
    files: Listed, state: PublishedState, output: Output, by: Signers, before: Former, *, valid_days: int
) -> bytes:
    """Write the metadata of a publication but for its timestamp, which is returned and has to be written last.

    Whatever is unchanged and valid for long enough stays as it is.

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
    writing = _Writing(
        output=output,
        online=by.online,
        now=now,
        until=now + timedelta(days=valid_days),
        version=max(
            int(now.timestamp()),
            *(one.signed.version + 1 for one in (before.snapshot, before.timestamp) if one is not None),
            *(one.signed.version + 1 for one in before.lists.values()),
            0,
        ),
    )
    root = _root(before.root, by, writing)
    versions = writing.lists(files, before)
    content = {STATE_FIELD: to_json(state)}
    kept = before.snapshot
    meta = {f"{name}.json": MetaFile(version) for name, version in versions.items()}
    if (
        kept is None
        or before.timestamp is None
        or (kept.signed.meta, kept.signed.unrecognized_fields) != (meta, content)
        or not writing.lasts(kept, root.signed, "snapshot", days=valid_days / 2)
        or not writing.lasts(before.timestamp, root.signed, "timestamp", days=valid_days / 2)
    ):
        version = writing.version
        writing.put(
            "snapshot", Snapshot(version, expires=writing.until, meta=meta, unrecognized_fields=content)
        )
        stamp = Timestamp(version, expires=writing.until, snapshot_meta=MetaFile(version))
        return writing.signed(stamp)
    output.kept.add(f"{METADATA_FOLDER}/{kept.signed.version}.snapshot.json")
    return before.stamp


class _Writing(Struct, frozen=True, kw_only=True):
    """One run.

    Attributes:
        output: folder.
        online: key.
        now: time of the run.
        until: when its timestamp expires.
        version: version of all that it writes but roots.
    """

    output: Output
    online: CryptoSigner
    now: datetime
    until: datetime
    version: int

    def lists(self, files: Listed, before: Former) -> dict[str, int]:
        """Write the lists that differ; return the version of each by its role."""
        bits = _bits(len(files))
        key = self.online.public_key
        roles = SuccinctRoles([key.keyid], 1, bits, "bin") if bits else None
        below: dict[str, dict[str, TargetFile]] = defaultdict(dict)
        for path, file in files.items():
            below[roles.get_role_for_target(path) if roles is not None else "targets"][path] = file
        delegations = Delegations({key.keyid: key}, succinct_roles=roles) if roles is not None else None
        wanted = {"targets": Targets(targets=below["targets"], delegations=delegations)}
        wanted |= {
            name: Targets(targets=below[name]) for name in (roles.get_roles() if roles is not None else ())
        }
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
                self.output.kept.add(f"{METADATA_FOLDER}/{kept.signed.version}.{name}.json")
                continue
            made.version, made.expires = self.version, self.now + 2 * (self.until - self.now)
            self.put(name, made)
            versions[name] = self.version
        return versions

    def put(self, role: str, content: Kind) -> None:
        """Sign and write a file that nothing refers to yet."""
        self.output.put(f"{METADATA_FOLDER}/{content.version}.{role}.json", self.signed(content))

    def signed(self, content: Kind) -> bytes:
        """Return the bytes of signed metadata."""
        metadata: Metadata[Kind] = Metadata(content)
        metadata.sign(self.online)
        return metadata.to_bytes(_COMPACT)

    def lasts(self, metadata: Metadata[Kind], root: Root, role: str, *, days: float) -> bool:
        """Whether existing metadata is of a role's present key and valid for a number of days."""
        is_own = [self.online.public_key.keyid] == root.roles[role].keyids and (
            self.online.public_key.keyid in metadata.signatures
        )
        return is_own and metadata.signed.expires >= self.now + timedelta(days=days)


def _bits(count: int) -> int:
    """Return the number of bits of a bin's number; 0 for no bins."""
    return 0 if count <= FLAT else min(MOST_BITS, (count // BIN).bit_length())


def _root(before: Metadata[Root] | None, by: Signers, writing: _Writing) -> Metadata[Root]:
    """Return the root in force; a new one if keys differ or the former one expires too early.

    Raises:
        RegistryError: the former root does not accept the keys.
    """
    days = max(ROOT_DAYS, 4 * (writing.until - writing.now).days)
    made = Root(1, expires=writing.now + timedelta(days=days), consistent_snapshot=True)
    for signer in by.roots:
        made.add_key(signer.public_key, "root")
    made.roles["root"].threshold = by.threshold
    for role in ("timestamp", "snapshot", "targets"):
        made.add_key(by.online.public_key, role)
    if before is not None:
        old = before.signed
        made.version = old.version + 1
        online = by.online.public_key.keyid
        if list(made.keys) == [online] and old.roles["timestamp"].keyids == [online]:
            # The key of every day is named alone: the root's own keys stay as they are.
            made.roles, made.keys = old.roles, old.keys
        if (old.roles, old.keys) == (made.roles, made.keys) and old.expires >= writing.until:
            return before
        if by.is_public and old.roles != made.roles:
            raise RegistryError(
                f"{writing.output.root}: was signed before, and its readers accept nothing else: name the key"
            )
    metadata = _signed_root(made, before, by, writing.output.root)
    path = f"{METADATA_FOLDER}/{made.version}.root.json"
    writing.output.put(path, metadata.to_bytes(_COMPACT), in_place=False)
    return metadata


def _signed_root(made: Root, before: Metadata[Root] | None, by: Signers, out: Path) -> Metadata[Root]:
    """Sign a root as it and the former one ask for.

    Raises:
        RegistryError: a key for that is missing.
    """
    metadata = Metadata(made)
    asking = (made,) if before is None else (before.signed, made)
    wanted = {keyid for root in asking for keyid in root.roles["root"].keyids}
    for signer in (*by.roots, *by.former):
        if signer.public_key.keyid in wanted:
            metadata.sign(signer, append=True)
    for root in asking:
        result = root.get_verification_result("root", metadata.signed_bytes, metadata.signatures)
        if not result:
            raise RegistryError(
                f"{out}: its keys are changed or renewed by {result.threshold - len(result.signed)} more of "
                f"{', '.join(map(_named, result.unsigned.values()))}: name them as root keys"
            )
    return metadata


def _named(key: Key) -> str:
    return f"{key.keytype} {key.keyval.get('public', key.keyid)[:16]}…"
