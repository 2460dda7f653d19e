"""OpenCV's calibrations in numpy's archives, against numpy's own reader and writer and OpenCV's projection."""

from __future__ import annotations

import io
import json
import pickle
import zipfile
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import KannalaBrandt, Rational
from calibrary.errors import MissingTagError, ParseError, UnknownFormatError, UnsupportedModelError
from calibrary.parsers.format import Fidelity
from calibrary.records import replace
from tests.parsers.cameras import SIZE, camera

MTX = np.array([[3650.1, 0.0, 2741.3], [0.0, 3648.7, 1815.9], [0.0, 0.0, 1.0]])
DIST = np.array([[-0.1131, 0.0247, -0.00037, 0.00081, -0.0062]])


def npz(save: Any = np.savez, **arrays: Any) -> bytes:
    buffer = io.BytesIO()
    save(buffer, **arrays)
    return buffer.getvalue()


def read(data: bytes, **options: str) -> Sequence[Calibration]:
    return parsers.decode(data, name="camera.npz", image_size=SIZE, options=options)


@pytest.mark.parametrize(
    ("matrix", "coefficients"),
    [
        ("mtx", "dist"), ("camera_matrix", "dist_coeffs"), ("K", "D"), ("cameraMatrix", "distCoeffs"),
        ("Camera_matrix", "distCoeff"), ("camMatrix", "distCoef"), ("intrinsic_matrix", "distortion_coefficients"),
    ],
)  # fmt: skip
def test_the_usual_names_are_read(matrix: str, coefficients: str) -> None:
    [item] = read(npz(**{matrix: MTX, coefficients: DIST, "rvecs": np.ones((40, 3, 1))}))
    rays = np.column_stack([*np.random.default_rng(1).uniform(-0.4, 0.4, (2, 30)), np.ones(30)])
    expected = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), MTX, DIST)[0].reshape(-1, 2)
    np.testing.assert_allclose(item.project(rays) - 0.5, expected, rtol=0, atol=1e-9)
    assert "OpenCV" in item.provenance.assumptions[0]


def test_a_packed_archive_and_other_kinds_of_numbers_are_read() -> None:
    [item] = read(npz(np.savez_compressed, mtx=MTX.astype("<f4"), dist=np.asfortranarray(DIST.T)))
    assert item.intrinsics.fx == np.float32(3650.1)
    assert item.distortion is not None
    assert item.distortion.coefficients["k3"] == -0.0062


def test_two_cameras_are_named_as_their_arrays() -> None:
    left, right = read(npz(mtxL=MTX, distL=DIST, mtxR=MTX + np.diag([0, 0, 9])[[2, 0, 1]], distR=DIST * 0))
    assert (left.camera.sub_camera, right.camera.sub_camera) == ("l", "r")
    assert right.intrinsics.cx - left.intrinsics.cx == pytest.approx(9)


def test_what_calibrate_camera_returned_is_the_quality() -> None:
    [item] = read(npz(ret=0.31, mtx=MTX, dist=DIST))
    assert item.quality is not None
    assert item.quality.rms_px == 0.31


def test_the_files_own_image_size_is_taken() -> None:
    data = npz(mtx=MTX, dist=DIST, image_size=np.array(SIZE))
    [item] = parsers.decode(data, name="camera.npz")
    assert item.intrinsics.image_size == SIZE
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(npz(mtx=MTX, dist=DIST), name="camera.npz")


def test_four_coefficients_are_asked_about() -> None:
    data = npz(K=MTX, D=DIST[0, :4])
    with pytest.raises(ParseError, match="distortion=fisheye"):
        read(npz(K=MTX, dist=DIST[0, :4]))
    assert isinstance(read(data, distortion="fisheye")[0].distortion, KannalaBrandt)


