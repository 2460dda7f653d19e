"""Pix4D's camera database, the XML that Pix4Dmapper exports and Pix4Dfields and Pix4Dreact take in.

In the format's own words, as far as Pix4D's help shows it::

    <cameraModelDB>
      <version>19</version>
      <cameras>
        <camera name="S.O.D.A._10.6_5472x3648">
          <imageWidth>5472</imageWidth> <imageHeight>3648</imageHeight>
          <pixelSize>2.4</pixelSize> …

What follows, the focal length among it, is not published where it could be checked, so no K is taken from it.

Source: Pix4D support, "User-provided camera parameter file".
"""

from __future__ import annotations

from calibrary.parsers.content import Content
from calibrary.parsers.format import Format, Sniff, Sure

__all__ = ["FORMAT"]


def sniff(content: Content) -> Sniff | None:
    """The root has a name of its own."""
    if content.xml_root == "cameraModelDB":
        return Sniff(Sure.MAGIC, "the XML root is <cameraModelDB>")
    return None


FORMAT = Format(
    name="pix4d_camera_database",
    title="a Pix4D camera database",
    suffixes=(".xml",),
    reference="https://support.pix4d.com/hc/en-us/articles/360035481811",
    sniff=sniff,
    refuses=(
        "its elements for the focal length and the lens are not published, and most of its cameras are a maker's "
        "nominal values; export the project's .cam file or its OPF instead"
    ),
)
