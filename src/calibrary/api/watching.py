"""Watching a folder in which frames of a board arrive."""

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
    """Look at each frame of a board as it arrives, and say what the calibration still needs; ends when it passes.

    Args:
        folder: where the frames arrive; those that are there are looked at first.
        board: which one, such as "checkerboard:11x8".
        square_mm: side of a square, which K does not depend on.
        lens_model: "auto", or the name of one.
        page: an .html file that is rewritten after each frame and reloads itself in the browser.
        once: look at what is there, and end.
        every_s: seconds between two looks into the folder.

    Raises:
        InputError: the folder or the board is none, or the page cannot be written.
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
