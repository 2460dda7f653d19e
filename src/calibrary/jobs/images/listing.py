"""Listing of the images of a run; each given place is searched once."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import TypeAlias

from calibrary.errors import InputError
from calibrary.jobs.images.folders import SkippedFile, walk
from calibrary.jobs.images.observation import Image, path_order
from calibrary.jobs.images.places import archive_of, images_at, members, place_of, shown
from calibrary.parsers.files import is_image
from calibrary.records import replace

Keep: TypeAlias = Callable[[os.DirEntry[str]], bool]

LISTED = 10_000
"""Up to this many images are all named in a report; of more, only the first few of each state, unless requested."""


class Listing:
    """The images of a run, found lazily.

    Attributes:
        root: the folder that image names are relative to.
        folders: the searched folders, and the folders of named images.
        unreadable: sub-folders that were skipped so far.
        known: number of images; None if more than :data:`LISTED`.
    """

    def __init__(
        self,
        given: Sequence[Path | str],
        *,
        recursive: bool,
        lines: Iterable[str] | None = None,
        keep: Keep | None = None,
    ) -> None:
        """Start listing, up to the first images.

        Args:
            given: a folder, an archive or a URL; or images and any number of these.
            recursive: whether to read sub-folders.
            lines: more of them, one per line; empty lines and lines that begin with # are ignored.
            keep: returns whether to remember a file that is not an image.

        Raises:
            InputError: nothing is given, or a given place does not exist or cannot be read. An unreadable
                sub-folder is skipped instead.
        """
        if not given and lines is None:
            raise InputError("no image was given; expected a folder, or a list of images")
        self._recursive, self._keep = recursive, keep
        self._other_files: dict[Path, None] = {}
        self.unreadable: list[SkippedFile] = []
        paths = [one for one in given if isinstance(one, Path)]
        if len(paths) == len(given) == 1 and not paths[0].is_file():
            [self.root] = self.folders = tuple(paths)
        else:
            # Made absolute without following links, so that names in the report are those given.
            given = [Path(os.path.abspath(one)) if isinstance(one, Path) else one for one in given]  # noqa: PTH100
            folders = (one.parent if one.is_file() else one for one in given if isinstance(one, Path))
            self.folders = tuple(dict.fromkeys(folders))
            self.root = Path(os.path.commonpath(self.folders)) if self.folders else Path()
        images = chain(self._images_below(given, self.root), self._images_of_lines(lines or ()))
        first = list(islice(images, LISTED + 1))
        self.known = len({image.id for image in first}) if len(first) <= LISTED else None
        self._images = chain(first, images)

    def __iter__(self) -> Iterator[Image]:
        """Yield the images, some possibly twice; can be iterated only once."""
        return self._images

    @property
    def other_files(self) -> tuple[Path, ...]:
        """The files accepted by ``keep`` in the folders read so far."""
        named = {path: path.relative_to(self.root).as_posix() for path in self._other_files}
        return tuple(sorted(named, key=lambda path: path_order(named[path])))

    def _images_below(self, given: Sequence[Path | str], root: Path | None) -> Iterator[Image]:
        """Yield the images of the given places; names are relative to ``root``, or as given if it is None."""
        walked: set[Path] = set()
        parents: set[Path] = set()
        for one in given:
            archive = archive_of(one)
            if archive is not None:
                above = "" if len(given) == 1 and root is not None else f"{archive[1].as_posix()}/"
                yield from (Image(above + name, place) for name, place in members(*archive))
            elif isinstance(one, str):
                below = images_at(one)
                many = len(given) > 1 or root is None
                yield from (replace(image, name=shown(image.place)) if many else image for image in below)
            elif one.is_file() or (root is None and not one.is_dir()):
                parents.add(one.parent)
                place, real = f"{os.path.realpath(one.parent)}/{one.name}", os.path.realpath(one)
                name = one.relative_to(root) if root is not None else one
                yield Image(name.as_posix(), place, real if real != place else None)
            elif one not in walked:
                walked.add(one)
                yield from self._images_of(one, root, unreadable=self.unreadable)
        for folder in parents - walked if root is not None else ():
            for _ in self._images_of(folder, root, unreadable=[]):
                pass

    def _images_of_lines(self, lines: Iterable[str]) -> Iterator[Image]:
        for line in lines:
            text = line.rstrip("\r\n")
            if text.strip() and not text.startswith("#"):
                yield from self._images_below([place_of(text)], None)

    def _images_of(
        self, folder: Path, root: Path | None, *, unreadable: list[SkippedFile]
    ) -> Iterator[Image]:
        above = (folder.relative_to(root) if root is not None else folder).as_posix()
        above = "" if above == "." else f"{above}/"
        real = os.path.realpath(folder)
        start = len(os.path.join(folder, ""))  # noqa: PTH118  length of the prefix in os.scandir's paths
        for entry in walk(folder, recursive=self._recursive, unreadable=unreadable):
            if is_image(entry.name):
                below = entry.path[start:].replace(os.sep, "/")
                place = f"{real}/{below}"
                target = os.path.realpath(place) if entry.is_symlink() else None
                yield Image(above + below, place, target)
            elif self._keep is not None and self._keep(entry):
                self._other_files[Path(entry.path)] = None
