"""Which images are meant: every place that was given is looked through once."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import TypeAlias

from calibrary.errors import InputError
from calibrary.jobs.images.archives import archive_of, members
from calibrary.jobs.images.folders import SkippedFile, walk
from calibrary.jobs.images.observation import Image, path_order
from calibrary.jobs.images.places import images_at, place_of, shown
from calibrary.parsers.image_names import is_image
from calibrary.records import replace

__all__ = ["LISTED", "Listing"]

Keep: TypeAlias = Callable[[os.DirEntry[str]], bool]

LISTED = 10_000
"""So many images are all named in a report; of more only the first few that say the same, unless all are asked for."""


class Listing:
    """The images of a run, as they are found.

    Attributes:
        root: the folder that their names are relative to.
        folders: where they were looked for, or where one that was named lies.
        unreadable: sub-folders that were passed over, as far as the images were gone through.
        known: how many images there are; None where they are more than :data:`LISTED`.
    """

    def __init__(
        self,
        given: Sequence[Path | str],
        *,
        recursive: bool,
        lines: Iterable[str] | None = None,
        keep: Keep | None = None,
        versions: bool = False,
    ) -> None:
        """Finds the first images.

        Args:
            given: a folder, an archive or a URL, or images and any number of those.
            recursive: go into sub-folders.
            lines: more of them, one a line; empty lines and those that begin with # are passed over.
            keep: says of another file whether it is remembered.
            versions: say of each image what changes when it does.

        Raises:
            InputError: none is given, or one is not there or cannot be read; a sub-folder is passed over then.
        """
        if not given and lines is None:
            raise InputError("no image was given; expected a folder, or a list of images")
        self._recursive, self._keep, self._versions = recursive, keep, versions
        self._beside: dict[Path, None] = {}
        self.unreadable: list[SkippedFile] = []
        paths = [one for one in given if isinstance(one, Path)]
        if len(paths) == len(given) == 1 and not paths[0].is_file():
            [self.root] = self.folders = tuple(paths)
        else:
            # Made absolute without following links: a name in the report is the one that was given.
            given = [Path(os.path.abspath(one)) if isinstance(one, Path) else one for one in given]  # noqa: PTH100
            folders = (one.parent if one.is_file() else one for one in given if isinstance(one, Path))
            self.folders = tuple(dict.fromkeys(folders))
            self.root = Path(os.path.commonpath(self.folders)) if self.folders else Path()
        images = chain(self._found(given, self.root), self._listed(lines or ()))
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

    def _found(self, given: Sequence[Path | str], root: Path | None) -> Iterator[Image]:
        """The images of what was given; names are below ``root``, without one as they were given."""
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
                yield Image(name.as_posix(), place, real if real != place else None, self._version(one))
            elif one not in walked:
                walked.add(one)
                yield from self._images_of(one, root, unreadable=self.unreadable)
        for folder in parents - walked if root is not None else ():
            for _ in self._images_of(folder, root, unreadable=[]):
                pass

    def _listed(self, lines: Iterable[str]) -> Iterator[Image]:
        for line in lines:
            text = line.rstrip("\r\n")
            if text.strip() and not text.startswith("#"):
                yield from self._found([place_of(text)], None)

    def _images_of(
        self, folder: Path, root: Path | None, *, unreadable: list[SkippedFile]
    ) -> Iterator[Image]:
        above = (folder.relative_to(root) if root is not None else folder).as_posix()
        above = "" if above == "." else f"{above}/"
        real = os.path.realpath(folder)
        start = len(os.path.join(folder, ""))  # noqa: PTH118  of the text that os.scandir puts before names
        for entry in walk(folder, recursive=self._recursive, unreadable=unreadable):
            if is_image(entry.name):
                below = entry.path[start:].replace(os.sep, "/")
                place = f"{real}/{below}"
                target = os.path.realpath(place) if entry.is_symlink() else None
                yield Image(above + below, place, target, self._version(entry))
            elif self._keep is not None and self._keep(entry):
                self._beside[Path(entry.path)] = None

    def _version(self, file: Path | os.DirEntry[str]) -> str | None:
        if not self._versions:
            return None
        try:
            status = file.stat()
        except OSError:
            return None
        return f"{status.st_size}-{status.st_mtime_ns}"
