"""The files of a published registry: their paths, derived from a camera's key, and their content.

``metadata/`` has the digests of the camera files (:mod:`calibrary.registry.published.metadata`), and a camera file
those of its entries. So every file can be verified, and that a file does not exist is known without asking for it. An
entry's file is named by its digest and never changes.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence
from datetime import datetime
from typing import Annotated, Final, TypeAlias

from calibrary.calibration import CameraKey, Grade, ImageSize
from calibrary.known_camera import match_key
from calibrary.records import Json, Meta, Record, to_json
from calibrary.registry.entry import Entry, Status, Validity
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.git.objects import ObjectId

METADATA_FOLDER: Final = "metadata"
CAMERA_FOLDER: Final = "models"
UNIT_FOLDER: Final = "units"
ENTRY_FOLDER: Final = "entries"
SCHEMA_FOLDER: Final = "schemas"
SCHEMAS: Final = ("published-2", "published-camera-1", "entry-1")
"""Schemas of the published files."""

LONGEST_PART: Final = 120
KEPT_OF_LONG: Final = 60

_PLAIN = frozenset(b"abcdefghijklmnopqrstuvwxyz0123456789-.")
_HEX64 = "[0-9a-f]{64}"
_OURS = re.compile(
    rf"(?:{ENTRY_FOLDER}/[0-9a-f]{{2}}/{_HEX64}|{METADATA_FOLDER}/\d+\.(?:snapshot|targets|bin-[0-9a-f]+)|"
    rf"{CAMERA_FOLDER}/[a-z0-9_~.-]+/[a-z0-9_~.-]+|{UNIT_FOLDER}/(?:[a-z0-9_~.-]+/){{3}}[a-z0-9_~.-]+)\.json"
)

Sha256: TypeAlias = Annotated[str, Meta(pattern=f"^{_HEX64}$")]


class EarlierRevision(Record):
    """An earlier revision of an entry, for images of its days.

    Attributes:
        commit: commit of the registry at which it was the newest.
        validity: days on which it may be used; every day when null.
        sha256: SHA-256 of its file in entries/.
    """

    commit: ObjectId
    validity: Validity | None
    sha256: Sha256


class PublishedEntry(Record):
    """An entry of a camera: its distinguishing fields, and the digest of its file.

    Attributes:
        path: path of its file in the registry.
        status: approved or held; retired entries are listed but not used.
        reason: reason for the status.
        grade: origin of the intrinsics.
        image_size: (width, height) px.
        sub_camera, lens, focal_mm, capture_mode: properties of the images it applies to; any when null.
        firmware: firmware versions it applies to; any when null.
        validity: days of the images it applies to; every day when null.
        sha256: SHA-256 of its file in entries/, 64 hexadecimal digits.
        earlier: revisions for images of earlier days, newest first.
    """

    path: str
    status: Status
    reason: str | None
    grade: Grade
    image_size: ImageSize
    sub_camera: str | None
    lens: str | None
    focal_mm: float | None
    capture_mode: str | None
    firmware: FirmwareRange | None
    validity: Validity | None
    sha256: Sha256
    earlier: tuple[EarlierRevision, ...] = ()

    @classmethod
    def of(
        cls, entry: Entry, path: str, digest: str, earlier: Sequence[EarlierRevision] = ()
    ) -> PublishedEntry:
        """Make the row of an entry, given the digest of its file."""
        calibration = entry.calibration
        camera = calibration.camera
        return cls(
            path=path,
            status=entry.status,
            reason=entry.reason,
            grade=calibration.grade,
            image_size=calibration.intrinsics.image_size,
            sub_camera=camera.sub_camera,
            lens=camera.lens,
            focal_mm=camera.focal_mm,
            capture_mode=camera.capture_mode,
            firmware=entry.firmware,
            validity=entry.validity,
            sha256=digest,
            earlier=tuple(earlier),
        )


class CameraName(Record):
    """Make and model as in EXIF."""

    make: str
    model: str

    @property
    def path(self) -> str:
        """Path of the camera file of this make and model."""
        return camera_path(CameraKey(make=self.make, model=self.model))


class PublishedCamera(Record, tag_field="schema", tag="calibrary/published-camera-1"):
    """The entries of a make and model, or of one unit.

    Attributes:
        make, model: as in EXIF.
        serial: hash of the unit's serial number; null for entries of the model.
        entries: entries, by path.
        aliases: cameras in other files that may have taken images with this make and model.
    """

    make: str
    model: str
    serial: str | None
    entries: tuple[PublishedEntry, ...]
    aliases: tuple[CameraName, ...]


class PublishedState(Record, tag_field="schema", tag="calibrary/published-2"):
    """What a publication is of; part of its snapshot metadata.

    Attributes:
        commit: published commit of the registry.
        date: date of that commit, UTC.
        entries: number of entries, without their earlier revisions.
        cameras: number of camera files.
    """

    commit: ObjectId
    date: datetime
    entries: Annotated[int, Meta(ge=0)]
    cameras: Annotated[int, Meta(ge=0)]


def sha256(data: bytes) -> str:
    """Return the SHA-256 as 64 hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def document_bytes(document: Record | dict[str, Json]) -> bytes:
    """Return a published document: one line of JSON, deterministic."""
    content = to_json(document) if isinstance(document, Record) else document
    return (json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False) + "\n").encode()


def camera_path(key: CameraKey) -> str:
    """Return the path of the file of a make and model, or of a unit if the key has a serial number (its hash).

    The key must have make and model.
    """
    make, model = _part(key.make or ""), _part(key.model or "")
    if key.serial is None:
        return f"{CAMERA_FOLDER}/{make}/{model}.json"
    unit = _part(key.serial)
    return f"{UNIT_FOLDER}/{make}/{model}/{unit[:2]}/{unit}.json"


def units_folder(path: str) -> str | None:
    """Return the folder of a model's unit files, given the path of the model's file; None for a unit's file."""
    if not path.startswith(f"{CAMERA_FOLDER}/"):
        return None
    return f"{UNIT_FOLDER}{path.removeprefix(CAMERA_FOLDER).removesuffix('.json')}/"


def _part(text: str) -> str:
    """Return a name as one part of a path, of characters that need no escaping in a URL; the mapping is unique."""
    data = match_key(text).encode("utf-8", "surrogatepass")
    last = len(data) - 1
    part = "".join(
        chr(byte)
        if byte in _PLAIN and (at not in {0, last} or byte not in b"-.")
        else "_"
        if byte == 0x20
        else f"~{byte:02x}"
        for at, byte in enumerate(data)
    )
    if not part:
        return "~"
    return part if len(part) <= LONGEST_PART else f"{part[:KEPT_OF_LONG]}~~{sha256(data)[:32]}"


def entry_path(digest: str) -> str:
    """Return the path of the entry file with a digest."""
    return f"{ENTRY_FOLDER}/{digest[:2]}/{digest}.json"


def is_ours(path: str) -> bool:
    """Return whether a file may be a published one, by its path."""
    return _OURS.fullmatch(path) is not None
