"""Recordings as frames: videos, and bags of ROS. One module reads each; the sharpest frames of each stretch are kept.

A reader is a function of a path and a topic that yields :class:`Shot` in the order of time. It declares its suffixes
and is listed in :data:`READERS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final, TypeAlias

from calibrary.calib.recordings import rosbag, video
from calibrary.calib.recordings.sharpest import Shot, sharpest
from calibrary.errors import InputError

__all__ = ["READERS", "Shot", "write_frames"]

Reader: TypeAlias = Callable[[Path, str | None], Iterator[Shot]]
READERS: Final[Mapping[str, Reader]] = {
    **dict.fromkeys(video.SUFFIXES, video.read),
    **dict.fromkeys(rosbag.SUFFIXES, rosbag.read),
}
"""By suffix, in lower case."""


def write_frames(path: Path, topic: str | None, folder: Path) -> tuple[list[Path], int]:
    """Write the sharpest frames of a recording into a folder, without loss.

    Args:
        path: the recording.
        topic: of a bag; None for its only one with images.
        folder: where they are written, named by the recording and the time in it.

    Returns:
        The files, in the order of time, and the number of frames in the recording.

    Raises:
        InputError: the recording cannot be read, or has no frames.
        MissingExtraError: the library that reads it is not installed.
    """
    read = rosbag.read if path.is_dir() else READERS[path.suffix.lower()]
    if not path.exists():
        raise InputError("no such file or folder; expected a recording of the board", source=str(path))
    kept, count = sharpest(read(path, topic))
    if not kept:
        raise InputError("has no frames", source=path.name)
    files = []
    for shot in kept:
        files.append(folder / f"{path.stem}-{shot.seconds:09.3f}s{shot.suffix}")
        files[-1].write_bytes(shot.encoded())
    return files, count
