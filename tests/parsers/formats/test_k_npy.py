"""K as a numpy array, against numpy's own reader and writer."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from numpy.lib import format as numpy_format

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.errors import MissingTagError, ParseError, UnknownFormatError
from calibrary.parsers.format import Fidelity
from tests.parsers.cameras import SIZE, camera

K = np.array([[3650.1, -0.3, 2741.3], [0.0, 3648.7, 1815.9], [0.0, 0.0, 1.0]])


def npy(array: Any, version: tuple[int, int] | None = None) -> bytes:
    buffer = io.BytesIO()
    numpy_format.write_array(buffer, np.asanyarray(array), version=version)
    return buffer.getvalue()


def read(data: bytes, **options: str) -> Calibration:
    [calibration] = parsers.decode(data, name="K_matrix.npy", image_size=SIZE, options=options)
    return calibration


def test_what_numpy_saves_is_read_to_the_bit() -> None:
    assert read(npy(K), origin="corner").intrinsics.matrix.tolist() == K.tolist()


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
def test_every_version_of_the_file_format_is_read(version: tuple[int, int]) -> None:
    assert read(npy(K, version)).intrinsics.fx == 3650.1


@pytest.mark.parametrize("kind", ["<f8", ">f8", "<f4", ">f4", "<f2", "<i4", ">i8", "<u2"])
def test_every_kind_of_number_is_read(kind: str) -> None:
    whole = np.array([[1650, 0, 1041], [0, 1648, 815], [0, 0, 1]])
    assert read(npy(whole.astype(kind)), origin="corner").intrinsics.matrix.tolist() == whole.tolist()


def test_columns_first_is_read() -> None:
    assert read(npy(np.asfortranarray(K)), origin="corner").intrinsics.matrix.tolist() == K.tolist()


def test_numpy_loads_what_is_written() -> None:
    data, verdict = parsers.encode([camera()], "k_npy", drop_distortion=True)
    np.testing.assert_array_equal(np.load(io.BytesIO(data)), camera().intrinsics.matrix)
    assert verdict.outcome is Fidelity.K_ONLY
    assert verdict.dropped[:2] == ("image size", "distortion (brown)")


def test_a_bare_matrix_gets_the_lowest_grade_a_solver_may_use() -> None:
    calibration = read(npy(K))
    assert calibration.grade is Grade.DERIVED
    assert calibration.distortion is None
    assert "taken as derived" in calibration.provenance.assumptions[1]


@pytest.mark.parametrize("version", [(1, 0), (2, 0)])
def test_it_counts_from_the_pixels_centre_as_opencv_unless_the_caller_says_otherwise(
    version: tuple[int, int],
) -> None:
    [taken, _] = read(npy(K, version)).provenance.assumptions
    assert "the centre of the top-left pixel was taken, unless --pixel-origin says otherwise" in taken
    assert read(npy(K, version)).intrinsics.cx == 2741.8
    assert read(npy(K, version), origin="corner").intrinsics.cx == 2741.3


def test_a_file_of_calibrarys_own_says_so_and_counts_from_the_corner() -> None:
    data, _ = parsers.encode([camera()], "k_npy", drop_distortion=True)
    assert read(data).intrinsics.cx == 2741.3
    assert "one of calibrary's own" in read(data).provenance.assumptions[0]
    assert len(data) == len(npy(K)) + 64
    saved_again = npy(np.load(io.BytesIO(data)))
    assert read(saved_again).intrinsics.cx == 2741.8


def test_the_image_size_has_to_be_given() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(npy(K), name="K.npy")


@pytest.mark.parametrize(
    "array",
    [
        np.eye(3),
        K.T,
        2 * K,
        -K,
        np.full((3, 3), np.nan),
        np.zeros((3, 3)),
        np.array([[np.cos(1), -np.sin(1), 0], [np.sin(1), np.cos(1), 0], [0, 0, 1]]),
    ],
)
def test_another_matrix_is_neither_claimed_nor_read(array: Any) -> None:
    with pytest.raises(UnknownFormatError, match="no format claims it"):
        read(npy(array))
    with pytest.raises(ParseError, match="expected"):
        parsers.decode(npy(array), name="K.npy", format="k_npy", image_size=SIZE)


@pytest.mark.parametrize("array", [K[:2], K[None], np.array(3.0), K.astype(complex), K.astype(bool)])
def test_another_array_is_refused(array: Any) -> None:
    with pytest.raises(ParseError, match="expected"):
        parsers.decode(npy(array), name="K.npy", format="k_npy", image_size=SIZE)


def test_a_pickle_is_never_opened() -> None:
    header = b"{'descr': '|O', 'fortran_order': False, 'shape': (3, 3), }\n"
    data = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + b"cos\nsystem\n"
    with pytest.raises(ParseError, match="plain numbers"):
        parsers.decode(data, name="K.npy", format="k_npy", image_size=SIZE)


def test_a_header_that_asks_for_a_terabyte_allocates_nothing() -> None:
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }\n"
    data = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    with pytest.raises(ParseError, match="shape"):
        parsers.decode(data, name="K.npy", format="k_npy", image_size=SIZE)
