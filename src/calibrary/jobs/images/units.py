"""Images in pieces that are read by one process each, and what such a piece said in an earlier run."""

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
"""Images of a shard on average: some seconds of work, and 150 kB as a file."""
MOST = 4


class Unit(Struct, frozen=True):
    """Some images that one process reads.

    Attributes:
        images: at least one.
        key: of its partial result; None where none is kept.
    """

    images: tuple[Image, ...]
    key: str | None = None

    def pickled(self) -> bytes:
        """As another process gets it; plain tuples, which are quicker than objects and hold names of any bytes."""
        rows = [(one.name, one.place, one.same_as, one.version) for one in self.images]
        return pickle.dumps((rows, self.key), protocol=5)

    @classmethod
    def unpickled(cls, data: bytes) -> Unit:
        """What :meth:`pickled` gave, never what came from elsewhere."""
        rows, key = pickle.loads(data)  # noqa: S301  our own
        return cls(tuple(Image(*row) for row in rows), key)


def batches(images: Iterable[Image], size: int) -> Iterator[Unit]:
    """So many images each."""
    left = iter(images)
    while batch := tuple(islice(left, size)):
        yield Unit(batch)


def shards(images: Iterable[Image], size: int = SHARD) -> Iterator[Unit]:
    """Some ``size`` images each, the same in a later run though images were added or removed elsewhere.

    Where a shard ends is said by the last image of it and not by a count: a new image changes the shard it is in, and
    no other.
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
    """What is in a shard: which images, their names, and what changes when they do."""
    digest = hashlib.blake2b(digest_size=16)
    for image in images:
        for text in (image.place, image.name, image.version or ""):
            digest.update(text.encode(errors="surrogateescape") + b"\0")
    return digest.hexdigest()


class Partials:
    """A folder of partial results, one file a shard, each whole or absent.

    Args:
        folder: where they are; made when the first is written.
        question: what the images are asked, which a partial result must have been asked as well.
    """

    def __init__(self, folder: Path, question: str) -> None:
        if folder.exists() and not folder.is_dir():
            raise InputError("is a file; expected a folder for partial results", source=str(folder))
        self._folder, self._question = folder, question

    def get(self, unit: Unit) -> Accumulator | None:
        """What a shard said in an earlier run; None where it has to be read."""
        path = self._path(unit)
        try:
            return Accumulator.from_bytes(path.read_bytes())
        except FileNotFoundError:
            return None
        except (OSError, InputError) as error:
            log.warning("%s: %s; its images are read again", path, error)
            return None

    def put(self, unit: Unit, part: Accumulator) -> None:
        """Keep what a shard said, but not where another attempt may read more of it.

        Raises:
            InputError: it cannot be written.
        """
        if not part.is_passing:
            write_files({self._path(unit): part.to_bytes()})

    def _path(self, unit: Unit) -> Path:
        return self._folder / f"{unit.key}.{self._question}.part"
