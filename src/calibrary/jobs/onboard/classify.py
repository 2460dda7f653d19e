"""Classification of the files of a payload: images of flights, frames of a board, calibration files, others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary import parsers
from calibrary.calib.board import Board
from calibrary.calib.detection import shows_board
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
"""Images of one camera in one folder that are searched for a board before the folder counts as a flight."""
FEWEST_FRAMES: Final = 3
"""Fewest images with a board; a single one may be a tiled roof."""


class Payload(Struct, frozen=True, kw_only=True):
    """The classified files of a folder.

    Attributes:
        folder: the folder.
        states: images with an identifiable camera, by metadata; names are relative to the folder.
        frames: names of those that show a board.
        files: calibration files with the name of the format.
        others: all other files, with the reason why they are not used.
    """

    folder: Path
    states: Mapping[ImageMetadata, tuple[str, ...]]
    frames: frozenset[str]
    files: tuple[tuple[Path, str], ...]
    others: tuple[SkippedFile, ...]

    @property
    def images(self) -> int:
        """Number of images, including frames of a board."""
        return sum(len(names) for names in self.states.values())


def classify_payload(
    folder: Path,
    *,
    board: Board | None = None,
    workers: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Payload:
    """Classify all files in a folder and its sub-folders.

    Args:
        folder: files that came with the payload.
        board: the board, if known.
        workers: processes that read images; 0 for automatic.
        progress: called with the number of files examined and the total.

    Raises:
        InputError: it is not a folder, cannot be read, or contains far too many files.
    """
    images: list[Path] = []
    rest: list[Path] = []
    for path in find_files(folder, recursive=True):
        # A raw file has the header of a TIFF, but is not a separate image.
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
    """The files of a known calibration format, and the others with the reason."""
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
    """Names of the images that show a board.

    Frames of a board come in sets: a few images of each camera and folder are searched, and if half of them
    show a board, the whole set counts, including blurred and cropped frames, which the search at full
    resolution rejects.
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
    """Yield a few names, evenly spread over the list."""
    count = min(TRIED, len(names))
    for at in range(count):
        yield names[at * len(names) // count]


def _has_board(path: Path, board: Board | None) -> bool:
    try:
        return shows_board(path, board)
    except InputError:
        # In a raw image or a colour mosaic no board can be measured.
        return False
