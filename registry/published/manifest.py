"""The files of a published registry: one signed manifest, and beside it files that are named by their SHA-256.

The manifest names the list of cameras, the list the file of each camera, and that has its entries whole. So the one
signature covers all files, none of them ever changes, and a reader who holds a manifest never sees two states.
"""

from __future__ import annotations

import hashlib
import shlex
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Final, Literal, TypeAlias

import msgspec
from msgspec import Struct

from calibrary.errors import RegistryError
from calibrary.records import Meta, Record
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.paths import ROOT, folder_of
from calibrary.registry.sshsig import BadSignatureError, fingerprint, key_blob, signed_by

DATA: Final = "data"
"""Folder of all files but the manifest and the schemas."""
NAMESPACE: Final = "calibrary-published"
"""What a signature is for, as ssh-keygen(1) states it."""
LARGEST_MANIFEST: Final = 1 << 16
LARGEST_LIST: Final = 32 << 20
LARGEST_CAMERA: Final = 16 << 20
"""Bytes that a reader accepts."""

Sha256: TypeAlias = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
EntryDocument: TypeAlias = Annotated[
    msgspec.Raw, Meta(extra_json_schema={"$ref": "urn:calibrary:schema:entry-1"})
]
"""An entry as JSON, which is parsed when it is needed."""


class PublishedEntry(Record):
    """An entry of a camera.

    Attributes:
        path: path of its file in the registry.
        status: it is used if it is approved.
        reason: why it was approved or retired.
        entry: what is in force of it.
        others: what is in force on days on which that is not.
    """

    path: str
    status: Literal["approved", "retired"]
    reason: str | None
    entry: EntryDocument
    others: tuple[EntryDocument, ...] = ()


class PublishedCamera(Record, tag_field="schema", tag="calibrary/published-camera-3"):
    """The entries of a make and model, or of one unit, by path.

    Attributes:
        entries: those that can be read.
        refused: paths of those that cannot; a reader refuses what they may apply to, and uses no other in their place.
    """

    entries: tuple[PublishedEntry, ...]
    refused: tuple[str, ...] = ()


class PublishedList(Record, tag_field="schema", tag="calibrary/published-list-1"):
    """The cameras of a published registry.

    Attributes:
        cameras: SHA-256 of a camera's file, by its folder in the registry: ``make/model`` or ``make/model/sn-HASH``.
        aliases: folders of the cameras that may have taken images with another make and model, by the folder of these.
    """

    cameras: dict[str, Sha256]
    aliases: dict[str, tuple[str, ...]]


class Manifest(Record):
    """What is signed.

    Attributes:
        version: greater than that of every earlier manifest at the same address: seconds since 1970.
        until: when readers refuse it.
        commit: published commit of the registry.
        date: date of that commit, UTC.
        writer: versions on which the content of the files depends.
        cameras: SHA-256 of the list of cameras.
    """

    version: Annotated[int, Meta(ge=0, le=1 << 53)]
    until: Annotated[datetime, Meta(tz=True)]
    commit: ObjectId
    date: Annotated[datetime, Meta(tz=True)]
    writer: str
    cameras: Sha256


class SignedManifest(Record, tag_field="schema", tag="calibrary/published-3"):
    """The manifest, and the signature of its JSON as it stands in the file; null if it is not signed."""

    manifest: Manifest
    signature: str | None


class Opened(Struct, frozen=True, kw_only=True):
    """A manifest as it was read; its key is the fingerprint of the one that signed it."""

    manifest: Manifest
    key: str | None
    data: bytes


class NoManifestError(RegistryError):
    """A file that is not a manifest at all, such as the login page of a hotel."""


class _Parts(Struct, tag_field="schema", tag="calibrary/published-3"):
    """A signed manifest, with the bytes that are signed."""

    manifest: msgspec.Raw
    signature: str | None


