"""What was read over HTTP, kept in the user's cache folder; everything in it is verified again when it is used.

Roots are kept by their address, all other files by their digest. The folder may be deleted at any time.
"""

from __future__ import annotations

import secrets
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Final

from platformdirs import user_cache_path

from calibrary.errors import ParseError
from calibrary.records import Record, from_json
from calibrary.registry.published.layout import Sha256, document_bytes, sha256
from calibrary.strictjson import parse_json

__all__ = ["Cache", "CachedRoot"]

LARGEST: Final = 16 << 20


class CachedRoot(Record, tag_field="schema", tag="calibrary/cached-root-1"):
    """The root of a published registry as it was read.

    Attributes:
        url: of the registry.
        etag: by which the server knows it.
        read: when, or when the server last said that it is still the same.
        sha256: of the text.
        text: of calibrary.json.
        signature: of calibrary.json.sig; None where there was none.
    """

    url: str
    etag: str | None
    read: datetime
    sha256: Sha256
    text: str
    signature: str | None


@dataclass(frozen=True, slots=True)
class Cache:
    """A folder of files that were read.

    Attributes:
        folder: made when something is first put there. If that fails, the next run only takes longer.
    """

    folder: Path

    @classmethod
    def of_user(cls) -> Cache:
        """The one in the user's cache folder."""
        return cls(user_cache_path("calibrary", appauthor=False) / "published")

    def root(self, url: str) -> CachedRoot | None:
        """The root that was last read from an address; None where there is none that is whole."""
        file = self._root_file(url)
        try:
            found = from_json(CachedRoot, parse_json(_read(file), source=file.name), source=file.name)
        except (OSError, ParseError):
            return None
        return found if found.url == url and sha256(found.text.encode()) == found.sha256 else None

    def keep_root(self, root: CachedRoot) -> None:
        """Keep a root in the place of the one before."""
        _write(self._root_file(root.url), document_bytes(root))

    def get(self, digest: str) -> bytes | None:
        """The file of a digest; None where there is none, or it was damaged."""
        try:
            data = _read(self._file(digest))
        except OSError:
            return None
        return data if sha256(data) == digest else None

    def keep(self, data: bytes) -> None:
        """Keep a file by its digest."""
        _write(self._file(sha256(data)), data)

    def _root_file(self, url: str) -> Path:
        return self.folder / "roots" / f"{sha256(url.encode('utf-8', 'surrogatepass'))[:32]}.json"

    def _file(self, digest: str) -> Path:
        return self.folder / "files" / digest[:2] / digest


def _read(file: Path) -> bytes:
    with file.open("rb") as opened:
        return opened.read(LARGEST)


def _write(file: Path, data: bytes) -> None:
    """Write a file whole, or not at all; that it outlives a loss of power takes no waiting, as it is verified again."""
    temporary = file.with_name(f".{file.name[:40]}.{secrets.token_hex(4)}")
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        try:
            temporary.write_bytes(data)
            temporary.replace(file)
        finally:
            temporary.unlink(missing_ok=True)
