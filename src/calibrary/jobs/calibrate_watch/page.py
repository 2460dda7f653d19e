"""Page of a watch session; the browser reloads it every few seconds, for example on a tablet next to the board."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from calibrary.atomic import write_files
from calibrary.calib.verdict import BoardVerdict
from calibrary.jobs.calibrate_watch.session import Watch, WatchedFrame, WatchStatus
from calibrary.pages import render_page
from calibrary.pages.plots import Axis, heat_map
from calibrary.probability import two_digits
from calibrary.view import Badge, Block, Bullets, Column, KeyValues, Note, Section, Table, Tone, View

REFRESH_S = 2
BADGES = {
    BoardVerdict.PASS: Badge("pass", Tone.GOOD),
    BoardVerdict.PROVISIONAL: Badge("provisional", Tone.CAUTION),
    BoardVerdict.REFUSE: Badge("not yet", Tone.BAD),
    None: Badge("not yet", Tone.NEUTRAL),
}
LAST_FRAMES = 30


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
                write_files({page: render_page(watch_page(status, watch.frames)).encode()})
            yield status
        if once or (status is not None and status.done):
            return
        time.sleep(every_s)


def watch_page(status: WatchStatus, frames: Sequence[WatchedFrame]) -> View:
    """Make the page of the present status, and of the frames so far."""
    return View(
        title="Photographing a board",
        badge=BADGES[status.verdict],
        lead=f"{status.views} of {status.frames} frames count."
        + (" The calibration passes: no more frames are needed." if status.done else ""),
        sections=(
            Section(title="Next", anchor="next", blocks=tuple(_next(status))),
            Section(title="So far", anchor="so-far", blocks=tuple(_so_far(status))),
            Section(title="Frames", anchor="frames", blocks=(_frames(frames),)),
        ),
        made_by="Made by calibrary calibrate watch.",
        contents=False,
        refresh_s=None if status.done else REFRESH_S,
    )


def _next(status: WatchStatus) -> Iterator[Block]:
    if status.done:
        yield Note(text="It passes.", action="solve it with calibrary calibrate", tone=Tone.GOOD)
        return
    if status.next is not None:
        expected = f"{two_digits(status.next.edge_px)} px, {status.next.gain:.0%} less"
        gain = f"The largest σ over the frame is then expected at {expected}."
        yield Note(text=f"{str(status.next).capitalize()}.", action=gain, tone=Tone.NEUTRAL)
    if status.missing:
        yield Bullets(status.missing)


def _so_far(status: WatchStatus) -> Iterator[Block]:
    yield KeyValues(tuple(facts(status)))
    if status.image_size is not None:
        counts = np.array(status.cells, dtype=float)
        yield heat_map(
            np.where(counts > 0, counts, np.nan),
            status.image_size,
            axis=Axis("corners"),
            cells=True,
            caption="Where corners were seen so far.",
        )


def facts(status: WatchStatus) -> Iterator[tuple[str, str]]:
    """Coverage, tilt and standard deviations, in words."""
    yield "coverage", f"{status.coverage:.0%} of the cells"
    if status.tilt_spread_deg is not None:
        yield "tilt", f"normals spread {status.tilt_spread_deg:.0f}°"
    sigma = status.sigma
    if sigma is not None:
        values = {"fx": sigma.fx, "cx": sigma.cx, "cy": sigma.cy, "largest over the frame": sigma.edge}
        yield (
            "σ × κ",
            ", ".join(
                f"{name} {two_digits(value)} px" for name, value in values.items() if value is not None
            ),
        )


def _frames(frames: Sequence[WatchedFrame]) -> Table:
    return Table(
        caption="The latest first",
        columns=(Column("frame"), Column("corners", numeric=True), Column("remarks")),
        rows=tuple(
            (
                frame.name,
                str(frame.corners) if frame.corners else Badge("not counted", Tone.CAUTION),
                "; ".join(frame.remarks),
            )
            for frame in frames[: -LAST_FRAMES - 1 : -1]
        ),
    )
