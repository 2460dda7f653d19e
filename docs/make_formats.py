"""Write docs/formats.md and docs/distortion.md; ``make docs`` runs this, a test keeps them fresh."""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path
from typing import Final

from calibrary import parsers
from calibrary.cli.formats import markdown
from calibrary.distortion import MODELS, Distortion
from calibrary.parsers.format import Format

FOLDER: Final = Path(__file__).parent

FORMATS_HEAD: Final = """\
# Calibration files

Printed by `make docs` from the formats' own records. What a coefficient means is in [distortion.md](distortion.md).

"""
MODELS_HEAD: Final = """\
# Distortion models

Printed by `make docs` from the models' own descriptions.

A calibration here has K = [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] in pixels from the outer corner of the top-left
pixel, whose centre is (0.5, 0.5), and beside it one of these models. A point (X, Y, Z) of the camera frame (x right,
y down, z forward) has x = X/Z, y = Y/Z; the model takes (x, y) to the distorted (x', y'), and u = fx·x' + skew·y' + cx,
v = fy·y' + cy is where it is seen. The models of a lens that sees more than a plane shows take the ray itself. A
model's name is `model` of the distortion in JSON and in a registry's entries; its parameters stand beside it under
their names.

"""


def documents() -> dict[str, str]:
    """Both documents by their file names."""
    records = parsers.formats()
    described = "\n".join(_format(record) for record in records if record.refuses is None)
    models = "\n".join(_model(name, kind) for name, kind in MODELS.items())
    return {
        "formats.md": f"{FORMATS_HEAD}{markdown(records)}\n## Each in its own words\n\n{described}",
        "distortion.md": MODELS_HEAD + models,
    }


def _format(record: Format) -> str:
    """What a format's module says of it: its words, what they mean, and where that is known from."""
    said = _marked_down(inspect.cleandoc(sys.modules[record.sniff.__module__].__doc__ or ""))
    facts = [f"Reference: <{record.reference}>"]
    if record.needs_image_size:
        facts.append("The image size does not stand in it: `--image-size WxH`.")
    facts += [
        f"`--set {option.name}={'|'.join(option.values)}`: {option.meaning}" for option in record.options
    ]
    listed = "".join(f"* {fact}\n" for fact in facts)
    return f"### {record.name}\n\n{said}\n\n{listed}"


def _model(name: str, kind: type[Distortion]) -> str:
    """A model's formula, and its parameters in their order."""
    order = ", ".join(f"`{item}`" for item in kind.names()) or "none"
    said = _marked_down(inspect.cleandoc(kind.__doc__ or ""))
    return f"## {name}\n\nParameters in order: {order}.\n\n{said}\n"


def _marked_down(text: str) -> str:
    """A docstring's reStructuredText as Markdown: literal blocks, code, and references to code."""
    text = re.sub(r":\w+:`~?(?:[\w.]*\.)?(\w+)`", r"`\1`", text).replace("``", "`")
    lines: list[str] = []
    block = False
    for line in text.splitlines():
        if block and line and not line.startswith(" "):
            while lines and not lines[-1]:
                lines.pop()
            lines += ["```", ""]
            block = False
        if line.endswith("::") and not block:
            lines += [line[:-1] if line != "::" else "", "", "```text"]
            block = True
        elif not (block and lines[-1] == "```text" and not line):
            lines.append(line)
    while lines and not lines[-1]:
        lines.pop()
    return "\n".join([*lines, "```"] if block else lines)


if __name__ == "__main__":
    for name, text in documents().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
