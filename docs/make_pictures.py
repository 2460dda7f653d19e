"""Draw the README's picture: what ``calibrary extract`` really says of part of the demonstration flight.

``make pictures`` runs this file after the output has changed; a test compares the picture with the output.
"""

from __future__ import annotations

import argparse
import io
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.terminal_theme import TerminalTheme
from rich.text import Text

from calibrary.cli.extract_display import judgement
from calibrary.demo import write_flight
from calibrary.extract.run import Request, run

DOCS = Path(__file__).parent
WIDTH = 90
COMMAND = "calibrary extract --image-dir flight --recursive"

CHOSEN = (
    "100_0001/*.JPG",
    "DJI_202405170930_001/*.JPG",
    "micasense/0000SET/000/IMG_0000_1.tif",
    "phantom4pro/DJI_0102.JPG",
    "phone/*.jpg",
)
"""A story each: calibrated, two cameras under one Model, a band, a zoomed frame, a 35 mm equivalent, a torn file."""

THEME = TerminalTheme(
    background=(22, 25, 31),
    foreground=(222, 226, 232),
    normal=[
        (22, 25, 31),
        (239, 107, 107),
        (126, 201, 110),
        (229, 192, 89),
        (97, 155, 230),
        (190, 140, 220),
        (86, 190, 195),
        (222, 226, 232),
    ],
)

# rich's own frame fetches a typeface from the network; this one makes do with what the reader's machine has.
FRAME = """\
<svg class="rich-terminal" viewBox="0 0 {width} {height}" xmlns="http://www.w3.org/2000/svg">
<style>
.{unique_id}-matrix {{ font: {char_height}px/{line_height}px ui-monospace, Menlo, Consolas, "DejaVu Sans Mono", \
monospace; font-variant-east-asian: full-width; }}
.{unique_id}-title {{ font: bold 18px sans-serif; }}
{styles}
</style>
<defs>
<clipPath id="{unique_id}-clip-terminal">
<rect x="0" y="0" width="{terminal_width}" height="{terminal_height}"/>
</clipPath>
{lines}
</defs>
{chrome}
<g transform="translate({terminal_x}, {terminal_y})" clip-path="url(#{unique_id}-clip-terminal)">
{backgrounds}
<g class="{unique_id}-matrix">
{matrix}
</g>
</g>
</svg>
"""


def draw(flight: Path) -> str:
    """The picture, as SVG, of the chosen files of a demonstration flight."""
    with TemporaryDirectory() as folder:
        for pattern in CHOSEN:
            for path in sorted(flight.glob(pattern)):
                copy = Path(folder) / path.relative_to(flight)
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, copy)
        outcome = run(Request(image_dir=Path(folder), recursive=True))
    console = Console(
        record=True, width=WIDTH, file=io.StringIO(), force_terminal=True, color_system="truecolor"
    )
    console.print(Text.assemble(("$ ", "cyan"), COMMAND, "\n"))
    console.print(judgement(outcome, width=WIDTH), "", highlight=False)
    return console.export_svg(title="calibrary", theme=THEME, code_format=FRAME, unique_id="extract")


def main() -> int:
    """Draw into a folder, this one unless another is named."""
    parser = argparse.ArgumentParser(description="Draw the README's picture.")
    parser.add_argument(
        "out", type=Path, nargs="?", default=DOCS, help="folder (default: where this file lies)"
    )
    parser.add_argument("--flight", type=Path, help="a demonstration flight that is there already")
    arguments = parser.parse_args()
    if arguments.flight is not None:
        picture = draw(arguments.flight)
    else:
        with TemporaryDirectory() as folder:
            write_flight(Path(folder))
            picture = draw(Path(folder))
    (arguments.out / "extract.svg").write_text(picture, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
