"""Adobe's lens correction profiles, ``.lcp``, recognised and refused.

In the format's own words::

    <photoshop:CameraProfiles> <rdf:Seq> <rdf:li>
      <rdf:Description stCamera:Lens="…" stCamera:FocalLength="24" stCamera:FocusDistance="10000" …>
        <stCamera:PerspectiveModel stCamera:RadialDistortParam1="…" …/>

One file holds a lens at many focal lengths and distances, for every body it fits; between those nothing says how
to interpolate, and most of them leave the focal length in pixels and the centre out. It is a profile for pictures
to look at and never a K.

Source: Adobe, "Lens Profile Creator user guide".
"""

from __future__ import annotations

from calibrary.parsers.content import Content
from calibrary.parsers.format import Format, Sniff, Sure

__all__ = ["FORMAT"]

NAMESPACE = "http://ns.adobe.com/photoshop/1.0/camera-profile"


def sniff(content: Content) -> Sniff | None:
    """An XMP packet with the profiles' namespace, or a piece of one."""
    if not content.xml_tags:
        return None
    if NAMESPACE in (content.text or "") or content.xml_tags[0].startswith("stCamera:"):
        return Sniff(Sure.MAGIC, "it is XMP with Adobe's camera-profile elements")
    return None


FORMAT = Format(
    name="adobe_lcp",
    title="an Adobe lens correction profile",
    suffixes=(".lcp",),
    reference="https://helpx.adobe.com/camera-raw/digital-negative.html",
    sniff=sniff,
    refuses="a lens profile for many bodies and focal lengths, not a calibration of one camera. Calibrate the "
    "camera itself, or export the adjusted camera of a reconstruction",
)
