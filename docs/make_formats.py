"""Write docs/formats.md and docs/distortion.md; ``make docs`` runs this, a test keeps them fresh."""

from __future__ import annotations

import inspect
import sys
from pathlib import Path
from typing import Final

from calibrary import parsers
from calibrary.cli.formats import markdown
from calibrary.distortion.described import document, marked_down
from calibrary.parsers.format import Format

FOLDER: Final = Path(__file__).parent

FORMATS_HEAD: Final = """\
# Calibration files

Printed by `make docs` from the formats' own records. What a coefficient means is in [distortion.md](distortion.md).

"""


def documents() -> dict[str, str]:
    """Both documents by their file names."""
    records = parsers.formats()
    described = "\n".join(_format(record) for record in records if record.refuses is None)
    return {
        "formats.md": f"{FORMATS_HEAD}{markdown(records)}\n## Each in its own words\n\n{described}",
        "distortion.md": document("Printed by `make docs` from the models' own descriptions."),
    }


def _format(record: Format) -> str:
    """What a format's module says of it: its words, what they mean, and where that is known from."""
    said = marked_down(inspect.cleandoc(sys.modules[record.sniff.__module__].__doc__ or ""))
    facts = [f"Reference: <{record.reference}>"]
    if record.needs_image_size:
        facts.append("The image size does not stand in it: `--image-size WxH`.")
    facts += [
        f"`--set {option.name}={'|'.join(option.values)}`: {option.meaning}" for option in record.options
    ]
    listed = "".join(f"* {fact}\n" for fact in facts)
    return f"### {record.name}\n\n{said}\n\n{listed}"


if __name__ == "__main__":
    for name, text in documents().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
