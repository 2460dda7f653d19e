"""Adobe's profiles are known for what they are, and never become a K."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.errors import UnsupportedModelError
from tests.parsers.samples import Sample

LCP = """<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
<rdf:Description xmlns:photoshop="http://ns.adobe.com/photoshop/1.0/"
 xmlns:stCamera="http://ns.adobe.com/photoshop/1.0/camera-profile"><photoshop:CameraProfiles/></rdf:Description>
</rdf:RDF></x:xmpmeta>"""

SAMPLES = {"adobe_lcp": Sample(LCP.encode())}


@pytest.mark.parametrize("text", [LCP, "<stCamera:FocalLength>14.0</stCamera:FocalLength>"])
def test_a_profile_is_refused_with_the_way_out(text: str) -> None:
    with pytest.raises(UnsupportedModelError, match=r"lens profile.*Calibrate the camera"):
        parsers.decode(text.encode(), name="lens.lcp")
