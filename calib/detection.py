"""Detection of a board in one image, and in a folder of them: every image is read, searched and assessed, in parallel.

An image that cannot be used does not stop the others; it is listed with the reason.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final, Self

import numpy as np
from msgspec import Struct, field

from calibrary.arrays import FloatArray
from calibrary.calib.board import LARGEST, Board, Pattern
from calibrary.calib.detectors.checkerboard import FEWEST_ALONG_A_SIDE, find_checkerboard
from calibrary.calib.detectors.circles import find_circles
from calibrary.calib.detectors.markers import find_aprilgrid, find_charuco
from calibrary.calib.detectors.refinement import DETECTION_SIDE, reduced
from calibrary.calib.found import Found, NotFound, Reason, Remark
from calibrary.calib.frames import Frame, Gray, Setting, frame_size, group_frames, read_frame, the_one_setting
from calibrary.calib.image_circle import brightness, find_circle
from calibrary.calib.observations import Observations, View
from calibrary.calib.opencv_state import one_thread, quiet
from calibrary.calib.search import Seen, board_of, contradiction, look_until_sure
from calibrary.calib.view_quality import judge_repeats, judge_view
from calibrary.calibration import CameraKey, ImageSize, Origin, canonical_from_file
from calibrary.errors import CalibrationError, InputError
from calibrary.records import Record, replace
from calibrary.workers import end_with_parent, mapped

DETECTORS: Final[Mapping[Pattern, Callable[[Gray, Board], Found | NotFound]]] = {
    Pattern.CHECKERBOARD: find_checkerboard,
    Pattern.CHARUCO: find_charuco,
    Pattern.APRILGRID: find_aprilgrid,
    Pattern.CIRCLES: find_circles,
    Pattern.ASYMMETRIC_CIRCLES: find_circles,
}

WORTH_A_POOL = 100_000_000
"""Total number of pixels above which starting worker processes pays: five images of 20 megapixels."""

REASONS_SHOWN = 3
FRAMES_TRIED = 8
"""Number of images searched for other boards, to report what they show instead."""

NO_SUCH_BOARD: Final = (Reason.NO_BOARD, Reason.LARGER_BOARD, Reason.UNEVEN, Reason.FEW_POINTS)

QUICK_SIDE: Final = 640
"""px of the copy; a board of eleven squares across a third of it still has squares of twenty pixels."""

QUICK_FEWEST: Final = (4, 6)
"""Corners along the shorter and the longer side; fields, roofs and windows often form lattices of four by four."""

REDUCTIONS: Final = (8, 4, 2)


def check_detectable(board: Board) -> None:
    """Check that a board is large enough to be detected.

    Raises:
        InputError: the board is too small.
    """
    if not board.has_markers and min(board.columns, board.rows) < FEWEST_ALONG_A_SIDE:
        raise InputError(
            f"a {board.pattern.value} of {board.columns}×{board.rows}: expected at least {FEWEST_ALONG_A_SIDE} points "
            "along each side, better 8"
        )


def detect(gray: Gray, board: Board) -> Found | NotFound:
    """Detect a board's points in an image.

    The board is searched for in a reduced copy and measured in the full image; see :mod:`calibrary.calib.detectors`.
    If the colours of a checkerboard distinguish its ends, all images start at the same square.

    Args:
        gray: (H, W), as stored.
        board: board to search for.

    Returns:
        Points in the canonical pixel origin, or the reason why there are none.

    Raises:
        InputError: the board is too small; see :func:`check_detectable`.
    """
    check_detectable(board)
    found = DETECTORS[board.pattern](gray, board)
    if isinstance(found, NotFound):
        return found
    height, width = gray.shape
    offset = canonical_from_file((0.0, 0.0), Origin.PIXEL_CENTRE, (width, height))
    return replace(found, points=found.points + offset)


class NamedRemark(Record):
    """A remark on one image.

    Attributes:
        name: file name of the image.
        reason: code of the remark.
        message: what was measured, what was expected and what to do.
    """

    name: str
    reason: Reason
    message: str

    @classmethod
    def of(cls, name: str, remark: Remark) -> Self:
        """Return what a detector said of an image."""
        return cls(name=name, reason=remark.reason, message=remark.text)

    def __str__(self) -> str:
        return f"{self.name}: {self.message}"


class Detections(Struct, frozen=True, kw_only=True, eq=False):
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


class SearchedImage(Struct, frozen=True, kw_only=True, eq=False):
    """Result of one image: a view, or a remark that rejects it; and the brightness of its cells if it was read."""

    name: str
    view: View | None = None
    brightness: FloatArray | None = None
    remarks: tuple[Remark, ...] = ()

    @property
    def rejection(self) -> Remark | None:
        """The remark that rejects the image; None if it is usable."""
        return next((remark for remark in self.remarks if remark.rejects), None)


def detect_all(
    frames: Sequence[Path],
    board: Board | float | None,
    *,
    setting: Setting | None = None,
    workers: int = 0,
    progress: Callable[[int], None] | None = None,
) -> Detections:
    """Find the board in images.

    Args:
        frames: image files of one camera at one focus setting.
        board: board to search for; or the side of its squares in mm (None if unknown), when it is found by trial.
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
    notes: list[str] = []
    if not isinstance(board, Board):
        board, note = find_board(frames, board)
        notes.append(note)
    check_detectable(board)
    size = _common_size(frames)
    looked: list[SearchedImage] = []
    for one in _mapped(
        partial(search_image, board=board, size=size), frames, _workers(workers, len(frames), size)
    ):
        looked.append(one)
        if progress is not None:
            progress(1)
    views = [one.view for one in looked if one.view is not None and one.rejection is None]
    if not views:
        raise CalibrationError(_nothing_found(frames, board, looked))
    if other := _other_board(frames, board, looked):
        raise CalibrationError(other)
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
        circle=find_circle([one.brightness for one in looked if one.brightness is not None], size),
    )
    return Detections(
        observations=observations,
        rejected=tuple(
            NamedRemark.of(one.name, one.rejection) for one in looked if one.rejection is not None
        ),
        remarks=tuple(NamedRemark.of(one.name, remark) for one in kept for remark in one.remarks),
        notes=tuple(notes),
        files=_files(frames, observations),
    )


