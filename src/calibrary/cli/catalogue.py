"""``calibrary catalogue``: what is known of cameras before any of their images is read."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from calibrary.known_camera import KnownCamera

__all__ = ["add_parser"]

EXAMPLES = """\
examples:
  calibrary catalogue                  every camera
  calibrary catalogue M3T              what shares this Model, with sources and conflicts
  calibrary catalogue "phantom 4"      by what people call it
"""

DETAILS_UP_TO = 6
"""So many matches are told in full; more are a table."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = subparsers.add_parser(
        "catalogue",
        help="print the known cameras, their pixels and where each number is from",
        description="Print the known cameras, their pixels and where each number is from.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "model", nargs="?", metavar="MODEL", help="part of a make, EXIF Model, name or lens (default: all)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from calibrary.registry.catalogue import load_catalogue, to_json

    catalogue = load_catalogue()
    cameras = catalogue.search(arguments.model) if arguments.model else list(catalogue)
    if arguments.json:
        document = {
            "schema": "calibrary/catalogue-listing-1",
            "cameras": [to_json(camera) for camera in cameras],
        }
        sys.stdout.flush()
        sys.stdout.buffer.write((json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode())
    elif not cameras:
        sys.stderr.write(
            f"calibrary: the catalogue has no camera like {arguments.model!r}; "
            "'calibrary catalogue' lists them all\n"
        )
    else:
        _show(cameras)
    return 0 if cameras else 1


def _show(cameras: Sequence[KnownCamera]) -> None:
    from calibrary.cli.console import make_console, plain

    console = make_console(stderr=False)
    console.print(_table(cameras))
    if len(cameras) > DETAILS_UP_TO:
        console.print("[dim]calibrary catalogue MODEL tells where each number is from[/]")
        return
    for camera in cameras:
        console.print(f"\n[bold]{plain(camera.title)}[/] — where the numbers are from")
        for field, source in camera.sources:
            console.print(f"  {field}: {plain(source)}", highlight=False, soft_wrap=True)
        for conflict in camera.conflicts:
            console.print(
                f"  [yellow]sources disagree[/]: {plain(conflict)}", highlight=False, soft_wrap=True
            )
        for note in camera.notes:
            console.print(f"  [dim]{plain(note)}[/]", highlight=False, soft_wrap=True)


def _table(cameras: Sequence[KnownCamera]) -> Table:
    from rich.table import Table

    from calibrary.cli.console import plain

    table = Table(title=f"{len(cameras)} known cameras", title_justify="left")
    for heading in ("make", "EXIF Model", "camera", "sub-camera"):
        table.add_column(heading, overflow="fold")
    for heading in ("native px", "pitch µm", "f mm", "fx/W", "±"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("projection", no_wrap=True)
    for camera in cameras:
        table.add_row(
            plain(camera.make),
            plain(", ".join(camera.models)),
            plain(" ".join(part for part in (camera.title, camera.lens) if part)),
            camera.sub_camera or "",
            "{}×{}".format(*camera.native_size) if camera.native_size else "",
            _g(camera.pitch_um),
            _g(camera.focal_mm),
            f"{camera.fx_over_w:.3f}" if camera.fx_over_w is not None else "",
            f"{camera.spread:.1%}" if camera.spread is not None else "",
            camera.projection.value,
        )
    return table


def _g(value: float | None) -> str:
    return f"{value:g}" if value is not None else ""
