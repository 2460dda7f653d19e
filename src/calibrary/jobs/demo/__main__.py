"""``python -m calibrary.jobs.demo OUT_DIR``: write the flight and print what it holds."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from calibrary.jobs.demo.flight import DemoImage, Expectation, write_flight
from calibrary.records import replace

_COLOURS = {
    Expectation.VALID: "green",
    Expectation.UNPROVEN: "yellow",
    Expectation.REJECTED: "red",
    Expectation.UNREADABLE: "magenta",
}
_PIPED_WIDTH = 140
"""Where there is no terminal to ask: wide enough that no file name is broken."""


def main(argv: list[str] | None = None) -> int:
    """Write the flight and its legend; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m calibrary.jobs.demo",
        description="Synthesise the flight of a mixed fleet to try calibrary on.",
    )
    parser.add_argument("out_dir", type=Path, metavar="OUT_DIR", help="folder to write to; it is made")
    parser.add_argument("--seed", type=int, default=7, help="of the country flown over (default: 7)")
    arguments = parser.parse_args(argv)
    try:
        images = write_flight(arguments.out_dir, seed=arguments.seed)
    except OSError as error:
        sys.stderr.write(f"cannot write the flight: {error}\n")
        return 3
    _print_legend(images, arguments.out_dir)
    return 0


def _print_legend(images: list[DemoImage], out_dir: Path) -> None:
    size_mb = sum((out_dir / image.name).stat().st_size for image in images) / 1e6
    console = Console()
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console = Console(width=_PIPED_WIDTH)
    table = Table(title=f"{len(images)} files, {size_mb:.1f} MB, in {out_dir}", title_justify="left")
    table.add_column("file", overflow="fold", no_wrap=console.width >= _PIPED_WIDTH)
    table.add_column("camera", no_wrap=True)
    table.add_column("what it is, and why")
    table.add_column("should be")
    table.add_column("fx px", justify="right")
    # Frames of one camera that tell one story share a row.
    rows: dict[DemoImage, list[str]] = {}
    for image in images:
        rows.setdefault(replace(image, name="", private=()), []).append(image.name)
    for image, names in rows.items():
        files = names[0] if len(names) == 1 else f"{names[0]}\n[dim]and {len(names) - 1} more[/]"
        colour = _COLOURS[image.outcome]
        table.add_row(
            files,
            image.camera,
            f"{image.story}\n[dim]{image.reason}[/]",
            f"[{colour}]{image.outcome}[/]",
            "–" if image.fx_px is None else f"{image.fx_px:.1f}",
        )
    console.print(table)


if __name__ == "__main__":
    sys.exit(main())