def _with_repeats(looked: Sequence[SearchedImage], views: Sequence[View]) -> list[SearchedImage]:
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


def find_board(frames: Sequence[Path], square_mm: float | None) -> tuple[Board, str]:
    """Find the board in images when it is not known.

    Args:
        frames: image files; only as many as needed are read.
        square_mm: side of a square in mm; None if unknown.

    Returns:
        The board, and a note for the user.

    Raises:
        CalibrationError: no board is found, or the images disagree.
    """
    board, described = board_of(look_until_sure(frame.gray for frame in _readable(frames)), square_mm)
    return board, f"the board was taken for {described}, which was found by trying"


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


def search_image(path: Path, *, board: Board, size: ImageSize) -> SearchedImage:
    """Read, search and assess one image."""
    import cv2

    try:
        frame = read_frame(path)
        if frame.size != size:
            raise InputError("is {}×{} px, the others {}×{}".format(*frame.size, *size))
    except InputError as error:
        remark = Remark(reason=Reason.UNREADABLE, text=error.message, rejects=True)
        return SearchedImage(name=path.name, remarks=(remark,))
    cells = brightness(frame.gray)
    try:
        found = detect(frame.gray, board)
    except cv2.error as error:
        found = NotFound(reason=Reason.NO_BOARD, text=f"OpenCV gave up on it: {error.err or error}")
    if isinstance(found, NotFound):
        return SearchedImage(name=path.name, remarks=(found,), brightness=cells)
    sharpness_px, remarks = judge_view(frame.gray, board, found)
    view = View(
        name=frame.name,
        sha256=frame.sha256,
        ids=found.ids,
        image_points=found.points,
        sharpness_px=sharpness_px,
        spacing_px=found.spacing_px,
    )
    return SearchedImage(name=path.name, view=view, remarks=remarks, brightness=cells)


def _nothing_found(frames: Sequence[Path], board: Board, looked: Sequence[SearchedImage]) -> str:
    """Return the error message when no image is usable, and what the images show instead if that can be found."""
    rejections = [(one.name, one.rejection) for one in looked if one.rejection is not None]
    counts = Counter(rejection.reason for _, rejection in rejections)
    if counts.total() == sum(counts[reason] for reason in NO_SUCH_BOARD):
        message = f"no {board} found in any of {len(frames)} frames"
        try:
            seen, described = board_of(_looked_at(frames), board.square_mm)
        except CalibrationError as error:
            return f"{message}; {error}"
        if other := contradiction(board, seen):
            return f"{message}, but {other}"
        if board.pattern is Pattern.CHECKERBOARD or board.has_markers:
            message = f"{described} is seen, but in none of {len(frames)} frames can it be used"
    else:
        message = f"none of {len(frames)} frames can be used"
    shown = "; ".join(f"{name}: {rejection.text}" for name, rejection in rejections[:REASONS_SHOWN])
    more = f"; and {len(rejections) - REASONS_SHOWN} more" if len(rejections) > REASONS_SHOWN else ""
    return f"{message}: {shown}{more}"


