"""Opening of an image on a disk, in an archive, or behind a URL."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import lru_cache
from pathlib import Path
from urllib.parse import urlsplit

from calibrary.errors import InputError
from calibrary.jobs.images.archives import BETWEEN, TARS, RemoteZip, is_wanted, member_of, open_member
from calibrary.jobs.images.observation import Image
from calibrary.jobs.images.ranged import Remote, Store, StoreError, opened
from calibrary.parsers.files import is_image
from calibrary.parsers.imagery.source import Source, open_source

__all__ = ["images_at", "is_remote", "is_url", "open_place", "place_of", "shown"]


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
            below = found.key.removeprefix(prefix)
            if found.key.startswith(prefix) and is_image(Path(below)) and not _is_hidden(below):
                yield Image(below, f"{above}/{below}", None, found.version)
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
