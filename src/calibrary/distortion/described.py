"""Document of the distortion models: the formula and the order of the parameters of each."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Final

from calibrary.distortion import MODELS
from calibrary.distortion.base import Distortion

HEAD: Final = """\
A calibration has K = [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] and one of these distortion models. K is in pixels from
the outer corner of the top-left pixel, whose centre is (0.5, 0.5). A point (X, Y, Z) of the camera frame (x right,
y down, z forward) has x = X/Z, y = Y/Z. The model maps (x, y) to the distorted (x', y'). The pixel is then
u = fx·x' + skew·y' + cx, v = fy·y' + cy. Models of wide lenses, which see more than a plane can show, take the ray
itself. In JSON and in the entries of a registry, the name of the model is the field `model` of the distortion, and its
parameters are beside it under their names.

"""


def document(made_by: str) -> str:
    """Return all models with their formulas and parameters, as Markdown.

    Args:
        made_by: sentence that says what wrote the document.
    """
    return f"# Distortion models\n\n{made_by}\n\n{HEAD}" + "\n".join(_sections())


def _sections() -> Iterator[str]:
    for name, kind in MODELS.items():
        yield f"## {name}\n\nParameters in order: {_order(kind)}.\n\n{_description(kind)}\n"


def _order(kind: type[Distortion]) -> str:
    return ", ".join(f"`{item}`" for item in kind.names()) or "none"


def _description(kind: type[Distortion]) -> str:
    return marked_down(inspect.cleandoc(kind.__doc__ or ""))


def marked_down(text: str) -> str:
    """Convert a docstring's reStructuredText to Markdown: literal blocks, code, and references to code."""
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
