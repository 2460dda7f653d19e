"""ARToolKit's binary camera, against its own formula through OpenCV."""

from __future__ import annotations

import struct

import pytest

from calibrary import parsers
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample

S = 0.9939
LENS = (0.1148, -0.2208, -0.0002, -0.0041)
LONG = (*LENS, 0.01, 0.02, -0.003, 0.001, 1e-4, 2e-4, -1e-4, 3e-4)


def made(*factor: float, f: tuple[float, float] = (1348.3 / S, 1352.3 / S)) -> bytes:
    matrix = (f[0], 0.0, 636.6, 0.0, 0.0, f[1], 507.5, 0.0, 0.0, 0.0, 1.0, 0.0)
    return struct.pack(f">2i12d{len(factor)}d", 1280, 1024, *matrix, *factor)


PLACE = (1348.3, 1352.3, 636.6, 507.5, S)
SAMPLES = {"artoolkit_param": Sample(made(*LENS, *PLACE))}


@pytest.mark.parametrize("lens", [LENS, LONG])
def test_k_is_in_the_factors(lens: tuple[float, ...]) -> None:
    [item] = parsers.decode(made(*lens, *PLACE), name="camera_para.dat")
    assert_projects_as_opencv(item, PLACE[:4], lens)
    assert item.intrinsics.image_size == (1280, 1024)


def test_older_versions_are_refused() -> None:
    with pytest.raises(UnsupportedModelError, match="before version 5"):
        parsers.decode(made(320.0, 240.0, -13.5, 1.02), name="camera_para.dat")


@pytest.mark.parametrize(
    ("data", "match"),
    [
        (made(*LENS, *PLACE, f=(1200.0, 1200.0)), "the matrix has 1200"),
        (made(*LENS, -1.0, *PLACE[1:]), "expected numbers above zero"),
        (made(*LENS, float("nan"), *PLACE[1:]), "not finite"),
        (made(*LENS, *PLACE)[:-1], "175 bytes, expected"),
    ],
)
def test_a_broken_file_names_what_is_wrong(data: bytes, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        parsers.decode(data, name="camera_para.dat", format="artoolkit_param")
