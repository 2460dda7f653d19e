"""Images in object stores: S3, Google and Azure through obstore, all others through fsspec.

Credentials come from the environment, a profile or the machine's role, as in each store's own programs. Error
messages of a store are replaced by our own, because they may contain a signed URL.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from typing import Any, Final

from calibrary.extras import require
from calibrary.jobs.images.aws_profile import options
from calibrary.jobs.images.ranged import First, Listed, Store, StoreError

__all__ = ["OBSTORE", "bucket"]

OBSTORE: Final = frozenset({"s3", "s3a", "gs", "az", "azure", "abfs", "abfss", "adl"})
NEEDS: Final = "reading images from object stores"
_STATUS = re.compile(r"status code: ([45]\d\d)\b")


@cache
def bucket(scheme: str, netloc: str) -> Store:
    """Open the store of a URL.

    Raises:
        MissingExtraError: the library for it is not installed.
        StoreError: the store is not configured.
    """
    if scheme in OBSTORE:
        require(["obstore"], NEEDS)
        return _Bucket(f"{scheme}://{netloc}")
    require(["fsspec"], NEEDS)
    return _FileSystem(scheme, netloc)


class _Bucket:
    """One bucket or container, through obstore."""

    def __init__(self, url: str) -> None:
        self._obstore: Any = import_module("obstore")
        self._errors: Any = import_module("obstore.exceptions")
        try:
            # Retries are made in one place, for every kind of store.
            self._store = import_module("obstore.store").from_url(
                url, retry_config={"max_retries": 0}, **(options() if url.startswith("s3") else {})
            )
        except (OSError, ValueError, self._errors.BaseError) as error:
            raise StoreError(f"the store is not set up: {type(error).__name__}") from None

    def first(self, key: str, size: int) -> First:
        """The first ``size`` bytes of a file, with its total size and version."""
        try:
            found = self._obstore.get(self._store, key, options={"range": (0, size)})
            data = bytes(found.bytes())
            meta = found.meta
        except (OSError, ValueError, self._errors.BaseError) as error:
            raise self._as_store_error(error) from None
        if len(data) != min(size, meta["size"]):
            raise StoreError(f"the store sent {len(data)} of {min(size, meta['size'])} bytes", passing=True)
        return First(data, meta["size"], meta["e_tag"])

    def part(self, key: str, start: int, end: int, version: str | None) -> bytes:
        """The bytes from ``start`` up to, not including, ``end``; fails if the version differs."""
        options = {"range": (start, end)} | ({"if_match": version} if version else {})
        try:
            return bytes(self._obstore.get(self._store, key, options=options).bytes())
        except (OSError, ValueError, self._errors.BaseError) as error:
            raise self._as_store_error(error) from None

    def listed(self, prefix: str) -> Iterator[Listed]:
        """Yield all files below a prefix, in the order of the bytes of their keys."""
        try:
            for chunk in self._obstore.list(self._store, prefix=prefix or None, chunk_size=1000):
                for one in chunk:
                    version = one["e_tag"] or f"{one['size']}-{one['last_modified']}"
                    yield Listed(one["path"], version)
        except (OSError, ValueError, self._errors.BaseError) as error:
            raise self._as_store_error(error) from None

    def _as_store_error(self, error: Exception) -> StoreError:
        errors = self._errors
        found = _STATUS.search(str(error))
        status = found[1] if found is not None else None
        if isinstance(error, errors.NotFoundError | FileNotFoundError) or status == "404":
            return StoreError("is not there (404)")
        denied = errors.PermissionDeniedError | errors.UnauthenticatedError | PermissionError
        if isinstance(error, denied) or status in {"401", "403"}:
            return StoreError(f"access is denied ({status or 403})")
        if isinstance(error, errors.PreconditionError):
            return StoreError("was changed while it was read (412)")
        if status == "416":
            return StoreError("is empty, or was cut while it was read (416)")
        if "error sending request" in str(error):
            return StoreError("the store's server cannot be reached", passing=True)
        return StoreError(f"the store cannot be read ({status or type(error).__name__})", passing=True)


class _FileSystem:
    """Any other kind of storage, through its fsspec library."""

    def __init__(self, scheme: str, netloc: str) -> None:
        self._above = netloc
        try:
            fsspec: Any = import_module("fsspec")
            options = fsspec.core.url_to_fs(f"{scheme}://{netloc}/")
        except ImportError as error:
            raise StoreError(f"{scheme}:// needs another library: {str(error).splitlines()[0]}") from None
        except ValueError:
            raise StoreError(f"{scheme}:// is not a storage that fsspec knows") from None
        self._system, self._above = options[0], options[1].rstrip("/")

    def first(self, key: str, size: int) -> First:
        """The first ``size`` bytes of a file, with its total size and version."""
        try:
            found = self._system.info(self._path(key))
            if found["type"] != "file":
                raise StoreError("is not a file")
            data = bytes(self._system.cat_file(self._path(key), start=0, end=min(size, found["size"])))
            return First(data, found["size"], self._version(found))
        except (OSError, ValueError) as error:
            raise self._as_store_error(error) from None

    def part(self, key: str, start: int, end: int, version: str | None) -> bytes:
        """The bytes from ``start`` up to, not including, ``end``; fails if the version differs."""
        try:
            data = bytes(self._system.cat_file(self._path(key), start=start, end=end))
            if self._version(self._system.info(self._path(key))) != version:
                raise StoreError("was changed while it was read")
        except (OSError, ValueError) as error:
            raise self._as_store_error(error) from None
        return data

    def listed(self, prefix: str) -> Iterator[Listed]:
        """Yield all files below a prefix, in the order of the bytes of their keys."""
        try:
            found = self._system.find(self._path(prefix), detail=True)
        except (OSError, ValueError) as error:
            raise self._as_store_error(error) from None
        for path in sorted(found):
            yield Listed(path.removeprefix(self._above).lstrip("/"), self._version(found[path]))

    def _path(self, key: str) -> str:
        return f"{self._above}/{key}"

    def _version(self, found: dict[str, Any]) -> str | None:
        stated = found.get("ETag") or found.get("etag") or found.get("mtime") or found.get("created")
        return f"{found.get('size')}-{stated}"

    def _as_store_error(self, error: Exception) -> StoreError:
        if isinstance(error, FileNotFoundError):
            return StoreError("is not there")
        if isinstance(error, PermissionError):
            return StoreError("access is denied")
        return StoreError(f"the store cannot be read ({type(error).__name__})", passing=True)
