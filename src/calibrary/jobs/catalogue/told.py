"""What the catalogue shows: the known cameras; of a few of them the source of each number."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from calibrary.catalogue import CatalogueListing
from calibrary.known_camera import KnownCamera
from calibrary.pages.wording import count, made_by
from calibrary.view import Block, Column, Note, Section, Table, Tone, View

DETAILS_UP_TO: Final = 6
"""Up to this many matches are shown in full; more are shown as a table."""


def _g(value: float | None) -> str:
    return f"{value:g}" if value is not None else ""


CAMERAS: Final = (
    Column("EXIF Model", lambda one: ", ".join(one.models)),
    Column("camera", lambda one: " ".join(filter(None, (one.title, one.lens))), rank=5),
    Column("sub-camera", lambda one: one.sub_camera or "", rank=1),
    Column(
        "native px",
        lambda one: "{}×{}".format(*one.native_size) if one.native_size else "",
        numeric=True,
        rank=2,
    ),
    Column("pitch µm", lambda one: _g(one.pitch_um), numeric=True, rank=6),
    Column("f mm", lambda one: _g(one.focal_mm), numeric=True, rank=4),
    Column(
        "fx/W", lambda one: f"{one.fx_over_w:.3f}" if one.fx_over_w is not None else "", numeric=True, rank=3
    ),
    Column("±", lambda one: f"{one.spread:.1%}" if one.spread is not None else "", numeric=True, rank=7),
    Column("projection", lambda one: one.projection.value, rank=8),
    Column("make", lambda one: one.make, rank=9),
)


def told(found: CatalogueListing) -> View:
    """Describe the cameras that were found."""
    cameras = found.cameras
    blocks: tuple[Block, ...] = (Table.of("Known cameras", cameras, CAMERAS),)
    if len(cameras) <= DETAILS_UP_TO:
        blocks += tuple(
            Section(title=f"{one.title} — sources", blocks=tuple(_details(one))) for one in cameras
        )
    else:
        blocks += ("calibrary catalogue MODEL shows the source of each number",)
    return View(
        title="Known cameras",
        lead=count(len(cameras), "known camera"),
        sections=(Section(title="Cameras", blocks=blocks),),
        made_by=made_by(),
    )


def _details(camera: KnownCamera) -> Iterator[Block]:
    yield from (f"{field}: {source}" for field, source in camera.sources)
    for (width, height), fx in camera.focal_lengths_px().items():
        lens = f" at {camera.focal_mm:g} mm" if camera.zoom_mm is not None and camera.focal_mm else ""
        middle = f"cx {width / 2:g} cy {height / 2:g}"
        yield f"K of {width}×{height}{lens}: fx {fx:.1f} fy {fx:.1f} {middle} px, nominal"
    yield from (
        Note(text=f"sources disagree: {conflict}", tone=Tone.CAUTION) for conflict in camera.conflicts
    )
    yield from camera.notes
