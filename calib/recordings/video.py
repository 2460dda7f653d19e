"""Frames of a video, by PyAV (FFmpeg). They are as stored: a rotation that is only for display is not applied."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from calibrary.calib.recordings.sharpest import Shot
from calibrary.errors import InputError, ParseError
from calibrary.extras import require

SUFFIXES: Final = frozenset({".mp4", ".mov", ".m4v", ".avi", ".mkv", ".mts", ".webm"})


def read(path: Path, topic: str | None = None) -> Iterator[Shot]:
    """Yield the frames of a video's first stream.

    Args:
        path: the video.
        topic: there is none in a video.

    Raises:
        InputError: the file is not a video, is damaged, or is interlaced.
        MissingExtraError: PyAV is not installed.
    """
    if topic is not None:
        raise InputError(f"is a video and has no topic {topic:.80}", source=path.name)
    require(("av",), "reading a video")
    import av

    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise InputError("has no video in it", source=path.name)
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            for number, frame in enumerate(container.decode(stream)):
                if frame.interlaced_frame:
                    raise ParseError(
                        "is interlaced: every second row is of another moment; record progressive frames",
                        source=path.name,
                    )
                seconds = frame.time if frame.pts is not None else number / 30
                yield Shot(seconds=max(float(seconds), 0.0), pixels=frame.to_ndarray(format="gray"))
    except av.FFmpegError as error:
        raise ParseError(f"cannot be decoded: {error.strerror or error}", source=path.name) from None
