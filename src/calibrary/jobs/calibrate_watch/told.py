"""What a watch session shows: the new frames, what is covered, and the next pose; a browser reloads it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from calibrary.jobs.calibrate_watch.session import WatchedFrame, WatchStatus
from calibrary.pages.plots import Axis
from calibrary.pages.plots.svg_plots import amount_map, cell_centres
from calibrary.pages.wording import made_by
from calibrary.probability import two_digits
from calibrary.validation import Use
from calibrary.view import Badge, Block, Column, Figure, KeyValues, Note, Plots, Section, Table, Tone, View

REFRESH_S = 2
BADGES = {
    Use.FIXED: Badge("keep it fixed", Tone.GOOD),
    Use.START: Badge("start from it", Tone.CAUTION),
    Use.NONE: Badge("not yet", Tone.BAD),
    None: Badge("not yet", Tone.NEUTRAL),
}
LAST_FRAMES = 30
MOST_MISSING = 3
FRAMES = (
    Column("frame", lambda one: one.name),
    Column(
        "corners",
        lambda one: str(one.corners) if one.corners else Badge("not counted", Tone.CAUTION),
        numeric=True,
    ),
    Column("remarks", lambda one: "; ".join(one.remarks), below=""),
)


def told(status: WatchStatus, frames: Sequence[WatchedFrame] | None = None) -> View:
    """Describe the present status, and the frames so far (by default the new ones)."""
    passes = "; FIXED is in reach: calibrate from these frames" if status.done else ""
    return View(
        title="Photographing a board",
        badge=BADGES[status.verdict],
        lead=f"{status.views} of {status.frames} frames count{passes}",
        sections=(
            Section(
                title="Frames", anchor="frames", blocks=(_frames(status.new if frames is None else frames),)
            ),
            Section(title="So far", anchor="so-far", blocks=tuple(_so_far(status))),
            Section(title="Next", anchor="next", blocks=tuple(_next(status))),
        ),
        made_by=made_by(),
        contents=False,
        refresh_s=None if status.done else REFRESH_S,
    )


def _next(status: WatchStatus) -> Iterator[Block]:
    if status.done:
        yield Note(text="No more frames are needed.", tone=Tone.GOOD)
        return
    yield from (
        Note(text=f"missing: {reason}", tone=Tone.CAUTION) for reason in status.missing[:MOST_MISSING]
    )
    if status.next is not None:
        expected = f"{two_digits(status.next.edge_px)} px, {status.next.gain:.0%} less"
        gain = f"The largest σ over the frame is then expected at {expected}."
        yield Note(text=gain, action=str(status.next))


def _so_far(status: WatchStatus) -> Iterator[Block]:
    yield KeyValues(tuple(_facts(status)))
    if status.image_size is not None:
        yield Plots(partial(_covered, status))


def _covered(status: WatchStatus) -> Iterator[Figure]:
    if status.image_size is not None:
        counts = np.array(status.cells, dtype=float)
        yield amount_map(
            cell_centres(counts.shape, status.image_size),
            np.where(counts > 0, counts, np.nan),
            status.image_size,
            axis=Axis("corners"),
            caption="Where corners were seen so far.",
        )


def _facts(status: WatchStatus) -> Iterator[tuple[str, str]]:
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
    return Table.of("The latest first", frames[: -LAST_FRAMES - 1 : -1], FRAMES)
