"""Which images are meant: every place that was given is looked through once."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import TypeAlias

from calibrary.errors import InputError
from calibrary.jobs.images.folders import SkippedFile, walk
from calibrary.jobs.images.observation import Image, path_order
from calibrary.parsers.image_names import is_image

__all__ = ["LISTED", "Listing"]

Keep: TypeAlias = Callable[[os.DirEntry[str]], bool]

LISTED = 10_000
"""So many images are all named in a report; of more only the first few that say the same, unless all are asked for."""


class Listing:
    """The images of a run, as they are found.

    Attributes:
        root: the folder that their names are told relative to.
        folders: where they were looked for, or where one that was named lies.
        unreadable: sub-folders that were passed over, as far as the images were gone through.
        known: how many images there are; None where they are more than :data:`LISTED`.
    """

    def __init__(
        self,
        given: Sequence[Path],
        *,
        recursive: bool,
        keep: Keep | None = None,
        versions: bool = False,
    ) -> None:
        """Finds the first images.

        Args:
            given: a folder, or images and folders.
            recursive: go into sub-folders.
            keep: says of another file whether it is remembered.
            versions: say of each image what changes when it does.

        Raises:
            InputError: none is given, or one is not there or cannot be read; a sub-folder is passed over then.
        """
        if not given:
            raise InputError("no image was given; expected a folder, or a list of images")
        self._recursive, self._keep, self._versions = recursive, keep, versions
        self._beside: dict[Path, None] = {}
        self.unreadable: list[SkippedFile] = []
        if len(given) == 1 and not given[0].is_file():
            [self.root] = self.folders = tuple(given)
        else:
            # Made absolute without following links: a name in the report is the one that was given.
            given = [Path(os.path.abspath(one)) for one in given]  # noqa: PTH100
            self.folders = tuple(dict.fromkeys(one.parent if one.is_file() else one for one in given))
            self.root = Path(os.path.commonpath(self.folders))
        images = self._found(given)
        first = list(islice(images, LISTED + 1))
        self.known = len({image.id for image in first}) if len(first) <= LISTED else None
        self._images = chain(first, images)

    def __iter__(self) -> Iterator[Image]:
        """Each image, some of them perhaps twice; this goes through them once."""
        return self._images

    @property
    def beside(self) -> tuple[Path, ...]:
        """The files beside the images that were to be remembered, as far as the images were gone through."""
        named = {path: path.relative_to(self.root).as_posix() for path in self._beside}
        return tuple(sorted(named, key=lambda path: path_order(named[path])))

    def _found(self, given: Sequence[Path]) -> Iterator[Image]:
        walked: set[Path] = set()
        parents: set[Path] = set()
        for one in given:
            if one.is_file():
                parents.add(one.parent)
                place, real = f"{os.path.realpath(one.parent)}/{one.name}", os.path.realpath(one)
                name = one.relative_to(self.root).as_posix()
                yield Image(name, place, real if real != place else None, self._version(one))
            elif one not in walked:
                walked.add(one)
                yield from self._images_of(one, unreadable=self.unreadable)
        for folder in parents - walked:
            for _ in self._images_of(folder, unreadable=[]):
                pass

    def _images_of(self, folder: Path, *, unreadable: list[SkippedFile]) -> Iterator[Image]:
        above = folder.relative_to(self.root).as_posix()
        above = "" if above == "." else f"{above}/"
        real = os.path.realpath(folder)
        for entry in walk(folder, recursive=self._recursive, unreadable=unreadable):
            path = Path(entry.path)
            if is_image(path):
                below = path.relative_to(folder).as_posix()
                place = f"{real}/{below}"
                target = os.path.realpath(place) if entry.is_symlink() else None
                yield Image(above + below, place, target, self._version(entry))
            elif self._keep is not None and self._keep(entry):
                self._beside[path] = None

    def _version(self, file: Path | os.DirEntry[str]) -> str | None:
        if not self._versions:
            return None
        try:
            status = file.stat()
        except OSError:
            return None
        return f"{status.st_size}-{status.st_mtime_ns}"
