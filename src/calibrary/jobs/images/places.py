"""Opening of an image on a disk, in an archive, or behind a URL.

Images inside zip and tar files are read without unpacking them.
"""

from __future__ import annotations

import io
import struct
import tarfile
import threading
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO, Final, cast
from urllib.parse import urlsplit

from calibrary.errors import InputError
from calibrary.jobs.images.observation import Image
from calibrary.jobs.images.ranged import Remote, Store, StoreError, opened
from calibrary.parsers.files import is_image
from calibrary.parsers.imagery.source import Source, open_source

ARCHIVES: Final = {".zip": "zip", ".tar": "tar"}
LARGEST: Final = 1 << 32
"""Largest compressed member in bytes; it can only be read from its beginning, and no image is larger."""
BETWEEN: Final = "!/"
"""Separator between an archive and its member in a place."""
TARS: Final = (".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tar.xz")
LOCAL_HEADER: Final = struct.Struct("<4s22xHH")
"""Header of a member of a zip file: signature, lengths of the name and of the extra field."""


def archive_of(given: Path | str) -> tuple[str, Path] | None:
    """The kind of archive and its file, if ``given`` is one: by a URL such as zip://flight.zip, or by its suffix."""
    text = str(given)
    kind, separator, path = text.partition("://")
    if separator and kind in {"zip", "tar"}:
        return (kind, Path(path)) if "://" not in path else None
    suffix = ".tar" if text.lower().endswith(TARS) else Path(text).suffix.lower()
    return (ARCHIVES[suffix], Path(text)) if suffix in ARCHIVES and Path(text).is_file() else None


def members(kind: str, archive: Path) -> Iterator[tuple[str, str]]:
    """Yield the images in an archive: name, and the place by which to open it.

    Raises:
        InputError: the file does not exist or is not such an archive.
    """
    real = archive.resolve()
    try:
        if kind == "zip":
            for member in _zip(str(real)).infolist():
                if is_wanted(member):
                    yield member.filename, f"zip://{real}{BETWEEN}{member.filename}"
            return
        with tarfile.open(real, "r:") as opened:
            for part in opened:
                # "tar -c ." writes ./ before every name.
                name = part.name.removeprefix("./")
                if part.isreg() and not part.sparse and _is_wanted(name):
                    yield name, f"tar://{real}{BETWEEN}{part.offset_data}+{part.size}{BETWEEN}{name}"
    except tarfile.ReadError:
        reason = "is not a tar file; a compressed one has to be unpacked first, or made a zip file"
        raise InputError(reason, source=str(archive)) from None
    except (OSError, zipfile.BadZipFile) as error:
        reason = getattr(error, "strerror", None) or "is not a zip file"
        raise InputError(f"cannot be read: {reason}", source=str(archive)) from None


def is_wanted(member: zipfile.ZipInfo) -> bool:
    """Whether a member of a zip file is an image and not hidden."""
    return not member.is_dir() and _is_wanted(member.filename)


def _is_wanted(name: str) -> bool:
    return is_image(Path(name)) and not any(part.startswith(".") for part in name.split("/"))


