"""A watch session: the folder is scanned again and again, and the page written each time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

from calibrary.atomic import write_files
from calibrary.jobs.calibrate_watch.session import Watch, WatchStatus
from calibrary.jobs.calibrate_watch.told import told
from calibrary.pages import render_page


def watched(watch: Watch, page: Path | None, *, once: bool, every_s: float) -> Iterator[WatchStatus]:
    """Yield each status of a session, with its page written, until the calibration passes.

    Args:
        watch: the session.
        page: file of the page; None for no page.
        once: process the frames that are there, then end.
        every_s: time between two scans of the folder.
    """
    while True:
        status = watch.poll(settled=once)
        if status is not None:
            if page is not None:
                write_files({page: render_page(told(status, watch.frames)).encode()})
            yield status
        if once or (status is not None and status.done):
            return
        time.sleep(every_s)
