"""``calibrary catalogue``: show the known cameras and their data."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.commands import (
    add_json_flag,
    add_table_flag,
    check_table_flag,
    meant,
    print_json,
    write_table,
)
from calibrary.cli.flags import add_flags, call
from calibrary.cli.tables import Column, fitted
from calibrary.jobs.catalogue import known_cameras

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.text import Text

    from calibrary.cli.console import Screen
    from calibrary.jobs.tables.rows import Table
    from calibrary.known_camera import KnownCamera

DESCRIPTION = "Print the known cameras, their pixels and the source of each number."
EXAMPLES = """\
examples:
  calibrary catalogue                  every camera
  calibrary catalogue M3T              cameras with this Model, with K, sources and conflicts
  calibrary catalogue "phantom 4"      by its common name
  calibrary catalogue --table cameras.csv
"""

EXIT_NONE = 1
DETAILS_UP_TO = 6
"""Up to this many matches are shown in full; more are shown as a table."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, known_cameras, positional={"model": "MODEL"})
    add_json_flag(parser)
    add_table_flag(parser, "the cameras")


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import errors, out, plain

    check_table_flag(arguments)
    found = call(known_cameras, arguments)
    write_table(arguments.table, lambda: _as_table(found.cameras))
    if arguments.json:
        print_json(found)
    elif not found.cameras:
        words = [word for one in known_cameras().cameras for word in (*one.models, one.title)]
        remedy = meant(arguments.model, words) or "'calibrary catalogue' lists them all"
        errors().say(plain(f"calibrary: the catalogue has no camera like {arguments.model!r}; {remedy}"))
    else:
        _show(out(arguments), found.cameras)
    return 0 if found.cameras else EXIT_NONE


COLUMNS = (
    Column(name="EXIF Model", wraps=True),
    Column(name="camera", rank=5, wraps=True),
    Column(name="sub-camera", rank=1),
    Column(name="native px", rank=2, right=True),
    Column(name="pitch µm", rank=6, right=True),
    Column(name="f mm", rank=4, right=True),
    Column(name="fx/W", rank=3, right=True),
    Column(name="±", rank=7, right=True),
    Column(name="projection", rank=8),
    Column(name="make", rank=9),
)


def _show(screen: Screen, cameras: Sequence[KnownCamera]) -> None:
    from calibrary.cli.console import plain

    screen.show(_table(cameras, screen.width))
    screen.say(f"{len(cameras)} known cameras" if len(cameras) > 1 else "1 known camera")
    if len(cameras) > DETAILS_UP_TO:
        screen.say("[dim]calibrary catalogue MODEL shows the source of each number[/]")
        return
    for camera in cameras:
        screen.say("")
        screen.say(f"[bold]{plain(camera.title)}[/] — sources")
        for field, source in camera.sources:
            screen.say(f"  {field}: {plain(source)}")
        for (width, height), fx in camera.focal_lengths_px().items():
            lens = f" at {camera.focal_mm:g} mm" if camera.zoom_mm is not None and camera.focal_mm else ""
            middle = f"cx {width / 2:g} cy {height / 2:g}"
            screen.say(f"  K of {width}×{height}{lens}: fx {fx:.1f} fy {fx:.1f} {middle} px, nominal")
        for conflict in camera.conflicts:
            screen.say(f"  [yellow]sources disagree[/]: {plain(conflict)}")
        for remark in camera.notes:
            screen.say(f"  [dim]{plain(remark)}[/]")


def _table(cameras: Sequence[KnownCamera], width: int) -> list[Text]:
    from calibrary.cli.console import plain

    rows = [
        (
            plain(", ".join(camera.models)),
            plain(" ".join(part for part in (camera.title, camera.lens) if part)),
            plain(camera.sub_camera or ""),
            "{}×{}".format(*camera.native_size) if camera.native_size else "",
            _g(camera.pitch_um),
            _g(camera.focal_mm),
            f"{camera.fx_over_w:.3f}" if camera.fx_over_w is not None else "",
            f"{camera.spread:.1%}" if camera.spread is not None else "",
            camera.projection.value,
            plain(camera.make),
        )
        for camera in cameras
    ]
    return fitted(COLUMNS, rows, width)


def _as_table(cameras: Sequence[KnownCamera]) -> Table:
    from calibrary.jobs.tables.rows import catalogue_table

    return catalogue_table(cameras)


def _g(value: float | None) -> str:
    return f"{value:g}" if value is not None else ""
