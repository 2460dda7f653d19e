"""OPF's other documents: a project is some dozen JSON files, and only two of them hold cameras' optics.

In the format's own words, each names itself by ``"format": "application/opf-…+json"``: the project file, the
list of images, projected cameras, control points, reference frames, GPS bias, point clouds. Their numbers are
positions, not a K.

Source: OPF specification 1.0.
"""

from __future__ import annotations

from calibrary.parsers import text as strict
from calibrary.parsers.content import Content
from calibrary.parsers.format import Format, Sniff, Sure
from calibrary.parsers.formats.opf_calibrated_cameras import INPUT_MARK, MARK

__all__ = ["FORMAT"]


def sniff(content: Content) -> Sniff | None:
    """Any OPF document but the two that are read."""
    document = content.json
    mark = document.get("format") if isinstance(document, dict) else None
    if not isinstance(mark, str) or mark in {MARK, INPUT_MARK}:
        return None
    if not mark.startswith("application/opf-"):
        return None
    return Sniff(Sure.MAGIC, f"its format is {strict.shown(mark)}")


FORMAT = Format(
    name="opf_document",
    title="an OPF document without cameras' optics",
    suffixes=(".json", ".opf"),
    reference="https://pix4d.github.io/opf-spec/index.html",
    sniff=sniff,
    refuses=(
        "it holds no K; give the project's calibrated cameras (usually calibrated_cameras.json) or its input "
        "cameras instead"
    ),
)