def opened(data: bytes, source: str) -> Opened:
    """Read a manifest and verify its signature; whether its key is trusted is another question.

    Raises:
        NoManifestError: it is none.
        RegistryError: its signature is wrong.
    """
    try:
        parts = msgspec.json.decode(data, type=_Parts)
        signed = bytes(parts.manifest)
        manifest = msgspec.json.decode(signed, type=Manifest)
    except (msgspec.MsgspecError, UnicodeError, RecursionError):
        raise NoManifestError(f"{source}: this is no manifest of a published registry") from None
    try:
        key = fingerprint(signed_by(signed, parts.signature, NAMESPACE)) if parts.signature else None
    except BadSignatureError as error:
        raise RegistryError(f"{source}: its signature is {error}: the file was changed or damaged") from None
    return Opened(manifest=manifest, key=key, data=data)


def signed_bytes(manifest: Manifest, sign: Callable[[bytes], str] | None) -> bytes:
    """Return the file of a manifest, given what signs its bytes, if anything does."""
    signed = msgspec.json.encode(manifest)
    signature = sign(signed) if sign is not None else None
    return document_bytes(_Parts(manifest=msgspec.Raw(signed), signature=signature))


def document_bytes(document: Struct) -> bytes:
    """Return a published document: one line of JSON, deterministic."""
    return msgspec.json.encode(document) + b"\n"


def sha256(data: bytes) -> str:
    """Return the SHA-256 as 64 hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def file_of(digest: str) -> str:
    """Return the path of the file with a digest."""
    return f"{DATA}/{digest}.json"


def camera_of(path: str) -> str:
    """Return the name in the list of the camera whose entry has a path in the registry: its folder."""
    return path.removeprefix(ROOT).rpartition("/")[0]


def model_of(make: str, model: str) -> str:
    """Return the name in the list of a make and model."""
    return folder_of(make, model).removeprefix(ROOT).rstrip("/")


def require_trusted(
    found: Opened, known: Opened | None, signers: Path | None, url: str, memory: Path
) -> None:
    """Check that a manifest is by who may publish at an address, is not older than the last one, and has not expired.

    Args:
        found: the manifest.
        known: the one that was read there last.
        signers: file of accepted signers; None for trust on first use.
        url: the address.
        memory: file in which the known one is kept.

    Raises:
        RegistryError: it is not.
    """
    by, version, until = _by(found), found.manifest.version, found.manifest.until
    again = "its keeper runs 'calibrary registry publish' again"
    if signers is not None:
        if found.key not in _accepted(signers):
            raise RegistryError(f"{url}: is {by}, expected a key in {signers}")
    elif known is not None and known.key not in {None, found.key}:
        raise RegistryError(
            f"{url}: is {by}, and was {_by(known)} before; if its keeper confirms the change, remove {memory} and it "
            "is trusted anew"
        )
    if known is not None and version < known.manifest.version:
        raise RegistryError(
            f"{url}: version {version} is older than what was read there before ({known.manifest.version}), as a "
            f"restored backup or an attacker would serve it; {again}"
        )
    if until < datetime.now(UTC):
        raise RegistryError(
            f"{url}: what is published has expired on {until:%Y-%m-%d}: nobody published it again in time, or an old "
            f"copy of it is served; {again}"
        )


def _by(found: Opened) -> str:
    return f"signed by {found.key}" if found.key is not None else "not signed"


def _accepted(signers: Path) -> set[str | None]:
    try:
        lines = signers.read_text("utf-8", "replace").splitlines()
    except OSError:
        raise RegistryError(
            f"{signers}: no such file, expected one of allowed signers, as of ssh-keygen(1)"
        ) from None
    return {*map(_key, lines)} - {None}


def _key(line: str) -> str | None:
    """Return the fingerprint of the key in a line of allowed signers; None if it is of none that may publish."""
    try:
        words = shlex.split(line, comments=True)
        at = next(at for at, word in enumerate(words) if at and word.startswith(("ssh-", "ecdsa-", "sk-")))
    except (ValueError, StopIteration):
        return None
    for option in words[1:at]:
        name, _, value = option.partition("=")
        if name != "namespaces" or NAMESPACE not in value.split(","):
            return None
    blob = key_blob(" ".join(words[at : at + 2]))
    return fingerprint(blob) if blob is not None else None
