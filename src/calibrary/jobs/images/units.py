"""Pieces of work, each read by one process, and their results from an earlier run."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

from msgspec import Struct

from calibrary.atomic import write_files
from calibrary.errors import InputError
from calibrary.jobs.images.accumulator import Accumulator
from calibrary.jobs.images.observation import Image
from calibrary.progress import log

__all__ = ["SHARD", "Partials", "Unit", "batches", "shards"]

SHARD = 8192
"""Average number of images per shard: some seconds of work, and a file of 150 kB."""
MOST = 4


class Unit(Struct, frozen=True):
    """A piece of work: images that one process reads.

    Attributes:
        images: at least one.
        key: of its partial result; None if none is kept.
    """

    images: tuple[Image, ...]
    key: str | None = None

    def pickled(self) -> bytes:
        """Serialise for another process, as plain tuples: faster than objects, and names may contain any bytes."""
        rows = [(one.name, one.place, one.same_as, one.version) for one in self.images]
        return pickle.dumps((rows, self.key), protocol=5)

    @classmethod
    def unpickled(cls, data: bytes) -> Unit:
        """Restore from :meth:`pickled`; must not be used with data from elsewhere."""
        rows, key = pickle.loads(data)  # noqa: S301  our own
        return cls(tuple(Image(*row) for row in rows), key)


def batches(images: Iterable[Image], size: int) -> Iterator[Unit]:
    """Yield pieces of ``size`` images."""
    left = iter(images)
    while batch := tuple(islice(left, size)):
        yield Unit(batch)


def shards(images: Iterable[Image], size: int = SHARD) -> Iterator[Unit]:
    """Yield pieces of about ``size`` images that stay the same if images are added or removed elsewhere.

    The end of a shard is determined by its last image and not by a count, so a new image changes only its own
    shard.
    """
    shard: list[Image] = []
    for image in images:
        shard.append(image)
        if int.from_bytes(image.id[-4:], "big") % size == 0 or len(shard) >= MOST * size:
            yield Unit(tuple(shard), _key(shard))
            shard = []
    if shard:
        yield Unit(tuple(shard), _key(shard))


def _key(images: list[Image]) -> str:
    """Digest of a shard's content: identities, names and versions of its images."""
    digest = hashlib.blake2b(digest_size=16)
    for image in images:
        for text in (image.place, image.name, image.version or ""):
            digest.update(text.encode(errors="surrogateescape") + b"\0")
    return digest.hexdigest()


class Partials:
    """A folder of partial results, one file per shard, each complete or absent.

    Args:
        folder: of the files; created when the first is written.
        question: what to read; a partial result is used only if it is for the same question.
    """

    def __init__(self, folder: Path, question: str) -> None:
        if folder.exists() and not folder.is_dir():
            raise InputError("is a file; expected a folder for partial results", source=str(folder))
        self._folder, self._question = folder, question

    def get(self, unit: Unit) -> Accumulator | None:
        """Result of a shard from an earlier run; None if it has to be read."""
        path = self._path(unit)
        try:
            return Accumulator.from_bytes(path.read_bytes())
        except FileNotFoundError:
            return None
        except (OSError, InputError) as error:
            log.warning("%s: %s; its images are read again", path, error)
            return None

    def put(self, unit: Unit, part: Accumulator) -> None:
        """Write the result of a shard, unless another attempt may be able to read more images.

        Raises:
            InputError: the file cannot be written.
        """
        if not part.is_passing:
            write_files({self._path(unit): part.to_bytes()})

    def _path(self, unit: Unit) -> Path:
        return self._folder / f"{unit.key}.{self._question}.part"
