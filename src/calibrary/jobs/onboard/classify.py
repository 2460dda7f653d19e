"""What lies in a payload's folder: images of flights, frames of a board, calibration files, and all the rest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary import parsers
from calibrary.calib.board import Board
from calibrary.calib.presence import shows_board
from calibrary.errors import InputError, UnknownFormatError
from calibrary.evidence.frame import exif_contradiction
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.images.folders import SkippedFile, find_files
from calibrary.jobs.images.reading import gather
from calibrary.parsers.image_names import is_image

__all__ = ["Payload", "classify_payload"]

LARGEST_CALIBRATION: Final = 4 << 20
MOST_FILES: Final = 100_000
TRIED: Final = 24
"""Images of one camera in one folder that are looked at for a board, before it is taken for a flight."""
FEWEST_FRAMES: Final = 3
"""One image in which a board seems to be is a tiled roof."""


class Payload(Struct, frozen=True, kw_only=True):
    """A folder, sorted.

    Attributes:
        folder: which.
        states: images that a camera can be identified from, by what they say of it; names below the folder.
        frames: those of them that show a board, as names.
        files: calibration files, and the name of the format.
        others: all the rest, each with why it is of no use.
    """

    folder: Path
    states: Mapping[ImageMetadata, tuple[str, ...]]
    frames: frozenset[str]
    files: tuple[tuple[Path, str], ...]
    others: tuple[SkippedFile, ...]

    @property
    def images(self) -> int:
        """How many images, frames of a board among them."""
        return sum(len(names) for names in self.states.values())


def classify_payload(
    folder: Path,
    *,
    board: Board | None = None,
    workers: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Payload:
    """Look at everything in a folder and those within it.

    Args:
        folder: what came with the payload.
        board: which board frames show, where that is known.
        workers: processes that read images; 0 decides by itself.
        progress: called with how many of how many looks are done.

    Raises:
        InputError: it is not a folder, cannot be read, or holds an absurd number of files.
    """
    images: list[Path] = []
    rest: list[Path] = []
    for path in find_files(folder, recursive=True):
        # A raw file begins as a TIFF does, and is not a frame of its own.
        (images if is_image(path) and parsers.is_image_file(path) else rest).append(path)
        if len(images) + len(rest) > MOST_FILES:
            raise InputError(
                f"contains over {MOST_FILES} files; give the folder of one payload", source=str(folder)
            )
    files, others = _calibrations(rest, folder)
    gathered = gather(images, folder, workers=workers)
    others += gathered.unread
    states: dict[ImageMetadata, tuple[str, ...]] = {}
    for metadata, names in gathered.states.items():
        contradiction = exif_contradiction(metadata)
        if contradiction is not None:
            others += [SkippedFile(name=name, reason=contradiction) for name in names]
        else:
            states[metadata] = tuple(names)
    return Payload(
        folder=folder,
        states=states,
        frames=_frames(states, folder, board, progress),
        files=tuple(files),
        others=tuple(sorted(others, key=lambda one: one.name)),
    )


def _calibrations(paths: Sequence[Path], folder: Path) -> tuple[list[tuple[Path, str]], list[SkippedFile]]:
    """The files that some format estimates, and of the others why they are none."""
    files: list[tuple[Path, str]] = []
    others: list[SkippedFile] = []
    for path in paths:
        name = path.relative_to(folder).as_posix()
        try:
            identity = parsers.identify(path, max_bytes=LARGEST_CALIBRATION)
        except UnknownFormatError:
            others.append(
                SkippedFile(name=name, reason="neither an image nor a calibration file of a known format")
            )
        except InputError as error:
            others.append(SkippedFile(name=name, reason=error.message))
        except OSError as error:
            others.append(SkippedFile(name=name, reason=f"cannot be read: {error.strerror or error}"))
        else:
            if identity.format.read is None:
                others.append(
                    SkippedFile(name=name, reason=f"{identity.format.title}: {identity.format.refuses}")
                )
            else:
                files.append((path, identity.format.name))
    return files, others


def _frames(
    states: Mapping[ImageMetadata, tuple[str, ...]],
    folder: Path,
    board: Board | None,
    progress: Callable[[int, int], None] | None,
) -> frozenset[str]:
    """The images that show a board.

    Frames of a board come in sets: of each camera's images in each folder a few are tried, and a set in which half
    of them show a board is one, blurred and cut off ones included; the search at full resolution sorts those out.
    """
    groups: dict[tuple[ImageMetadata, str], list[str]] = {}
    for metadata, alike in states.items():
        for name in alike:
            groups.setdefault((metadata, name.rpartition("/")[0]), []).append(name)
    looks = sum(min(TRIED, len(names)) for names in groups.values())
    done = 0
    found: set[str] = set()
    for names in groups.values():
        tried = list(_spread(sorted(names)))
        seen = []
        for name in tried:
            if _has_board(folder / name, board):
                seen.append(name)
            done += 1
            if progress is not None:
                progress(done, looks)
        if 2 * len(seen) >= len(tried) and len(seen) >= FEWEST_FRAMES:
            found |= set(names)
        elif len(seen) > 1 or (seen and len(names) > len(tried)):
            more = [name for name in names if name not in tried and _has_board(folder / name, board)]
            found |= {*seen, *more} if len(seen) + len(more) >= FEWEST_FRAMES else set()
    return frozenset(found)


def _spread(names: Sequence[str]) -> Iterator[str]:
    """A few from everywhere in the list."""
    count = min(TRIED, len(names))
    for at in range(count):
        yield names[at * len(names) // count]


def _has_board(path: Path, board: Board | None) -> bool:
    try:
        return shows_board(path, board)
    except InputError:
        # A raw image or a colour mosaic shows none that could be measured.
        return False
