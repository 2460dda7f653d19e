"""The files of a published registry: their paths, derived from a camera's key, and their content.

``calibrary.json`` is the root. It contains the digests of a tree of small files, the leaves of the tree those of the
camera files, and a camera file those of its entries. So with a trusted root, every other file can be verified, and the
tree shows that a file does not exist. An entry's file is named by its digest and never changes.
"""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Annotated, Final, TypeAlias

from calibrary.calibration import CameraKey, Grade, ImageSize
from calibrary.errors import RegistryError
from calibrary.known_camera import match_key
from calibrary.records import Json, Meta, Record, to_json
from calibrary.registry.entry import Entry, Status, Validity
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.git.objects import ObjectId

__all__ = [
    "CAMERA_FOLDER",
    "ENTRY_FOLDER",
    "NAMESPACE",
    "ROOT_FILE",
    "SCHEMAS",
    "SCHEMA_FOLDER",
    "SIGNATURE_FILE",
    "TREE_FOLDER",
    "UNIT_FOLDER",
    "WIDTH",
    "CameraName",
    "EarlierRevision",
    "PublishedCamera",
    "PublishedEntry",
    "PublishedRegistry",
    "PublishedTree",
    "camera_path",
    "depth_for",
    "document_bytes",
    "entry_path",
    "is_ours",
    "reason_against",
    "sha256",
    "sign",
    "tree_paths",
    "units_folder",
]

ROOT_FILE: Final = "calibrary.json"
SIGNATURE_FILE: Final = f"{ROOT_FILE}.sig"
NAMESPACE: Final = "calibrary-published"
"""Namespace of a root's ssh signature, so that no other signature by the same key is accepted."""

CAMERA_FOLDER: Final = "models"
UNIT_FOLDER: Final = "units"
TREE_FOLDER: Final = "tree"
ENTRY_FOLDER: Final = "entries"
SCHEMA_FOLDER: Final = "schemas"
SCHEMAS: Final = ("published-1", "published-tree-1", "published-camera-1", "entry-1")
"""Schemas of the published files."""

LONGEST_PART: Final = 120
KEPT_OF_LONG: Final = 60
WIDTH: Final = 2
"""Hexadecimal digits of a path's hash per level of the tree."""
LEAF: Final = 256
"""Largest average number of camera files in a leaf of the tree."""
DEEPEST: Final = 3

_PLAIN = frozenset(b"abcdefghijklmnopqrstuvwxyz0123456789-.")
_HEX64 = "[0-9a-f]{64}"
_OURS = re.compile(
    rf"(?:{ENTRY_FOLDER}/[0-9a-f]{{2}}/{_HEX64}|{TREE_FOLDER}/(?:[0-9a-f]{{2}}/)*[0-9a-f]{{2}}|"
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


class PublishedTree(Record, tag_field="schema", tag="calibrary/published-tree-1"):
    """A part of the tree of digests.

    Attributes:
        tree: SHA-256 of files: of the next level by two more hexadecimal digits, or of camera files by path.
    """

    tree: dict[str, Sha256]


class PublishedRegistry(Record, tag_field="schema", tag="calibrary/published-1"):
    """The root of a published registry.

    Attributes:
        commit: published commit of the registry.
        date: date of that commit, UTC.
        entries: number of entries, without their earlier revisions.
        cameras: number of camera files.
        depth: number of levels in tree/ between this file and the camera files.
        tree: SHA-256 of files: in tree/ by two hexadecimal digits, or of camera files by path if depth is 0.
    """

    commit: ObjectId
    date: datetime
    entries: Annotated[int, Meta(ge=0)]
    cameras: Annotated[int, Meta(ge=0)]
    depth: Annotated[int, Meta(ge=0, le=DEEPEST)]
    tree: dict[str, Sha256]


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


def depth_for(cameras: int) -> int:
    """Return the number of tree levels for a number of camera files."""
    return next((depth for depth in range(DEEPEST) if cameras <= LEAF ** (depth + 1)), DEEPEST)


def tree_paths(path: str, depth: int) -> Iterator[tuple[str, str | None]]:
    """Yield (name, path of the file it refers to) in each part of the tree, from the root to a camera file."""
    digits, folder = sha256(path.encode()), TREE_FOLDER
    for level in range(depth):
        name = digits[level * WIDTH : (level + 1) * WIDTH]
        folder = f"{folder}/{name}"
        yield name, f"{folder}.json"
    yield path, path


def is_ours(path: str) -> bool:
    """Return whether a file may be a published one, by its path."""
    return _OURS.fullmatch(path) is not None


def sign(data: bytes, key: Path) -> bytes:
    """Sign a root.

    Raises:
        RegistryError: ssh-keygen is not installed, or cannot sign with this key.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / ROOT_FILE
        file.write_bytes(data)
        done = _ssh_keygen("sign", "-n", NAMESPACE, "-f", str(key), str(file))
        if done.returncode != 0:
            errors = done.stderr.decode("utf-8", "replace").strip().splitlines()
            raise RegistryError(
                f"{key}: ssh-keygen cannot sign with it: {errors[-1] if errors else 'no reason given'}"
            )
        return file.with_name(SIGNATURE_FILE).read_bytes()


def reason_against(data: bytes, signature: str, signers: Path) -> str | None:
    """Return why a signature of a root is not accepted; None if it is by an accepted signer.

    Args:
        data: the root.
        signature: signature in the form of :func:`sign`.
        signers: an "ALLOWED SIGNERS" file of ssh-keygen(1).

    Raises:
        RegistryError: ssh-keygen is not installed, or the file does not exist.
    """
    if not signers.is_file():
        raise RegistryError(f"{signers}: no such file, expected one of allowed signers, as of ssh-keygen(1)")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / SIGNATURE_FILE
        file.write_text(signature, encoding="utf-8")
        given = ("-s", str(file), "-f", str(signers))
        names = _ssh_keygen("find-principals", *given).stdout.decode("utf-8", "replace").splitlines()
        for name in (name.strip() for line in names for name in line.split(",")):
            if _ssh_keygen("verify", "-n", NAMESPACE, "-I", name, *given, data=data).returncode == 0:
                return None
    return f"is not signed by a key in {signers}"


def _ssh_keygen(action: str, *arguments: str, data: bytes = b"") -> subprocess.CompletedProcess[bytes]:
    command = ["ssh-keygen", "-Y", action, *arguments]
    try:
        return subprocess.run(command, input=data, capture_output=True, check=False)  # noqa: S603  a fixed program
    except FileNotFoundError:
        raise RegistryError("ssh-keygen is not installed, and signatures need it") from None