def test_numpy_loads_what_is_written() -> None:
    lens = Rational(k1=0.1, k2=0.02, p1=0.001, p2=0.002, k3=0.003, k4=0.01, k5=0.02, k6=0.03)
    data, verdict = parsers.encode([camera(lens)], "numpy_npz", name="camera.npz")
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        np.testing.assert_allclose(arrays["camera_matrix"], MTX - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
        assert arrays["distortion_coefficients"].shape == (1, 8)
        assert tuple(arrays["image_size"]) == SIZE
    assert verdict.outcome is Fidelity.EXACT


def test_objects_are_never_unpickled() -> None:
    class Bomb:
        def __reduce__(self) -> tuple[Any, tuple[str]]:
            return print, ("unpickled",)

    [item] = read(npz(mtx=MTX, views=np.array([Bomb()], dtype=object)))
    assert item.distortion is None
    with pytest.raises(ParseError, match="an array of Python objects"):
        read(npz(mtx=MTX, dist=np.array([Bomb()], dtype=object)))


@pytest.mark.parametrize("kind", [2, 3, 4, 5])
def test_a_pickle_is_refused_with_the_lines_that_save_it(kind: int) -> None:
    data = pickle.dumps({"mtx": MTX, "dist": DIST}, protocol=kind)
    with pytest.raises(UnsupportedModelError, match=r"numpy\.savez\('camera\.npz', mtx="):
        parsers.decode(data, name="wide_dist_pickle.p")
    buffer = io.BytesIO()
    np.save(buffer, np.array({"mtx": 1}, dtype=object), allow_pickle=True)
    with pytest.raises(UnsupportedModelError, match="runs whatever program"):
        parsers.decode(buffer.getvalue(), name="camera.npy")


def test_an_archive_without_a_camera_is_not_claimed() -> None:
    with pytest.raises(UnknownFormatError):
        read(npz(features=np.eye(3), newcameramtx=MTX))
    with pytest.raises(ParseError, match="no camera matrix"):
        parsers.decode(npz(features=np.eye(3)), name="x.npz", format="numpy_npz", image_size=SIZE)


def test_an_array_that_lies_about_its_length_allocates_nothing() -> None:
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 3), }\n"
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("mtx.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    with pytest.raises(ParseError, match="mtx: 0 bytes of numbers, expected"):
        read(buffer.getvalue())


def test_a_name_that_stands_twice_is_refused() -> None:
    buffer = io.BytesIO(npz(mtx=MTX))
    with zipfile.ZipFile(buffer, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("mtx.npy", b"")
    with pytest.raises(ParseError, match="duplicate key"):
        read(buffer.getvalue())


def test_objects_and_arrays_of_another_length_under_a_cameras_names_are_named() -> None:
    objects = np.array(np.eye(3), dtype=object)
    with pytest.raises(ParseError, match=r"mtx: it is an array of Python objects.*dtype=float"):
        read(npz(mtx=objects, dist=np.zeros(5)))
    with pytest.raises(ParseError, match=r"dist: it is an array of Python objects"):
        read(npz(mtx=np.eye(3) * 1000, dist=objects))
    with pytest.raises(ParseError, match=r"mtx: the array is longer than any camera's"):
        read(npz(save=np.savez_compressed, mtx=np.zeros((2000, 2000))))


def test_extras_of_other_shapes_are_written_or_named_as_lost() -> None:
    points = {"rows": 1, "cols": 2, "dt": "2f", "data": [250.5, 57.25, 307.5, 71.75]}
    extras = {"image_points": points, "board": {"columns": 9}, "flags": [[1], [2, 3]]}
    [camera] = read(npz(mtx=MTX, dist=np.zeros(5)))
    kept = tuple((f"opencv_storage/{key}", json.dumps(value)) for key, value in extras.items())
    data, verdict = parsers.encode([replace(camera, extras=kept)], "numpy_npz")
    with np.load(io.BytesIO(data)) as archive:
        assert archive["image_points"].shape == (1, 2, 2)
        assert "board" not in archive
        assert "flags" not in archive
    assert "board" in str(verdict)