@contextmanager
def open_member(place: str) -> Iterator[Source]:
    """Open one image of an archive by its place from :func:`members`.

    Raises:
        InputError: the archive or the image cannot be read.
    """
    kind, _, rest = place.partition("://")
    archive, _, member = rest.partition(BETWEEN)
    name = member.rpartition("/")[2]
    try:
        if kind == "tar":
            at, _, _ = member.partition(BETWEEN)
            start, size = (int(number) for number in at.split("+"))
            with Path(archive).open("rb", buffering=0) as file:
                yield Source(cast("BinaryIO", _Part(file, start, size)), name=name, size=size)
            return
        info = _zip(archive).getinfo(member)
        if info.file_size > LARGEST:
            raise InputError(f"claims {info.file_size} bytes, which no image has", source=name)
        with _zip(archive).open(info) as opened:
            yield Source(cast("BinaryIO", opened), name=name, size=info.file_size)
    except (OSError, EOFError, zlib.error, zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        reason = "is encrypted" if "encrypted" in str(error) else "is damaged in its archive"
        raise InputError(f"cannot be read: {reason}", source=name) from None
    except KeyError:
        raise InputError("is not in its archive any more", source=name) from None


class RemoteZip(zipfile.ZipFile):
    """A zip file on a server.

    Attributes:
        remote: the file on the server.
    """

    def __init__(self, remote: Remote) -> None:
        self.remote = remote
        super().__init__(remote.ranged(head=True).as_file())


@contextmanager
def member_of(archive: zipfile.ZipFile, remote: Remote, member: str) -> Iterator[Source]:
    """Open one image of a zip file on a server, with its own range requests so that several can be read in parallel.

    Raises:
        InputError: the image cannot be read.
        StoreError: the server does not deliver it, or the archive has changed in the meantime.
    """
    name = member.rpartition("/")[2]
    try:
        info = archive.getinfo(member)
        if info.flag_bits & 1:
            raise InputError("cannot be read: is encrypted", source=name)
        if info.file_size > LARGEST:
            raise InputError(f"claims {info.file_size} bytes, which no image has", source=name)
        file = remote.ranged(head=False).as_file()
        file.seek(info.header_offset)
        signature, name_length, extra_length = LOCAL_HEADER.unpack(file.read(LOCAL_HEADER.size))
        if signature != b"PK\3\4":
            raise InputError("cannot be read: is damaged in its archive", source=name)
        file.seek(name_length + extra_length, io.SEEK_CUR)
        with zipfile.ZipExtFile(file, "r", info, close_fileobj=True) as opened:
            yield Source(cast("BinaryIO", opened), name=name, size=info.file_size)
    except (struct.error, EOFError, zlib.error, zipfile.BadZipFile, NotImplementedError) as error:
        raise InputError("cannot be read: is damaged in its archive", source=name) from error
    except KeyError:
        raise InputError("is not in its archive any more", source=name) from None


class _Part:
    """A file-like object for a part of a file."""

    def __init__(self, file: io.FileIO, start: int, size: int) -> None:
        self._file, self._start, self._size, self._at = file, start, size, 0

    def seek(self, offset: int) -> None:
        self._at = offset

    def read(self, size: int) -> bytes:
        self._file.seek(self._start + self._at)
        return self._file.read(max(0, min(size, self._size - self._at)))


_OPEN = threading.Lock()


def _zip(path: str) -> zipfile.ZipFile:
    """Open an archive; its directory is read once per process."""
    with _OPEN:
        status = Path(path).stat()
        return _opened(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=8)
def _opened(path: str, _modified: int, _size: int) -> zipfile.ZipFile:
    return zipfile.ZipFile(path)


def is_url(given: object) -> bool:
    """Whether an image is given by a URL, not by a path."""
    return "://" in str(given)


def place_of(given: str | Path) -> str | Path:
    """Convert an image or folder given as text: a URL stays text, anything else becomes a path."""
    text = str(given)
    if text.startswith("file://"):
        from urllib.request import url2pathname  # noqa: PLC0415  it loads HTTP and TLS

        return Path(url2pathname(urlsplit(text).path))
    return text if is_url(text) else Path(given)


def is_remote(place: str) -> bool:
    """Whether a place is on a server, so that reading it is mostly waiting."""
    return is_url(place.removeprefix("zip://")) and not place.startswith(("tar://", "file://"))


def open_place(place: str) -> AbstractContextManager[Source]:
    """Context manager that opens an image.

    Raises:
        InputError: the image cannot be opened or read.
        StoreError: the server does not deliver it.
    """
    if not is_url(place):
        return open_source(place)
    if place.startswith("zip://") and is_remote(place):
        return open_zipped(place)
    if place.startswith(("zip://", "tar://")):
        return open_member(place)
    store, key = _located(place)
    return opened(store, key, key.partition("?")[0].rpartition("/")[2])


def images_at(url: str) -> Iterator[Image]:
    """Yield the image at a URL, or all files below it with the suffix of an image.

    Raises:
        InputError: the store cannot be listed.
    """
    url = url.removeprefix("zip://")
    key = _key(url)
    name = key.partition("?")[0] if _is_web(url) else key
    if name.endswith(TARS):
        reason = "is a tar file, which has no directory to find an image by; unpack it, or make it a zip file"
        raise InputError(reason, source=shown(url))
    if name.endswith(".zip"):
        for member in zipped(url).infolist():
            if is_wanted(member):
                yield Image(member.filename, f"zip://{url}{BETWEEN}{member.filename}")
        return
    if _is_web(url) or is_image(Path(key)):
        yield Image(shown(url), url)
        return
    above, prefix = url.rstrip("/"), f"{key.strip('/')}/" if key.strip("/") else ""
    try:
        store, _ = _located(url)
        for found in store.listed(prefix.rstrip("/")):
            below = found.removeprefix(prefix)
            if found.startswith(prefix) and is_image(Path(below)) and not _is_hidden(below):
                yield Image(below, f"{above}/{below}")
    except StoreError as error:
        raise InputError(f"cannot be listed: {error.message}", source=shown(url)) from None


def shown(url: str) -> str:
    """A URL for reports, without user, password and signature."""
    if url.startswith("zip://"):
        archive, _, member = url.removeprefix("zip://").partition(BETWEEN)
        return f"{shown(archive)}/{member}"
    scheme, _, rest = url.partition("://")
    netloc, slash, key = rest.partition("/")
    key = key.partition("?")[0].partition("#")[0] if _is_web(url) else key
    return f"{scheme}://{netloc.rpartition('@')[2]}{slash}{key}"


@contextmanager
def open_zipped(place: str) -> Iterator[Source]:
    """Open one image of a zip file on a store or web server; only the needed parts are fetched.

    Raises:
        InputError: the image is damaged, encrypted, or no longer exists.
        StoreError: the server does not deliver it, or the archive has changed in the meantime.
    """
    url, _, member = place.removeprefix("zip://").partition(BETWEEN)
    archive = zipped(url)
    with member_of(archive, archive.remote, member) as source:
        yield source


@lru_cache(maxsize=8)
def zipped(url: str) -> RemoteZip:
    """Open a zip file behind a URL; its directory is read once per process.

    Raises:
        InputError: it is not a zip file, or the server does not deliver it.
    """
    try:
        return RemoteZip(Remote(*_located(url)))
    except StoreError as error:
        raise InputError(f"cannot be read: {error.message}", source=shown(url)) from None
    except zipfile.BadZipFile:
        raise InputError("cannot be read: is not a zip file", source=shown(url)) from None


def _is_web(url: str) -> bool:
    return url.startswith(("http://", "https://"))


def _located(url: str) -> tuple[Store, str]:
    parts = urlsplit(url)
    # What talks to servers is loaded for them only.
    if _is_web(url):
        from calibrary.jobs.images.web import web_server  # noqa: PLC0415

        return web_server(parts.scheme, parts.netloc), _key(url).partition("#")[0]
    from calibrary.jobs.images.buckets import bucket  # noqa: PLC0415

    return bucket(parts.scheme, parts.netloc), _key(url)


def _key(url: str) -> str:
    """The part of a URL after the bucket; object names may contain ?, # and %."""
    return url.partition("://")[2].partition("/")[2]


def _is_hidden(name: str) -> bool:
    return any(part.startswith(".") for part in name.split("/"))
