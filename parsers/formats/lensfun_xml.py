"""lensfun's lens database, recognised and refused.

In the format's own words::

    <lensdatabase version="2">
      <lens>
        <maker>DJI</maker> <model>FC6310 &amp; compatibles</model> <cropfactor>2.736</cropfactor>
        <calibration>
          <distortion model="ptlens" focal="8.8" a="…" b="…" c="…"/>

It describes a kind of lens, measured on one copy, in radii relative to the image's shorter half. It holds no
focal length in pixels and no principal point, so it is a profile for pictures to look at and never a K.

Source: lensfun, "Lensfun database file format".
"""

from __future__ import annotations

from calibrary.parsers.content import Content
from calibrary.parsers.format import Format, Sniff, Sure

__all__ = ["FORMAT"]

ROOT = "lensdatabase"


def sniff(content: Content) -> Sniff | None:
    """The root's name, which the database's own files say in a document type before it."""
    if content.xml_root == ROOT or f"<!DOCTYPE {ROOT}" in (content.text or ""):
        return Sniff(Sure.MAGIC, f"the XML root is <{ROOT}>")
    return None


FORMAT = Format(
    name="lensfun_xml",
    title="a lensfun lens database",
    suffixes=(".xml",),
    reference="https://lensfun.github.io/manual/latest/dbformat.html",
    sniff=sniff,
    refuses="a lens profile of a model of lens, not a calibration: it has no focal length in pixels and no "
    "principal point of one camera. Calibrate the camera itself, or export the adjusted camera "
    "of a reconstruction",
)
