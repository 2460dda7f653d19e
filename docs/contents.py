"""The order of the manual's pages: an index holds the pages that it links to, so that it is whole without a build.

A code host shows a toctree as its source; the build makes it of the links.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

SECTIONS: Final = {
    "tutorials": "Tutorials",
    "how-to": "How-to",
    "reference": "Reference",
    "background": "Background",
}
HELD_LAST: Final = "how-to"
"""This index also links to pages of the others."""
MADE: Final = (
    "commands/index",
    "exit-codes",
    "python",
    "python-jobs",
    "hand-off",
    "policies",
    "schemas/index",
    "catalogue",
)
"""Pages of the reference that a build makes from the code: without one, a link to them is dead."""


def pages(docs: Path) -> Mapping[str, list[str]]:
    """The pages of each section, in the order of its index; one that two of them link to is in one."""
    found: dict[str, list[str]] = {}
    for folder in sorted(SECTIONS, key=HELD_LAST.__eq__):
        text = (docs / folder / "index.md").read_text(encoding="utf-8")
        linked = [
            posixpath.normpath(f"{folder}/{name}") for name in re.findall(r"\]\(([\w./-]+)\.md\)", text)
        ]
        placed = {"index", *(name for names in found.values() for name in names)}
        found[folder] = [name for name in dict.fromkeys(linked) if name not in placed]
    return found


def toctrees(docs: Path) -> Mapping[str, str]:
    """What the build appends to each index."""
    found = {f"{folder}/index": _toctree(names, ":hidden:") for folder, names in pages(docs).items()}
    found["reference/index"] += _toctree([f"reference/{name}" for name in MADE], ":maxdepth: 1")
    found["index"] = "".join(
        _toctree([f"{folder}/index"], f":hidden:\n:caption: {caption}")
        for folder, caption in SECTIONS.items()
    )
    return found


def _toctree(names: list[str], options: str) -> str:
    return "\n```{{toctree}}\n{}\n\n{}\n```\n".format(options, "\n".join(f"/{name}" for name in names))
