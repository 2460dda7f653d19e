"""Recordings as frames: videos, and bags of ROS. One module reads each; the sharpest frames of each stretch are kept.

A reader is a function of a path and a topic that yields :class:`Shot` in the order of time, or :class:`Unreadable`. It
declares its suffixes and is listed in :data:`READERS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final, TypeAlias

from calibrary.calib.recordings import rosbag, video
from calibrary.calib.recordings.rosbag import DESCRIPTION, OF_A_FOLDER, REINDEX
from calibrary.calib.recordings.sharpest import Shot, Unreadable, sharpest
from calibrary.errors import InputError, ParseError

__all__ = ["DESCRIPTION", "OF_A_FOLDER", "READERS", "REINDEX", "Shot", "Unreadable", "write_frames"]

Reader: TypeAlias = Callable[[Path, str | None], Iterator[Shot | Unreadable]]
READERS: Final[Mapping[str, Reader]] = {
    **dict.fromkeys(video.SUFFIXES, video.read),
    **dict.fromkeys(rosbag.SUFFIXES, rosbag.read),
}
"""By suffix, in lower case."""


def write_frames(path: Path, topic: str | None, folder: Path) -> tuple[list[Path], int, list[Unreadable]]:
    """Write the sharpest frames of a recording into a folder, without loss.

    Args:
        path: the recording.
        topic: of a bag; None for its only one with images.
        folder: where they are written, named by the recording and the time in it.

    Returns:
        The files, in the order of time; the number of frames in the recording that could be read; and those that could
        not.

    Raises:
        InputError: the recording cannot be read, or has no frames that can.
        MissingExtraError: the library that reads it is not installed.
    """
    read = rosbag.read if path.is_dir() else READERS[path.suffix.lower()]
    if not path.exists():
        raise InputError("no such file or folder; expected a recording of the board", source=str(path))
    kept, count, unreadable = sharpest(read(path, topic))
    if not kept:
        if unreadable:
            raise ParseError(
                f"none of its {len(unreadable)} frames can be read; the first is {unreadable[0].why}",
                source=path.name,
            )
        raise InputError("has no frames", source=path.name)
    files = []
    for shot in kept:
        files.append(folder / f"{path.stem}-{shot.seconds:09.3f}s{shot.suffix}")
        files[-1].write_bytes(shot.encoded())
    return files, count, unreadable