def _other_board(frames: Sequence[Path], board: Board, looked: Sequence[SearchedImage]) -> str | None:
    """Return the error message where most images do not show the board but another one, of which a part passed for it.

    At the edge of a fisheye image the squares beyond such a part are too bent to be recognised as its own.
    """
    lost = [
        path
        for path, one in zip(frames, looked, strict=True)
        if one.rejection is not None and one.rejection.reason in NO_SUCH_BOARD
    ]
    if 2 * len(lost) <= len(looked):
        return None
    try:
        seen, _ = board_of(_looked_at(lost), board.square_mm)
    except CalibrationError:
        return None
    other = contradiction(board, seen)
    if other is None or (
        seen.pattern is board.pattern and seen.columns * seen.rows < board.columns * board.rows
    ):
        return None
    return f"{board} passes for a part of the board in {len(looked) - len(lost)} of {len(looked)} frames, but {other}"


def _looked_at(frames: Sequence[Path]) -> list[Seen]:
    return look_until_sure(frame.gray for frame in _readable(frames[:FRAMES_TRIED]))


def _workers(wanted: int, frames: int, size: ImageSize) -> int:
    if wanted:
        return min(wanted, frames)
    return min(os.cpu_count() or 1, frames) if frames * size[0] * size[1] >= WORTH_A_POOL else 1


def _mapped(
    look: Callable[[Path], SearchedImage], frames: Sequence[Path], workers: int
) -> Iterator[SearchedImage]:
    """Yield one result per image, in input order."""
    if workers <= 1:
        for path in frames:
            # One thread, as in a worker: the result of some detectors depends on the number.
            with one_thread():
                looked = look(path)
            yield looked
        return
    preload = [__name__, "cv2"]
    yield from mapped(look, frames, workers, preload=preload, does="looks at frames", begin=_start_worker)


def _start_worker() -> None:
    """Use one OpenCV thread per worker, and end the worker with its parent process."""
    import cv2

    cv2.setNumThreads(1)
    end_with_parent()


def shows_board(path: Path, board: Board | None = None) -> bool:
    """Return whether an image shows a board, completely or in part, for folders with board and flight images.

    A reduced copy is searched, in 0.1 s. The result is not a measurement: :func:`detect_all` detects the board again at
    full resolution, and states the reason if it cannot.

    Args:
        path: image file.
        board: board to search for; by default any checkerboard. Boards with markers are detected only if given.

    Raises:
        InputError: the file cannot be read, or contains no camera image.
    """
    import cv2

    with quiet(), one_thread():
        gray = _small(path, DETECTION_SIDE if board is not None and board.has_markers else QUICK_SIDE)
        if board is not None and board.has_markers:
            small, _ = reduced(gray, DETECTION_SIDE)
            return isinstance(detect(small, board), Found)
        small, _ = reduced(gray, QUICK_SIDE)
        found, _, lattice = cv2.findChessboardCornersSBWithMeta(small, (3, 3), cv2.CALIB_CB_LARGER)
    shape = np.shape(lattice)[:2]
    return bool(found) and len(shape) == 2 and _is_large(min(shape), max(shape), board)


def _is_large(shorter: int, longer: int, board: Board | None) -> bool:
    """Return whether a lattice is too large to be a chance match; a smaller known board needs only its own size."""
    known = (min(board.lattice), max(board.lattice)) if board is not None else QUICK_FEWEST
    return shorter >= min(QUICK_FEWEST[0], known[0]) and min(QUICK_FEWEST[1], known[1]) <= longer <= LARGEST


def _small(path: Path, side: int) -> Gray:
    """Return the image reduced to at least ``side`` px; a JPEG decoder does this itself in a tenth of the time."""
    import cv2

    size = frame_size(path)
    factor = next((factor for factor in REDUCTIONS if max(size) >= side * factor), 1)
    if factor > 1 and path.suffix.lower() in {".jpg", ".jpeg"}:
        flag = getattr(cv2, f"IMREAD_REDUCED_GRAYSCALE_{factor}") | cv2.IMREAD_IGNORE_ORIENTATION
        gray = cv2.imread(str(path), flag)
        if gray is not None:
            return np.asarray(gray, dtype=np.uint8)
    return read_frame(path).gray
