"""Detection of a board in a folder of images: every image is read, searched and assessed, in parallel.

An image that cannot be used does not stop the others; it is listed with the reason.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path

from msgspec import Struct, field

from calibrary.calib.board import Board, Pattern
from calibrary.calib.board_size import find_board_size
from calibrary.calib.detect import check_detectable, detect
from calibrary.calib.found import NotFound, Reason, Remark
from calibrary.calib.frames import Frame, Setting, frame_size, group_frames, read_frame, the_one_setting
from calibrary.calib.observations import Observations, View
from calibrary.calib.opencv_state import one_thread
from calibrary.calib.view_quality import judge_repeats, judge_view
from calibrary.calibration import CameraKey, ImageSize
from calibrary.errors import CalibrationError, InputError
from calibrary.records import replace
from calibrary.workers import end_with_parent, mapped

__all__ = ["Collected", "Looked", "NamedRemark", "collect", "look_at", "try_board_sizes"]

WORTH_A_POOL = 100_000_000
"""Total number of pixels above which starting worker processes pays: five images of 20 megapixels."""

REASONS_SHOWN = 3
FRAMES_TRIED = 8
"""Number of images searched for other board sizes, to report what they show instead."""


class NamedRemark(Struct, frozen=True, kw_only=True):
    """A remark on one image.

    Attributes:
        name: file name of the image.
        remark: the remark.
    """

    name: str
    remark: Remark

    def __str__(self) -> str:
        return f"{self.name}: {self.remark.text}"


class Collected(Struct, frozen=True, kw_only=True, eq=False):
    """Result of searching a set of images.

    Attributes:
        observations: usable views.
        rejected: unusable images with their reasons, in input order.
        remarks: further remarks on the usable views.
        notes: remarks on the whole set.
        files: paths of the images by the SHA-256 of their content, as far as they are found.
    """

    observations: Observations
    rejected: tuple[NamedRemark, ...] = ()
    remarks: tuple[NamedRemark, ...] = ()
    notes: tuple[str, ...] = ()
    files: Mapping[str, Path] = field(default_factory=dict)


class Looked(Struct, frozen=True, kw_only=True, eq=False):
    """Result of one image: a view, or a remark that rejects it."""

    name: str
    view: View | None = None
    remarks: tuple[Remark, ...] = ()

    @property
    def rejection(self) -> Remark | None:
        """The remark that rejects the image; None if it is usable."""
        return next((remark for remark in self.remarks if remark.rejects), None)


def collect(
    frames: Sequence[Path],
    board: Board | float | None,
    *,
    setting: Setting | None = None,
    workers: int = 0,
    progress: Callable[[int], None] | None = None,
) -> Collected:
    """Find the board in images.

    Args:
        frames: image files of one camera at one focus setting.
        board: board to search for; or the side of its squares in mm (None if unknown), when the number of corners is
            found by trial.
        setting: common metadata of the images; see :func:`calibrary.calib.frames.the_one_setting`. None if there is no
            metadata.
        workers: number of processes; 0 uses all processor cores if this saves time.
        progress: called with the number of images done since the last call.

    Returns:
        The views and the rejected images; the result does not depend on ``workers``.

    Raises:
        InputError: there are no images, they differ in size, or the board is too small to detect.
        CalibrationError: no image shows the board.
    """
    notes: tuple[str, ...] = ()
    if not isinstance(board, Board):
        board = try_board_sizes(frames, board)
        notes = (f"the board was taken for {board}, which was found by trying",)
    check_detectable(board)
    size = _common_size(frames)
    looked: list[Looked] = []
    for one in _mapped(
        partial(look_at, board=board, size=size), frames, _workers(workers, len(frames), size)
    ):
        looked.append(one)
        if progress is not None:
            progress(1)
    views = [one.view for one in looked if one.view is not None and one.rejection is None]
    if not views:
        raise CalibrationError(_nothing_found(frames, board, looked))
    looked = _with_repeats(looked, views)
    kept = [one for one in looked if one.rejection is None]
    camera = setting.camera if setting is not None else CameraKey()
    observations = Observations(
        board=board,
        image_size=size,
        views=tuple(one.view for one in kept if one.view is not None),
        camera=replace(camera, image_size=size),
        focus=setting.focus if setting is not None else None,
        firmware=camera.firmware,
    )
    return Collected(
        observations=observations,
        rejected=tuple(
            NamedRemark(name=one.name, remark=one.rejection) for one in looked if one.rejection is not None
        ),
        remarks=tuple(NamedRemark(name=one.name, remark=remark) for one in kept for remark in one.remarks),
        notes=notes,
        files=_files(frames, observations),
    )


def _with_repeats(looked: Sequence[Looked], views: Sequence[View]) -> list[Looked]:
    """Add a remark to each image that repeats another."""
    remarks = {id(views[index]): remark for index, remark in judge_repeats(views).items()}
    return [
        replace(one, remarks=(*one.remarks, remarks[id(one.view)])) if id(one.view) in remarks else one
        for one in looked
    ]


def _files(frames: Sequence[Path], observations: Observations) -> dict[str, Path]:
    """Return the images by their SHA-256, since images in different folders may have the same name."""
    by_name: dict[str, list[Path]] = {}
    for path in frames:
        by_name.setdefault(path.name, []).append(path)
    return {
        view.sha256: by_name[view.name][0]
        for view in observations.views
        if view.sha256 is not None and len(by_name.get(view.name, ())) == 1
    }


def try_board_sizes(frames: Sequence[Path], square_mm: float | None) -> Board:
    """Find the checkerboard in images when its number of corners is unknown.

    Args:
        frames: image files; only as many as needed are read.
        square_mm: side of a square in mm; None if unknown.

    Raises:
        CalibrationError: no board is found, or the images disagree.
    """
    columns, rows = find_board_size(frame.gray for frame in _readable(frames))
    return Board(columns=columns, rows=rows, square_mm=square_mm)


def _readable(frames: Sequence[Path]) -> Iterator[Frame]:
    for path in frames:
        try:
            yield read_frame(path)
        except InputError:
            continue


def _common_size(frames: Sequence[Path]) -> ImageSize:
    """Return the (width, height) px common to all images with a readable header."""
    sizes: dict[Path, Setting] = {}
    first_error: InputError | None = None
    for path in frames:
        try:
            sizes[path] = Setting(camera=CameraKey(), image_size=frame_size(path))
        except InputError as error:
            first_error = first_error or error
    if not sizes and first_error is not None:
        if len(frames) == 1:
            raise first_error
        raise InputError(f"none of {len(frames)} frames can be read; the first, {first_error}")
    return the_one_setting(group_frames(sizes, sizes)).image_size


def look_at(path: Path, *, board: Board, size: ImageSize) -> Looked:
    """Read, search and assess one image."""
    import cv2

    try:
        frame = read_frame(path)
        if frame.size != size:
            raise InputError("is {}×{} px, the others {}×{}".format(*frame.size, *size))
    except InputError as error:
        remark = Remark(reason=Reason.UNREADABLE, text=error.message, rejects=True)
        return Looked(name=path.name, remarks=(remark,))
    try:
        found = detect(frame.gray, board)
    except cv2.error as error:
        found = NotFound(reason=Reason.NO_BOARD, text=f"OpenCV gave up on it: {error.err or error}")
    if isinstance(found, NotFound):
        remark = Remark(reason=found.reason, text=found.text, rejects=True)
        return Looked(name=path.name, remarks=(remark,))
    sharpness_px, remarks = judge_view(frame.gray, board, found)
    view = View(
        name=frame.name,
        sha256=frame.sha256,
        ids=found.ids,
        image_points=found.points,
        sharpness_px=sharpness_px,
        spacing_px=found.spacing_px,
    )
    return Looked(name=path.name, view=view, remarks=remarks)


def _nothing_found(frames: Sequence[Path], board: Board, looked: Sequence[Looked]) -> str:
    """Return the error message when no image is usable, and what the images show instead if that can be found."""
    rejections = [(one.name, one.rejection) for one in looked if one.rejection is not None]
    counts = Counter(rejection.reason for _, rejection in rejections)
    if counts.total() == counts[Reason.NO_BOARD] + counts[Reason.LARGER_BOARD] + counts[Reason.UNEVEN]:
        message = f"no {board} found in any of {len(frames)} frames"
        if board.pattern is not Pattern.CHECKERBOARD:
            return f"{message}; check the board's pattern, size and dictionary"
        try:
            columns, rows = find_board_size(frame.gray for frame in _readable(frames[:FRAMES_TRIED]))
        except CalibrationError:
            return f"{message}, nor a checkerboard of any other size; the whole board must be visible, sharp and lit"
        return f"{message}, but one of {columns}×{rows} inner corners; give checkerboard:{columns}x{rows}"
    shown = "; ".join(f"{name}: {rejection.text}" for name, rejection in rejections[:REASONS_SHOWN])
    more = f"; and {len(rejections) - REASONS_SHOWN} more" if len(rejections) > REASONS_SHOWN else ""
    return f"none of {len(frames)} frames can be used: {shown}{more}"


def _workers(wanted: int, frames: int, size: ImageSize) -> int:
    if wanted:
        return min(wanted, frames)
    return min(os.cpu_count() or 1, frames) if frames * size[0] * size[1] >= WORTH_A_POOL else 1


def _mapped(look: Callable[[Path], Looked], frames: Sequence[Path], workers: int) -> Iterator[Looked]:
    """Yield one result per image, in input order."""
    if workers <= 1:
        yield from _mapped_here(look, frames)
        return
    try:
        yield from mapped(look, frames, workers, preload=[__name__, "cv2"], begin=_start_worker)
    except BrokenProcessPool:
        raise CalibrationError(
            "a process that looks at frames was ended from outside, as when memory runs out; use --workers 1"
        ) from None


def _mapped_here(look: Callable[[Path], Looked], frames: Sequence[Path]) -> Iterator[Looked]:
    """Process the images here, with one OpenCV thread as in a worker: some detectors depend on the number."""
    for path in frames:
        with one_thread():
            looked = look(path)
        yield looked


def _start_worker() -> None:
    """Use one OpenCV thread per worker, and end the worker with its parent process."""
    import cv2

    cv2.setNumThreads(1)
    end_with_parent()
