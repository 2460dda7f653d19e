"""Live guidance for a calibration, from a folder in which images of a board arrive."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

from calibrary.atomic import check_folder, write_files
from calibrary.calib.board import parse_board
from calibrary.extras import CALIBRATE, require
from calibrary.jobs.calibrate_watch.page import facts, watch_page
from calibrary.jobs.calibrate_watch.watch import Watch, WatchStatus
from calibrary.pages import render_page

__all__ = ["WatchStatus", "facts", "watch"]


def watch(
    folder: str | Path,
    board: str,
    *,
    square_mm: float | None = None,
    lens_model: str = "auto",
    page: str | Path | None = None,
    once: bool = False,
    every_s: float = 1.0,
) -> Iterator[WatchStatus]:
    """Evaluate each image of a board as it arrives, and report what the calibration still needs; end at a pass.

    Args:
        folder: folder where the images arrive; existing ones are processed first.
        board: board type and number of inner corners, such as "checkerboard:11x8".
        square_mm: side of a square in mm; K does not depend on it.
        lens_model: "auto", or the name of a lens model.
        page: an .html file that is rewritten after each image and reloads itself in the browser.
        once: process the existing images, then end.
        every_s: time between two scans of the folder in seconds.

    Raises:
        InputError: the folder or the board is not valid, or the page cannot be written.
    """
    require(CALIBRATE, "calibrating from a board")
    if page is not None:
        check_folder(Path(page), place="--page")
    session = Watch(Path(folder), parse_board(board, square_mm), lens_model)
    while True:
        status = session.poll(settled=once)
        if status is not None:
            if page is not None:
                write_files({Path(page): render_page(watch_page(session, status)).encode()})
            yield status
        if once or (status is not None and status.done):
            return
        time.sleep(every_s)
