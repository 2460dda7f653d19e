"""Cache of files read over HTTP, in the user's cache folder; every file is verified again when it is used.

The manifest that was read last is stored by its address, all other files by their digest. The folder may be deleted at
any time, but an address is then trusted anew. Its size is limited: what was not used for the longest time goes first.
"""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from platformdirs import user_cache_path

from calibrary.registry.published.manifest import LARGEST_LIST, sha256

TRUSTED, FILES = "trusted", "files"
"""Folders of the cache."""
CACHE_MIB: Final = "CALIBRARY_CACHE_MIB"
"""Environment variable with the largest size of the cache of published registries, in MiB."""
USUAL_MIB: Final = 256
LONGEST_S: Final = 365 * 86_400
"""Seconds that a file is kept without being used."""
EVERY_S: Final = 86_400
"""Seconds after which it is noted again that a file is used."""
OFTEN: Final = 16
"""A process prunes again after writing this fraction of the limit."""


@dataclass(slots=True)
class Cache:
    """A cache folder.

    Attributes:
        folder: the folder, created at the first write. If that fails, the next run only takes longer.
        written: bytes written by this process since the folder was last pruned; None before its first write.
    """

    folder: Path
    written: int | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of_user(cls) -> Cache:
        """Return the cache in the user's cache folder."""
        return cls(user_cache_path("calibrary", appauthor=False) / "published")

    def trusted(self, url: str) -> Path:
        """Return the file with the manifest that was read last at an address."""
        return self.folder / TRUSTED / f"{sha256(url.encode('utf-8', 'surrogatepass'))[:32]}.json"

    def get(self, digest: str) -> bytes | None:
        """Return the file with a digest; None if there is none, or it is damaged."""
        file = self._file(digest)
        try:
            with file.open("rb") as opened:
                data = opened.read(LARGEST_LIST)
            if time.time() - file.stat().st_mtime > EVERY_S:
                os.utime(file)
        except OSError:
            return None
        return data if sha256(data) == digest else None

    def keep(self, data: bytes, digest: str) -> None:
        """Store a file by its digest; from time to time, old files are then removed.

        It is not waited for the disk: a part of a file is told by its digest when it is used.
        """
        file = self._file(digest)
        with suppress(OSError):
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
        if self.written is None or self.written + len(data) > _limit() // OFTEN:
            prune(self.folder)
            self.written = 0
        else:
            self.written += len(data)

    def _file(self, digest: str) -> Path:
        return self.folder / FILES / digest[:2] / digest


def prune(folder: Path, *, limit: int | None = None) -> int:
    """Remove files that were not used for long, and above the limit those unused for the longest; return their number.

    Args:
        folder: folder of the cache.
        limit: bytes; by default from $CALIBRARY_CACHE_MIB.
    """
    found, removed = list[tuple[float, int, Path]](), 0
    for at, _, names in os.walk(folder / FILES):
        for file in (Path(at, name) for name in names):
            with suppress(OSError):
                found.append((file.stat().st_mtime, file.stat().st_size, file))
    total, most = sum(size for _, size, _ in found), _limit() if limit is None else limit
    for used, size, file in sorted(found):
        if time.time() - used <= LONGEST_S and total <= most:
            break
        with suppress(OSError):
            file.unlink()
            total -= size
            removed += 1
    return removed


def _limit() -> int:
    stated = os.environ.get(CACHE_MIB, "")
    return (int(stated) if stated.isdecimal() else USUAL_MIB) << 20
