"""Evaluate frames of a board as they arrive in a folder, and say what the calibration still needs.

>>> from calibrary.jobs.calibrate_watch import watch
>>> [status] = watch("frames", board="checkerboard:9x6", once=True)
>>> status.views, status.done
(10, True)
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from msgspec import Meta

from calibrary.arguments import Edge, File, Folder, LensModel

if TYPE_CHECKING:
    from calibrary.jobs.calibrate_watch.session import WatchStatus

__all__ = ["watch"]


def watch(
    folder: Folder,
    *,
    board: Annotated[str, Meta(title="BOARD")],
    square_mm: Edge | None = None,
    lens_model: LensModel = "auto",
    html: File | None = None,
    once: bool = False,
    every_s: Annotated[float, Meta(ge=0.05, le=60)] = 1.0,
) -> Iterator[WatchStatus]:
    """Evaluate each image of a board as it arrives, and yield what the calibration still needs; end at a pass.

    Args:
        folder: where the frames arrive; those that are there are evaluated first.
        board: pattern and number of inner corners, such as checkerboard:11x8.
        square_mm: side of a square; K does not depend on it.
        lens_model: distortion model; auto chooses it by the corners.
        html: a page that is rewritten after each frame and reloads itself.
        once: evaluate the frames that are there, and end.
        every_s: time between two checks of the folder.

    Raises:
        InputError: the folder or the board is not valid, or the page cannot be written.
        MissingExtraError: OpenCV, or what draws pages, is not installed.
    """
    from calibrary.calib.board import parse_board
    from calibrary.calib.lens_models import Solvable
    from calibrary.extras import CALIBRATE, require
    from calibrary.jobs.calibrate_watch.run import watched
    from calibrary.jobs.calibrate_watch.session import Watch
    from calibrary.pages import check_page_place

    require(CALIBRATE, "calibrating from a board")
    Solvable.named(lens_model)
    page = check_page_place(html)
    session = Watch(Path(folder), parse_board(board, square_mm), lens_model)
    return watched(session, page, once=once, every_s=every_s)
