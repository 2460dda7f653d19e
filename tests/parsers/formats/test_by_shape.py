"""Hand-made files of K and a distortion, in every container, by the names that scripts give them."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
import scipy.io
import yaml

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady
from calibrary.errors import InputError, ParseError

FX, FY, CX, CY = 1000.5, 1001.5, 640.25, 360.75
ROWS = [[FX, 0.0, CX], [0.0, FY, CY], [0.0, 0.0, 1.0]]
LENS = BrownConrady(k1=-0.1131, k2=0.0247, p1=0.0002, p2=-0.0004, k3=0.0031)
VECTOR = [-0.1131, 0.0247, 0.0002, -0.0004, 0.0031]
BY_NAME = dict(zip(("k1", "k2", "p1", "p2", "k3"), VECTOR, strict=True))
SIDES = {"w": 1280, "h": 720}
PAIRS = [
    ("K", "D"), ("mtx", "dist"), ("cam_mtx", "dist_coefs"), ("camera_matrix", "dist_coefs"),
    ("cameraMatrix", "distCoeffs"), ("intrinsic_matrix", "distortion_coefficients"), ("intrinsics", "kc"),
    ("intrinsic", "distortion_vector"), ("matrix", "distortion_params"),
]  # fmt: skip
SIZES: list[dict[str, object]] = [
    {"resolution": [1280, 720]}, {"size": [1280, 720]}, {"image_size": [1280, 720]}, {"img_size": [1280, 720]},
    {"DIM": [1280, 720]}, {"image_shape": [720, 1280]}, {"image_shape": [720, 1280, 3]}, {"image_shape": [1280, 720]},
    {"w": 1280, "h": 720}, {"cols": 1280, "rows": 720}, {"image_width": 1280, "image_height": 720},
    {"frame_width": 1280, "frame_height": 720},
]  # fmt: skip


def as_json(tree: Mapping[str, object]) -> tuple[str, bytes]:
    return "camera.json", json.dumps(tree).encode()


def as_yaml(tree: Mapping[str, object]) -> tuple[str, bytes]:
    return "camera.yaml", yaml.safe_dump(dict(tree)).encode()


def as_npz(tree: Mapping[str, object]) -> tuple[str, bytes]:
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {key: np.array(value) for key, value in tree.items()}
    np.savez(buffer, **arrays)
    return "camera.npz", buffer.getvalue()


def as_mat(tree: Mapping[str, object]) -> tuple[str, bytes]:
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, {key: np.array(value) for key, value in tree.items()})
    return "camera.mat", buffer.getvalue()


CONTAINERS = (as_json, as_yaml, as_npz, as_mat)
Container = Callable[[Mapping[str, object]], tuple[str, bytes]]


def read(made: tuple[str, bytes], *, sized: bool = True) -> Sequence[Calibration]:
    name, data = made
    format_ = {"json": "opencv_storage", "yaml": "opencv_storage", "npz": "numpy_npz", "mat": "matlab_mat"}
    return parsers.decode(
        data, name=name, format=format_[name.rpartition(".")[2]], image_size=None if sized else (1280, 720)
    )


def same(item: Calibration) -> None:
    K = item.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (FX, FY, CX + 0.5, CY + 0.5)
    assert K.image_size == (1280, 720)
    assert item.distortion == LENS


@pytest.mark.parametrize("container", CONTAINERS)
@pytest.mark.parametrize(("matrix", "coefficients"), PAIRS)
def test_every_pair_of_names_is_read_in_every_container(
    container: Container, matrix: str, coefficients: str
) -> None:
    [item] = read(container({matrix: ROWS, coefficients: [VECTOR]}), sized=False)
    same(item)


@pytest.mark.parametrize("container", CONTAINERS)
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_every_way_to_state_the_size_is_read(container: Container, size: Mapping[str, object]) -> None:
    [item] = read(container({"K": ROWS, "dist": VECTOR, **size}))
    same(item)


@pytest.mark.parametrize("container", [as_json, as_yaml])
@pytest.mark.parametrize(
    "tree",
    [
        {
            "calibration": {"camera_matrix": ROWS, "dist_coeffs": [VECTOR]},
            "camera": {"resolution": {"w": 1280, "h": 720}},
        },
        {"intrinsics": {"K": ROWS, "D": VECTOR, "resolution": [1280, 720]}},
        {"camera": {"matrix": ROWS, "distortion": VECTOR, "size": [1280, 720]}},
        {
            "K": ROWS,
            "distortion": BY_NAME,
            "image_size": [1280, 720],
        },
        {
            "K": ROWS,
            "radial": [-0.1131, 0.0247, 0.0031],
            "tangential": [0.0002, -0.0004],
            "image_size": [1280, 720],
        },
        {"intrinsics": {"fx": FX, "fy": FY, "cx": CX, "cy": CY}, "dist": VECTOR, "w": 1280, "h": 720},
        {"focal_length": [FX, FY], "principal_point": [CX, CY], "dist": VECTOR, "w": 1280, "h": 720},
    ],
    ids=str,
)
def test_one_table_below_another_and_every_shape_of_both_is_read(
    container: Container, tree: Mapping[str, object]
) -> None:
    [item] = read(container(tree))
    same(item)


def test_a_wrapped_yaml_is_recognised_without_its_format() -> None:
    name, data = as_yaml(
        {"calibration": {"camera_matrix": ROWS, "dist_coeffs": [VECTOR], "image_size": [1280, 720]}}
    )
    [item] = parsers.decode(data, name=name)
    same(item)


@pytest.mark.parametrize(
    "lens",
    [
        {"distortion": BY_NAME},
        {"dist_coeffs": VECTOR},
        {"distortion": VECTOR},
    ],
)
def test_fx_by_name_with_a_nested_lens_is_read(lens: Mapping[str, object]) -> None:
    name, data = as_json({"fx": FX, "fy": FY, "cx": CX, "cy": CY, "width": 1280, "height": 720, **lens})
    [item] = parsers.decode(data, name=name)
    same(item)


def test_four_coefficients_without_a_model_are_asked_or_unknown_and_named() -> None:
    with pytest.raises(InputError, match="--set distortion=brown"):
        read(as_json({"K": ROWS, "dist": VECTOR[:4], "image_size": [1280, 720]}))
    name, data = as_json(
        {"fx": FX, "fy": FY, "cx": CX, "cy": CY, "width": 1280, "height": 720, "dist": VECTOR[:4]}
    )
    [item] = parsers.decode(data, name=name)
    assert item.distortion is None
    assert any("'dist' (-0.1131" in note for note in item.notes)


@pytest.mark.parametrize(
    "lens",
    [
        {"kc": VECTOR},
        {"distortionCoefficients": VECTOR},
        {"radial": [-0.1131, 0.0247, 0.0031], "tangential": [0.0002, -0.0004]},
    ],
    ids=str,
)
def test_matlabs_matrix_is_transposed_counts_from_one_and_keeps_the_lens_beside_it(
    lens: Mapping[str, object],
) -> None:
    transposed = np.array(ROWS).T.tolist()
    [item] = read(as_mat({"IntrinsicMatrix": transposed, "ImageSize": [720, 1280], **lens}))
    K = item.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (FX, FY, CX - 0.5, CY - 0.5)
    assert item.distortion == LENS


def test_matlabs_matrix_alone_has_an_unknown_distortion() -> None:
    [item] = read(as_mat({"IntrinsicMatrix": np.array(ROWS).T.tolist(), "ImageSize": [720, 1280]}))
    assert item.distortion is None


def test_a_shape_that_nothing_decides_is_asked() -> None:
    centred = [[FX, 0.0, 500.0], [0.0, FY, 500.0], [0.0, 0.0, 1.0]]
    with pytest.raises(ParseError, match="rows and columns, or width and height"):
        read(as_json({"K": centred, "dist": VECTOR, "image_shape": [720, 1280]}))
