"""NeuS's projection matrices and LLFF's poses, in numpy's files."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibrary import parsers
from calibrary.errors import MissingSizeError, ParseError
from tests.parsers.samples import Sample

K = np.array([[1297.16, 0.4, 384.2], [0.0, 1295.3, 288.1], [0.0, 0.0, 1.0]])


def neus(*matrices: np.ndarray, count: int = 3) -> bytes:
    arrays: dict[str, Any] = {"camera_mat_0": np.eye(4)}
    for index in range(count * len(matrices)):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("xyz", [0.3 * index, 0.2, 0.1 * index]).as_matrix()
        pose[:3, 3] = [1.0, -0.5, 4.0 + index]
        world = np.eye(4)
        world[:3] = matrices[index % len(matrices)] @ pose[:3]
        arrays |= {f"world_mat_{index}": 0.7 * world, f"scale_mat_{index}": 2.0 * np.eye(4)}
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def llff(*rows: tuple[float, float, float]) -> bytes:
    table = np.zeros((len(rows), 17))
    table[:, [4, 9, 14]] = rows
    buffer = io.BytesIO()
    np.save(buffer, table)
    return buffer.getvalue()


SAMPLES = {"neus_npz": Sample(neus(K)), "llff_npy": Sample(llff((3024, 4032, 3260.5), (3024, 4032, 3260.5)))}


def test_images_of_one_k_are_one_camera() -> None:
    [item] = parsers.decode(neus(K), name="cameras_sphere.npz", image_size=(768, 576))
    found = item.intrinsics
    np.testing.assert_allclose(
        (found.fx, found.fy, found.cx, found.cy, found.skew), (1297.16, 1295.3, 384.7, 288.6, 0.4), atol=1e-9
    )
    assert item.distortion is None
    assert item.quality is not None
    assert item.quality.views == 3


def test_another_k_is_another_camera() -> None:
    found = parsers.decode(neus(K, K + np.diag([5.0, 5.0, 0.0])), name="x.npz", image_size=(768, 576))
    assert [item.camera.sub_camera for item in found] == ["world_mat_0", "world_mat_1"]


def test_the_size_is_asked_for_and_a_pose_alone_is_refused() -> None:
    with pytest.raises(MissingSizeError):
        parsers.decode(neus(K), name="x.npz")
    with pytest.raises(ParseError, match="not in px"):
        parsers.decode(neus(np.eye(3)), name="x.npz", image_size=(768, 576))


def test_llff_has_one_focal_length_about_the_middle() -> None:
    first, second = parsers.decode(
        llff((3024, 4032, 3260.5), (3024, 4032, 3260.5), (1080, 1920, 1500.0)), name="poses_bounds.npy"
    )
    assert (first.intrinsics.fx, first.intrinsics.cx, first.intrinsics.cy) == (3260.5, 2016, 1512)
    assert first.quality is not None
    assert (first.quality.views, second.intrinsics.image_size) == (2, (1920, 1080))
    assert first.distortion is None


@pytest.mark.parametrize(
    ("row", "match"), [((0, 10, 5.0), "image size"), ((10, 10, float("nan")), r"K\[0\]: this is not finite")]
)
def test_a_broken_row_names_what_is_wrong(row: tuple[float, float, float], match: str) -> None:
    with pytest.raises(ParseError, match=match):
        parsers.decode(llff(row), name="poses_bounds.npy")
