"""README.md as the package index shows it: without the links and pictures that lead into the repository.

The repository has no public address yet, so a relative link leads nowhere there, and an absolute one cannot be made.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

NOTE = "The manual is in the source distribution, below `docs/`; `make docs` builds it as a site."


class IndexReadme(MetadataHookInterface):
    """Gives the metadata its long description."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Fill in ``readme``, which pyproject.toml declares dynamic."""
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": f"{for_index(text)}\n{NOTE}\n"}


def for_index(text: str) -> str:
    """The text with relative links as plain words, and without relative pictures."""
    text = re.sub(r"!\[[^\]]*\]\((?!\w+://)[^)]*\)\n*", "", text)
    return re.sub(r"\[([^\]]*)\]\((?!\w+://)[^)]*\)", r"\1", text)
