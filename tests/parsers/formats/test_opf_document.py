"""OPF's other documents are recognised, and refused with the way out."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.errors import UnsupportedModelError
from tests.parsers.samples import Sample

SAMPLES = {"opf_document": Sample(b'{"format": "application/opf-camera-list+json", "version": "1.0"}')}


@pytest.mark.parametrize("kind", ["project", "camera-list", "projected-input-cameras"])
def test_it_is_refused_by_name_with_the_way_out(kind: str) -> None:
    data = f'{{"format": "application/opf-{kind}+json", "version": "1.0"}}'.encode()
    with pytest.raises(UnsupportedModelError, match=r"OPF document.*calibrated_cameras\.json"):
        parsers.decode(data, name="file.json")
