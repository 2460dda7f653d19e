"""A watch session: the board is detected in each frame that arrives in a folder, and the camera is solved again.

The frames are the only state: after a restart they are read again.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.detection import SearchedImage, search_image
from calibrary.calib.estimation import estimate
from calibrary.calib.found import Reason, Remark
from calibrary.calib.frames import frame_size
from calibrary.calib.geometry import CELLS, coverage
from calibrary.calib.next_pose import NextPose, next_pose
from calibrary.calib.observations import Observations, View
from calibrary.calib.opencv_state import one_thread
from calibrary.calib.result import CalibrationResult
from calibrary.calib.view_quality import judge_repeats
from calibrary.calibration import CameraKey, ImageSize
from calibrary.errors import CalibrationError, InputError
from calibrary.interrupts import interrupts_held
from calibrary.jobs.calibrate.frames import is_frame, refuse_recordings
from calibrary.records import Record
from calibrary.validation import Severity, Use

Stamp: TypeAlias = tuple[int, int]
"""File size in bytes and modification time, by which a file that is still being written is recognised."""

FEWEST_VIEWS: Final = 3


class WatchedFrame(Record):
    """Result of one frame.

    Attributes:
        name: of its file.
        corners: number of detected corners; 0 if the frame is not used.
        remarks: why it is not used, and other remarks.
    """

    name: str
    corners: int
    remarks: tuple[str, ...]


class WatchSigma(Record):
    """Present standard deviations in px, including the variance factor.

    Attributes:
        fx, cx, cy: of the parameters; None if the model has no such parameter.
        edge: of a direction, the maximum over the image.
    """

    fx: float | None
    cx: float | None
    cy: float | None
    edge: float | None


class WatchStatus(Record, tag_field="schema", tag="calibrate-watch-1"):
    """Status of a session.

    Attributes:
        new: frames examined since the last status.
        frames: number of frames examined in total.
        views: number of views used.
        verdict: of the calibration; None while there are too few views.
        missing: findings that prevent it from passing, most severe first.
        coverage: fraction of the image's cells with a corner.
        image_size: (width, height) px of the frames; None before the first.
        cells: number of corners in each cell of the image, row by row from its top.
        tilt_spread_deg: spread of the board normals.
        sigma: standard deviations; None while there is no calibration.
        next: the pose that would help most; None before the first frame.
        done: whether the calibration passes.
    """

    new: tuple[WatchedFrame, ...]
    frames: int
    views: int
    verdict: Use | None
    missing: tuple[str, ...]
    coverage: float
    image_size: ImageSize | None
    cells: tuple[tuple[int, ...], ...]
    tilt_spread_deg: float | None
    sigma: WatchSigma | None
    next: NextPose | None
    done: bool


class Watch:
    """A session; call :meth:`poll` repeatedly."""

    def __init__(self, folder: Path, board: Board, model: str = "auto") -> None:
        """Start a session; no frame is read yet.

        Raises:
            InputError: ``folder`` is not a folder.
        """
        refuse_recordings(
            [folder], "expected the folder in which frames arrive; calibrary calibrate takes recordings"
        )
        if not folder.is_dir():
            raise InputError(
                "is not a folder; expected the one in which the frames arrive", source=str(folder)
            )
        self._folder, self._board, self._model = folder, board, model
        self._stamps: dict[Path, Stamp] = {}
        self._done: dict[Path, Stamp] = {}
        self._looked: dict[Path, SearchedImage] = {}
        self._size: ImageSize | None = None
        self.result: CalibrationResult | None = None
        self.frames: tuple[WatchedFrame, ...] = ()

    def poll(self, *, settled: bool = False) -> WatchStatus | None:
        """Process the frames that have arrived.

        Args:
            settled: whether to read files at once; otherwise a file is read when unchanged since the last call.

        Returns:
            The status; None if nothing is new.
        """
        new = []
        # An interruption inside a library's callback could not be raised from it, and would only be printed.
        for path, stamp in self._ready(settled=settled):
            with interrupts_held():
                new.append(self._look(path))
                self._done[path] = stamp
        with interrupts_held():
            return self._status(tuple(new)) if new else None

    def _ready(self, *, settled: bool) -> Iterator[tuple[Path, Stamp]]:
        """New or changed frames that have been written completely."""
        before, self._stamps = self._stamps, {}
        for path in sorted(self._folder.iterdir()):
            if not is_frame(path) or path.name.startswith("."):
                continue
            with suppress(OSError):
                status = path.stat()
                stamp = (status.st_size, status.st_mtime_ns)
                self._stamps[path] = stamp
                if self._done.get(path) != stamp and (settled or (stamp[0] and before.get(path) == stamp)):
                    yield path, stamp

    def _look(self, path: Path) -> WatchedFrame:
        try:
            self._size = self._size or frame_size(path)
            with one_thread():
                looked = search_image(path, board=self._board, size=self._size)
        except InputError as error:
            remark = Remark(reason=Reason.UNREADABLE, text=error.message, rejects=True)
            looked = SearchedImage(name=path.name, remarks=(remark,))
        self._looked[path] = looked
        counts = looked.view is not None and looked.rejection is None
        return WatchedFrame(
            name=path.name,
            corners=len(looked.view.ids) if looked.view is not None and counts else 0,
            remarks=tuple(remark.text for remark in looked.remarks),
        )

    def _views(self) -> tuple[View, ...]:
        """The used views, without repeated poses."""
        views = [one.view for one in self._looked.values() if one.view is not None and one.rejection is None]
        repeats = judge_repeats(views)
        return tuple(view for at, view in enumerate(views) if at not in repeats)

    def _status(self, new: tuple[WatchedFrame, ...]) -> WatchStatus:
        views, self.result = self._views(), None
        problem: tuple[str, ...] = ()
        names = {frame.name for frame in new}
        self.frames = (*(frame for frame in self.frames if frame.name not in names), *new)
        if self._size is not None and len(views) >= FEWEST_VIEWS:
            seen = Observations(board=self._board, image_size=self._size, views=views, camera=CameraKey())
            try:
                self.result = estimate(seen, self._model)
            except CalibrationError as error:
                problem = (str(error),)
        result, shown = self.result, [view.image_points for view in views]
        pixels = np.concatenate(shown) if shown else np.empty((0, 2))
        verdict = result.verdict if result is not None else None
        missing = problem or (
            () if result is not None else (f"{len(views)} views count, need {FEWEST_VIEWS}",)
        )
        if result is not None:
            missing = tuple(
                f"{one.message}: {one.remedy}" if one.remedy else one.message
                for one in result.findings
                if one.severity is not Severity.NOTE
            )
        return WatchStatus(
            new=new,
            frames=len(self._looked),
            views=len(views),
            verdict=verdict,
            missing=missing,
            coverage=coverage(pixels, self._size).fraction if self._size is not None else 0.0,
            image_size=self._size,
            cells=_cells(pixels, self._size) if self._size is not None else (),
            tilt_spread_deg=result.evidence.geometry.tilt_spread_deg if result is not None else None,
            sigma=_sigma(result) if result is not None else None,
            next=next_pose(self._board, self._size, result) if self._size is not None else None,
            done=verdict is Use.FIXED,
        )


def _cells(pixels: FloatArray, size: ImageSize) -> tuple[tuple[int, ...], ...]:
    (width, height), (columns, rows) = size, CELLS
    counts, _, _ = np.histogram2d(
        pixels[:, 1], pixels[:, 0], bins=(rows, columns), range=((0, height), (0, width))
    )
    return tuple(tuple(int(count) for count in row) for row in counts)


def _sigma(result: CalibrationResult) -> WatchSigma:
    quality = result.calibration.quality
    std = dict(quality.std) if quality is not None else {}
    wider = float(np.sqrt(quality.inflation)) if quality is not None else 1.0
    fx, cx, cy = (std[name] * wider if name in std else None for name in ("fx", "cx", "cy"))
    return WatchSigma(fx=fx, cx=cx, cy=cy, edge=result.evidence.edge_px)
